"""From a ``pinocchio.Model`` in memory to a :class:`~wbc.models.urdf.Urdf`, and to a model of one position a joint."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from wbc.errors import ModelError
from wbc.models.geometry import Box, Cylinder, Geometry, Mesh, Origin, Shape, Sphere, capsule, triple
from wbc.models.pinocchio_ import Base
from wbc.models.poses import BASE, root_joint
from wbc.models.urdf import Inertial, Joint, JointKind, Link, Urdf, gathered, six, unused
from wbc.types import Vec

_LINKS = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
#: Joints before the robot's own, by base, each with the link that it stands on; names as ``Urdf.on_plane`` has them.
_ROOTS = {
    "fixed": (),
    "floating": (("", "", pin.JointModelFreeFlyer()),),
    "planar": (
        ("plane", "base_x", pin.JointModelPX()), ("base_x_link", "base_y", pin.JointModelPY()),
        ("base_y_link", "base_yaw", pin.JointModelRZ()),
    ),
}  # fmt: skip
#: The base of a model by its first joint.
_BASES: dict[str, Base] = {"JointModelFreeFlyer": "floating", "JointModelPlanar": "planar"}


def read_pinocchio(model: Any, collisions: Any = None, visuals: Any = None) -> tuple[Urdf, Base, Callable[[str], Any]]:
    """The description of a ``pinocchio.Model``, its shapes from two ``pinocchio.GeometryModel``, its own base, and, by
    base, the model that has one position for each joint: joints without end are ordinary ones without limits. The order
    of joints and gravity stay.

    Raises:
        ModelError: a joint that is neither revolute nor prismatic, named; a free or planar joint that is not at the
            world's origin, where q of a simulation would be another; nothing that moves.
    """
    reading = _Reading(model.copy())
    return reading.robot(collisions, visuals), reading.base, reading.of_one_position_each


class _Reading:
    def __init__(self, model: Any) -> None:
        self.model = model
        kinds = [joint.shortname() for joint in model.joints]
        self.base = _BASES.get(kinds[1], "fixed") if len(kinds) > 1 else "fixed"
        self.first = 1 if self.base == "fixed" else 2
        if self.first == 2 and not model.jointPlacements[1].isIdentity(1e-12):
            what = "free" if self.base == "floating" else "planar"
            raise ModelError(f"the {what} joint {model.names[1]!r} is not at the world's origin; place it there")
        odd = [f"{model.names[i]!r} is {kinds[i]}" for i in range(self.first, model.njoints) if model.nvs[i] != 1]
        if odd:
            raise ModelError(
                f"joint {'; '.join(odd)}: joints turn about or move along one axis, after one free or planar joint"
            )
        for i in range(2, model.njoints):
            if model.parents[i] not in model.supports[i - 1]:
                raise ModelError(
                    f"joint {model.names[i]!r} is added after other limbs than its own: Pinocchio's algorithms need "
                    "every limb whole before the next"
                )
        data = model.createData()
        q = pin.neutral(model)
        jacobians = [pin.computeJointJacobian(model, data, q, i).reshape(6, -1) for i in range(model.njoints)]
        self.axes = [jacobians[i][:, model.idx_vs[i]] for i in range(self.first, model.njoints)]
        self.left_out: list[str] = []
        self.link_of = {i: self._link_at(i) for i in range(self.first - 1, model.njoints)}

    def _link_at(self, joint: int) -> str:
        """The link that a joint moves, or the joint's own name where no frame is called otherwise."""
        frames = [f for f in self.model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY]
        name = next((f.name for f in frames if f.placement.isIdentity(1e-12)), None)
        return name or (self.model.names[joint] if joint >= self.first else "base")

    def robot(self, collisions: Any, visuals: Any) -> Urdf:
        model = self.model
        links = [Link(link, _inertial(model.inertias[i])) for i, link in self.link_of.items()]
        joints = gathered(self._joint, range(self.first, model.njoints))
        names = {link.name for link in links}
        for frame in model.frames:
            if frame.type in _LINKS and frame.name not in names and frame.parentJoint in self.link_of:
                names.add(frame.name)
                links.append(Link(frame.name))
                at, parent = _origin(frame.placement), self.link_of[frame.parentJoint]
                mount = unused(f"{frame.name}_mount", model.names)
                joints.append(Joint(mount, "fixed", parent, frame.name, at))
        return Urdf(
            model.name or "robot", tuple(links), tuple(joints), self._shapes(visuals), self._shapes(collisions),
            base=Origin() if self.base == "floating" else None, left_out=tuple(self.left_out),
            poses={x.key(): self._pose(np.array(x.data())) for x in model.referenceConfigurations},
        )  # fmt: skip

    def _joint(self, i: int) -> Joint:
        model, axis = self.model, self.axes[i - self.first]
        slides = not axis[3:].any()
        if not slides and np.abs(axis[:3]).max() > 1e-12:
            raise ModelError(f"joint {model.names[i]!r} is a screw: joints turn about or move along one axis")
        kind: JointKind = "prismatic" if slides else "revolute" if model.nqs[i] == 1 else "continuous"
        q, v = model.idx_qs[i], model.idx_vs[i]
        lower, upper = (
            (-inf, inf) if kind == "continuous" else (model.lowerPositionLimit[q], model.upperPositionLimit[q])
        )
        return Joint(
            model.names[i], kind, self.link_of[model.parents[i]], self.link_of[i], _origin(model.jointPlacements[i]),
            triple(axis[:3] if slides else axis[3:]), float(lower), float(upper),
            velocity=float(model.velocityLimit[v]), effort=float(model.effortLimit[v]),
            damping=float(model.damping[v]), friction=float(model.friction[v]), armature=float(model.armature[v]),
        )  # fmt: skip

    def _pose(self, q: Vec) -> dict[str, list[float]]:
        model = self.model
        pose = {model.names[i]: q[model.idx_qs[i] :][: model.nqs[i]].tolist() for i in range(1, model.njoints)}
        if self.base == "floating":
            pose[BASE] = pose.pop(model.names[1])
        elif self.base == "planar":
            x, y, *heading = pose.pop(model.names[1])
            pose |= {"base_x": [x], "base_y": [y], "base_yaw": heading}
        return pose

    def of_one_position_each(self, base: str) -> Any:
        """The model on this base, whatever its own is."""
        old, new, carrier = self.model, pin.Model(), 0
        new.name, new.gravity = old.name, old.gravity
        for link, name, kind in _ROOTS[base]:
            if link:
                new.addBodyFrame(link, carrier, pin.SE3.Identity(), -1)
            carrier = new.addJoint(carrier, kind, pin.SE3.Identity(), name or root_joint(list(old.names)[self.first :]))
            new.addJointFrame(carrier)
        moved = {self.first - 1: carrier}  # joints of the new model by those of the old one
        for i in range(self.first, old.njoints):
            kind = old.joints[i]
            if old.nqs[i] == 2:
                kind = pin.JointModelRevoluteUnaligned(self.axes[i - self.first][3:])
            moved[i] = new.addJoint(moved[old.parents[i]], kind, old.jointPlacements[i], old.names[i])
            if not old.existFrame(old.names[i], pin.FrameType.JOINT):
                new.addJointFrame(moved[i])
        for i, joint in moved.items():
            new.appendBodyToJoint(joint, old.inertias[i], pin.SE3.Identity())
        for frame in list(old.frames)[1:]:
            if frame.parentJoint >= self.first or (frame.parentJoint in moved and frame.type != pin.FrameType.JOINT):
                joint = moved[frame.parentJoint]
                new.addFrame(pin.Frame(frame.name, joint, 0, frame.placement, frame.type), False)
        for i, link in self.link_of.items():
            if not new.existFrame(link, pin.FrameType.BODY):
                new.addBodyFrame(link, moved[i], pin.SE3.Identity(), -1)
        return new

    def _shapes(self, geometry: Any) -> tuple[Geometry, ...]:
        found: list[Geometry] = []
        for item in () if geometry is None else geometry.geometryObjects:
            if item.parentJoint not in self.link_of:
                continue
            shapes = _shapes(item)
            if not shapes:
                self.left_out.append(f"shape {item.name!r}, {type(item.geometry).__name__} without a file, is left out")
            color = tuple(map(float, item.meshColor))
            found += [
                Geometry(self.link_of[item.parentJoint], shape, _origin(item.placement * pin.SE3(np.eye(3), at)), color)  # type: ignore[arg-type]
                for shape, at in shapes
            ]
        return tuple(found)


def _shapes(item: Any) -> list[tuple[Shape, Vec]]:
    """What a geometry object is made of, each at a place in its axes; nothing where that cannot be said."""
    shape, here = item.geometry, np.zeros(3)
    match shape:
        case coal.Box():
            return [(Box(triple(2.0 * shape.halfSide)), here)]
        case coal.Sphere():
            return [(Sphere(float(shape.radius)), here)]
        case coal.Cylinder():
            return [(Cylinder(float(shape.radius), 2.0 * float(shape.halfLength)), here)]
        case coal.Capsule():
            return capsule(float(shape.radius), 2.0 * float(shape.halfLength))
    if Path(item.meshPath).is_file():
        return [(Mesh(Path(item.meshPath).resolve(), triple(item.meshScale)), here)]
    return []


def _inertial(inertia: Any) -> Inertial | None:
    if not inertia.mass:
        return None
    return Inertial(float(inertia.mass), six(inertia.inertia), Origin(triple(inertia.lever)))


def _origin(placement: Any) -> Origin:
    return Origin.of(placement.translation, placement.rotation)
