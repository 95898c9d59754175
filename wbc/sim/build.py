"""From a robot's description to a physics model: free joint, floor, feet, torque actuators. No meshes, no pictures.

Masses and inertias are the file's, to the bit: links that do not move are not fused (fusing drops the mass of a
floating base's root), inertias are not balanced, feet weigh nothing. Only the feet touch the floor. Where a link has an
inertia that the engine refuses, the sum over all that is fixed together is the file's (see :mod:`wbc.sim.lumping`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wbc.errors import SimulationError, UnknownFrame
from wbc.models.pinocchio_ import PinocchioModel
from wbc.models.urdf import Urdf
from wbc.sim.drives import PositionDrives
from wbc.sim.engine import PhysicsSettings, mujoco
from wbc.sim.footprint import SOLE_HALF_THICKNESS, Footprint
from wbc.sim.lumping import acceptable, lumped, restore
from wbc.sim.welds import Weld, add_welds

_COMPILER = (
    '<mujoco><compiler fusestatic="false" balanceinertia="false" discardvisual="false" strippath="false"/></mujoco>'
)
FLOOR, _WORLD = "floor", "world"

#: Position limits beyond this [rad, m] are no limits.
_ENDLESS = 1e20


def build_model(
    robot: PinocchioModel,
    feet: Sequence[Footprint],
    settings: PhysicsSettings,
    *,
    timestep: float,
    floor: float,
    joined: Sequence[Weld] = (),
    drives: PositionDrives | None = None,
) -> Any:
    """The compiled ``mujoco.MjModel``; each foot is a geometry group named ``<contact>/<k>``.

    Raises:
        SimulationError: MuJoCo refuses the robot, or a joint has no torque limit that an actuator could have.
        UnknownFrame: a contact or a weld on a frame that is not a link.
    """
    mj = mujoco()
    own = robot.urdf.off_plane() if robot.base == "planar" else robot.urdf
    if robot.base != "fixed" or any(joint.child == _WORLD for joint in own.joints):
        own = _apart(own)
    as_it_is = _compiles(mj, own)
    if not as_it_is:
        own = lumped(own)
    try:
        spec = mj.MjSpec.from_string(_text(own if as_it_is else acceptable(own)))
    except ValueError as cause:
        raise SimulationError(f"MuJoCo cannot read {robot.name}: {cause}") from cause
    if robot.nb:
        spec.worldbody.first_body().add_freejoint()
    if robot.base == "planar":
        _add_plane(mj, spec, robot.urdf)
    _set_options(mj, spec.option, settings, timestep)
    _add_floor_and_feet(mj, spec, feet, settings, floor)
    _set_joints(mj, spec, robot, settings)
    if drives is not None:
        _set_drives(mj, spec, robot, drives)
    add_welds(spec, joined, settings)
    try:
        physics = spec.compile()
    except ValueError as cause:
        raise SimulationError(f"MuJoCo cannot build {robot.name}: {cause}") from cause
    if not as_it_is:
        restore(physics, own)
    return physics


def _apart(urdf: Urdf) -> Urdf:
    """``urdf`` with another name for a link called world, which MuJoCo takes for its own world, where nothing moves."""

    def named(link: str) -> str:
        return f"{_WORLD}_of_{urdf.name}" if link == _WORLD else link

    links = (replace(link, name=named(link.name)) for link in urdf.links)
    joints = (replace(joint, parent=named(joint.parent), child=named(joint.child)) for joint in urdf.joints)
    return replace(urdf, links=tuple(links), joints=tuple(joints))


def _text(urdf: Urdf) -> str:
    return urdf.text(continuous="revolute").replace("</robot>", _COMPILER + "</robot>")


def _compiles(mj: Any, urdf: Urdf) -> bool:
    try:
        mj.MjSpec.from_string(_text(urdf)).compile()
    except ValueError:
        return False
    return True


def _add_plane(mj: Any, spec: Any, urdf: Urdf) -> None:
    spec.worldbody.first_body().pos = urdf.joints[0].origin.xyz
    for joint in urdf.joints[:3]:
        kind = mj.mjtJoint.mjJNT_SLIDE if joint.kind == "prismatic" else mj.mjtJoint.mjJNT_HINGE
        spec.worldbody.first_body().add_joint(name=joint.name, type=kind, axis=joint.axis)


def _set_options(mj: Any, option: Any, settings: PhysicsSettings, timestep: float) -> None:
    option.timestep = timestep
    option.integrator = getattr(mj.mjtIntegrator, "mjINT_" + settings.integrator.upper())
    option.cone = mj.mjtCone.mjCONE_ELLIPTIC
    option.impratio = settings.impratio
    option.iterations = settings.solver_iterations
    # A state that runs away is an error here, not a silent new beginning at the reference pose.
    option.disableflags |= mj.mjtDisableBit.mjDSBL_AUTORESET


def _add_floor_and_feet(mj: Any, spec: Any, feet: Sequence[Footprint], settings: PhysicsSettings, floor: float) -> None:
    contact = {"condim": 3, "solref": list(settings.solref), "solimp": list(settings.solimp)}
    spec.worldbody.add_geom(
        name=FLOOR, type=mj.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, floor], contype=1, conaffinity=2, **contact
    )
    for foot in feet:
        body = spec.body(foot.link)
        if body is None or body.name == _WORLD:
            raise UnknownFrame(foot.link, [b.name for b in spec.bodies[1:]], "a contact must be on a link")
        # Priority: the friction of a foot is the foot's, whatever the floor's default says.
        common = {"contype": 2, "conaffinity": 1, "mass": 0.0, "priority": 1, "friction": [foot.friction, 0, 0]}
        for k, (centre, radius) in enumerate(foot.balls):
            body.add_geom(
                name=f"{foot.name}/{k}",
                type=mj.mjtGeom.mjGEOM_SPHERE,
                pos=centre,
                size=[radius, 0, 0],
                **common,
                **contact,
            )
        if not foot.balls:
            assert foot.half_size is not None, "a footprint is a rectangle or has balls"
            centre = foot.origin + foot.rotation @ [0.0, 0.0, SOLE_HALF_THICKNESS]
            quaternion = np.zeros(4)
            mj.mju_mat2Quat(quaternion, foot.rotation.ravel())
            body.add_geom(
                name=f"{foot.name}/0", type=mj.mjtGeom.mjGEOM_BOX, pos=centre, quat=quaternion,
                size=[*foot.half_size, SOLE_HALF_THICKNESS], **common, **contact,
            )  # fmt: skip


def _set_joints(mj: Any, spec: Any, robot: PinocchioModel, settings: PhysicsSettings) -> None:
    limits = robot.limits
    for i, name in enumerate(robot.joint_names):
        joint, effort = spec.joint(name), float(limits.tau_max[i])
        if joint is None:
            raise SimulationError(f"MuJoCo has no joint {name!r}, which {robot.name} has")
        if not effort >= 0:
            raise SimulationError(f"joint {name!r} has a torque limit of {effort:g}: no actuator has such a limit")
        stops = settings.joint_stops and -_ENDLESS < limits.q_min[i] < limits.q_max[i] < _ENDLESS
        joint.limited = stops
        joint.range = [limits.q_min[i], limits.q_max[i]] if stops else [0.0, 0.0]
        joint.solref_limit, joint.solimp_limit = list(settings.solref), list(settings.solimp)
        joint.actfrclimited = False  # the actuator has the limit, once
        joint.armature = settings.armature + float(robot.armature[i])
        if settings.joint_friction != "urdf":
            joint.frictionloss = settings.joint_friction
        if settings.joint_damping != "urdf":
            joint.damping = settings.joint_damping * np.eye(1, 3)[0]
        motor = spec.add_actuator(name=name, target=name, trntype=mj.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.gear = (effort > 0) * np.eye(1, 6)[0]  # a joint without torque is passive: whatever is commanded, nothing
        motor.ctrllimited = 0 < effort < _ENDLESS
        motor.ctrlrange = [-effort, effort] if motor.ctrllimited else [0.0, 0.0]


def _set_drives(mj: Any, spec: Any, robot: PinocchioModel, drives: PositionDrives) -> None:
    """Motors become drives: force = control − K q − D q̇ is cut, not the control, which is then K q* + D q̇* + τ*."""
    stiffness, damping = drives.gains(robot)
    for motor, k, d in zip(spec.actuators, stiffness, damping, strict=True):
        motor.biastype = mj.mjtBias.mjBIAS_AFFINE
        motor.biasprm = [0.0, -k, -d, *[0.0] * (len(motor.biasprm) - 3)]
        motor.forcelimited, motor.forcerange = motor.ctrllimited, np.array(motor.ctrlrange)
        motor.ctrllimited, motor.ctrlrange = False, [0.0, 0.0]
