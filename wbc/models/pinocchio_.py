"""Robots through Pinocchio: what does not change. Their moments are in :mod:`wbc.models.model`."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, Literal, final

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc import checks
from wbc.errors import ModelError
from wbc.models import plausible
from wbc.models.feet import Foot
from wbc.models.geometry import Geometry
from wbc.models.limits import Limits, finite_interval
from wbc.models.model import RobotModel
from wbc.models.poses import configuration, root_joint
from wbc.models.urdf import Joint, Urdf
from wbc.tolerances import HUGE
from wbc.types import Vec, read_only

Base = Literal["fixed", "floating", "planar"]
BASES = ("fixed", "floating", "planar")


@final
class PinocchioModel(RobotModel):
    """A robot from a URDF or MJCF file. Made by :func:`wbc.models.load`; it does not change once made.

    Beside what every :class:`~wbc.models.model.RobotModel` has: ``base`` "fixed", "floating" or "planar"; ``urdf``, the
    checked description with its ``path`` and ``text()``; ``armature`` (nj,), inertia of the rotors, part of M;
    ``visuals`` and ``collisions``, shapes on links; ``feet`` by frame; ``configurations`` (nq,) by name, those of its
    SRDF or the keyframes of its MJCF; ``pinocchio``, the model of that library (to be read only: states keep copies),
    and ``frames``, the index of each frame in it.

    A floating base is the root link of the description. Each joint has one position: joints without end count on past
    π and have infinite limits. Mimic joints are joints of their own (``tasks.mimic_joints`` makes them gears). The mass
    is what moves: on a fixed base without the links bolted to the world.

    ``model``: the Pinocchio model of the description, where there is one already.

    Raises:
        ModelError: Pinocchio cannot make a model of the description.
        InvalidInput: ``base`` is something else.

    Example:
        >>> from wbc.models import load
        >>> robot = load("quadruped")
        >>> robot.nq, robot.nv, robot.nb, robot.nj
        (19, 18, 6, 12)
        >>> state = robot.state()
        >>> state.update(0.0, robot.q0, 0 * state.v)
        >>> float(state.frame("front_left_foot").position[2].round(3)), state.M.shape
        (0.02, (18, 18))
    """

    urdf: Urdf
    base: Base
    visuals: Sequence[Geometry]
    collisions: Sequence[Geometry]
    feet: Mapping[str, Foot]
    armature: Vec
    configurations: Mapping[str, Vec]

    def __init__(
        self,
        urdf: Urdf,
        *,
        base: Base = "fixed",
        name: str | None = None,
        feet: Sequence[Foot] = (),
        model: Any = None,
    ) -> None:
        checks.one_of("base", base, BASES)
        self.urdf = urdf
        self.base = base
        self.name = name or urdf.name
        self.visuals, self.collisions = urdf.visuals, urdf.collisions
        self.feet = {foot.frame: foot for foot in feet}
        model = _build(urdf, base) if model is None else model
        self._take(model, 6 if base == "floating" else 0)
        by_name = {joint.name: joint for joint in urdf.joints}
        joints = [by_name[joint] for joint in self.joint_names]
        self.joint_units = tuple("m" if joint.kind == "prismatic" else "rad" for joint in joints)
        self._endless = [joint.kind == "continuous" for joint in joints]
        self.limits = _limits(joints)
        self.armature = read_only(np.array([joint.armature for joint in joints]))
        model.armature[self.nb :] = self.armature
        for foot in self.feet:
            self.check_frame(foot)
        self.configurations = {}
        self.q0 = read_only(self.posed({}))

    def to_pinocchio(self, q: Vec) -> Vec:
        """``q`` (nq,) as Pinocchio's own reading of the robot has it: a joint without end is its cosine and its sine.

        Joints come in the same order, and velocities are the same. A planar base is x, y, cosine and sine there, as of
        ``pinocchio.JointModelPlanar`` (whose velocity is in the base's axes).

        Raises:
            InvalidInput: a wrong size, NaN.
        """
        q, first = checks.array("q", q, (self.nq,)), self.nq - self.nj
        joints = zip(q[first:], self._endless, strict=True)
        return np.array([*q[:first], *(y for x, turns in joints for y in ((np.cos(x), np.sin(x)) if turns else (x,)))])

    def from_pinocchio(self, q: Vec) -> Vec:
        """The configuration (nq,) that Pinocchio's own reading of the robot has as ``q``: angles in (−π, π].

        Raises:
            InvalidInput: a wrong size, NaN.

        Example:
            >>> from wbc.models import load
            >>> robot = load("arm", base="planar")
            >>> robot.from_pinocchio([1.0, 2.0, 0.0, 1.0, *robot.q0[3:]])[:3].round(3).tolist()
            [1.0, 2.0, 1.571]
        """
        q, first = checks.array("q", q, (self.nq + sum(self._endless),)), self.nq - self.nj
        rest = iter(q[first:].tolist())
        pairs = [(next(rest), next(rest) if turns else None) for turns in self._endless]
        return np.array([*q[:first], *(x if sine is None else np.arctan2(sine, x) for x, sine in pairs)])

    def configuration(self, joints: Mapping[str, float]) -> Vec:
        """A configuration (nq,) from joint positions by name [rad, m]; the other joints at rest.

        At rest is zero, or the middle of the limits where zero is not inside them. A floating base stands upright
        above the origin, its lowest foot on the ground; without known feet it is at the origin. Positions that look
        like degrees are warned about.

        Raises:
            UnknownJoint: with the names that are near.
            InvalidInput: a position that is not finite, or no positions by name.
        """
        what = "positions by name; configurations that have names are in robot.configurations"
        q = self.posed(checks.instance("joints", joints, Mapping, what))
        plausible.joints(self, "joints", q[self.nq - self.nj :])
        return q

    def posed(self, joints: Mapping[str, float]) -> Vec:
        """As :meth:`configuration`, without warnings.

        Raises:
            UnknownJoint, InvalidInput: as there.
        """
        q = np.concatenate([np.zeros(self.nq - self.nj), _rest(self.limits)])
        for name, position in joints.items():
            q[self.nq - self.nj + self.joint(name)] = checks.number(f"joints[{name!r}]", position)
        if self.nb:
            q[6] = 1.0
        return self.on_ground(q)

    def on_ground(self, q: Vec) -> Vec:
        """``q`` (nq,) with a floating base moved up or down until its lowest foot is at z = 0; as it is without feet.

        Example:
            >>> from wbc.models import load
            >>> robot = load("quadruped")
            >>> float(robot.on_ground(robot.configuration({"front_left_knee": -1.6}))[2].round(3))
            0.245
        """
        q = np.array(configuration(self, "q", q))
        if self.nb and self.feet:
            q[2] -= self._lowest(q)
        return q

    def replace(
        self, *, q0: ArrayLike | None = None, limits: Limits | None = None,
        configurations: Mapping[str, Vec] | None = None,
    ) -> PinocchioModel:  # fmt: skip
        """The same robot with another reference configuration, other limits or other named configurations.

        Raises:
            InvalidInput: a wrong size, NaN in ``q0``, or a quaternion that is not of length 1.

        Example:
            >>> from dataclasses import replace
            >>> from wbc.models import load
            >>> robot = load("arm")
            >>> slow = robot.replace(limits=replace(robot.limits, v_max=0.1 * robot.limits.v_max))
            >>> float(slow.limits.v_max[0] / robot.limits.v_max[0])
            0.1
        """
        other = super().replace(q0=q0, limits=limits)
        if configurations is not None:
            other.configurations = {
                name: read_only(configuration(self, f"configurations[{name!r}]", q))
                for name, q in configurations.items()
            }
        return other

    def with_masses(self, factors: Any) -> PinocchioModel:
        """A robot whose links are ``factors`` times as heavy, masses and inertias alike; a number, or one for each link
        that moves. It is no longer the one of its URDF: what a controller takes for a robot may be wrong.

        Raises:
            InvalidInput: a factor that is not positive, or another number of them.

        Example:
            >>> from wbc.models import load
            >>> robot = load("arm")
            >>> float(round(robot.with_masses(1.1).mass / robot.mass, 9))
            1.1
        """
        links = len(self.pinocchio.inertias) - 1
        scale = checks.each("factors", factors, links)
        other = copy.copy(self)
        other.pinocchio = model = self.pinocchio.copy()
        for i, factor in enumerate(scale):
            checks.number(f"factors[{i}]", factor, low=0.0, strict=True)
            old = model.inertias[i + 1]
            model.inertias[i + 1] = pin.Inertia(factor * old.mass, old.lever, factor * old.inertia)
        other.mass = float(pin.computeTotalMass(model))
        return other

    def _lowest(self, q: Vec) -> float:
        """Height of the lowest point of the feet [m]."""
        state = self.state()
        state.update(0.0, q, np.zeros(self.nv))
        frames = {foot: state.frame(foot.frame) for foot in self.feet.values()}
        return float(min(foot.lowest_in_world(at.position, at.rotation)[:, 2].min() for foot, at in frames.items()))

    def __repr__(self) -> str:
        base = f", {self.base} base" if self.base != "fixed" else ""
        loops = f", {len(self.urdf.loops)} loops" if self.urdf.loops else ""
        return f"{self.name} ({self.nj} joints{base}{loops}, {self.mass:.1f} kg)"


def _build(urdf: Urdf, base: str) -> Any:
    """The Pinocchio model; joints without end as revolute ones."""
    text = urdf.text(continuous="revolute")
    try:
        model = (
            pin.buildModelFromXML(text, pin.JointModelFreeFlyer(), root_joint(joint.name for joint in urdf.joints))
            if base == "floating"
            else pin.buildModelFromXML(text)
        )
    except (RuntimeError, ValueError) as cause:
        raise ModelError(f"{urdf.path or urdf.name}: {cause}") from None
    return model


def _limits(joints: Sequence[Joint]) -> Limits:
    given = (np.array([getattr(joint, key) for joint in joints]) for key in ("lower", "upper", "velocity", "effort"))
    return Limits(*(read_only(np.where(np.abs(x) > HUGE, np.copysign(np.inf, x), x)) for x in given))


def _rest(limits: Limits) -> Vec:
    """Zero inside the limits, else the middle of the limits."""
    low, high = finite_interval(limits, np.ones_like(limits.q_min))
    return np.where((low < 0) & (high > 0), 0.0, (low + high) / 2)
