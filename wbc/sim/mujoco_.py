"""MujocoPlant: the robot of the same URDF in rigid-body physics, standing on its declared contacts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, UnknownFrame
from wbc.models.model import RobotModel
from wbc.models.pinocchio_ import PinocchioModel
from wbc.sim.agreement import check_agreement
from wbc.sim.bridge import Bridge
from wbc.sim.build import build_model
from wbc.sim.contact_truth import ContactTruth
from wbc.sim.drives import PositionDrives
from wbc.sim.engine import PhysicsSettings, mujoco
from wbc.sim.footprint import footprints
from wbc.sim.plant import Drive, Plant, finite, whole
from wbc.sim.welds import weld_forces, welds
from wbc.stack.contact import Contact
from wbc.types import Mat, Vec

#: A robot has fallen when its base leans by more than this against the start [rad] …
FALL_TILT = np.pi / 4
#: … or has lost more than this share of its height.
FALL_DROP = 0.4
#: Of a joint whose brake is set [N m s/rad, N s/m]: 100 N m turn it by a milliradian in a second.
BRAKE_DAMPING = 1e5
#: No robot sinks deeper than this into the floor it stands on [m].
MOST_SINKING = 0.02

SOLE_GEOMETRIES = ("box", "spheres")


@final
class MujocoPlant(Plant):
    """A robot in MuJoCo, its joints driven by torques or by drives that follow positions.

    Built from the robot's own URDF and compared with the model before the first step: total mass, inertia matrix,
    bias and free acceleration at random states. Each contact of ``contacts`` (a stack's) becomes a foot on a flat
    floor: a box for a sole, a ball for a point, two balls for an edge; nothing else collides. A loop closure of all six
    rows becomes a weld. Torques are clipped to the joints' limits; a joint whose limit
    is zero is passive.

    Args:
        robot: from :func:`wbc.load`.
        contacts: what stands on the floor; none for an arm.
        friction: of the feet on the floor; default: each contact's own coefficient.
        dt: time between commands [s], in ``substeps`` equal physics steps.
        settings: how the engine is set.
        sole_geometry: "box", or "spheres": the balls of the robot's description, or one at each corner.
        floor: its height [m].
        drives: they follow the commanded positions; None: the plant takes torques.

    Raises:
        SimulationError: mujoco is not installed, cannot build the robot, or is not the same robot as the model.
        InvalidInput: a robot that is not from a URDF, an argument out of range, drives for another robot.
        NotSupported: a contact that physics cannot build, such as ``task.with_reaction()`` or one on a slope.
        UnknownFrame: a contact on a frame that is not a link.

    Example:
        >>> import wbc
        >>> from wbc.sim.mujoco_ import MujocoPlant
        >>> plant = MujocoPlant(wbc.load("arm"))
        >>> plant.reset(plant.model.q0)
        >>> plant.settings()["cone"]
        'elliptic'
    """

    def __init__(
        self,
        robot: RobotModel,
        *,
        contacts: Iterable[Contact] = (),
        friction: float | None = None,
        dt: float = 1e-3,
        substeps: int = 1,
        settings: PhysicsSettings | None = None,
        sole_geometry: str = "box",
        floor: float = 0.0,
        drives: PositionDrives | None = None,
    ) -> None:
        if not isinstance(robot, PinocchioModel):
            raise InvalidInput(
                f"robot is a {type(robot).__name__}; physics needs one that wbc.load made from a URDF or MJCF"
            )
        super().__init__(robot, dt)
        self.substeps = whole("substeps", substeps)
        settings = PhysicsSettings() if settings is None else settings
        self.physics_settings = checks.instance("settings", settings, PhysicsSettings, "a PhysicsSettings")
        self.sole_geometry = checks.one_of("sole_geometry", sole_geometry, SOLE_GEOMETRIES)
        self.floor = checks.number("floor", floor)
        self.drives = drives
        if drives is not None:
            checks.instance("drives", drives, PositionDrives, "a PositionDrives")
            self.takes = "position"
            self._stiffness, self._damping_gain = drives.gains(robot)
        contacts = checks.items("contacts", contacts, "each a contact")
        for contact in contacts:
            checks.instance("an entry of contacts", contact, Contact, "a contact")
        on_floor = [contact for contact in contacts if contact.carrier is None]
        self.feet = footprints(on_floor, robot, friction=friction, balls=sole_geometry == "spheres")
        self.joined = welds(contacts, robot)
        self._mj = mujoco()
        self.physics = build_model(
            robot, self.feet, self.physics_settings, timestep=self.dt / self.substeps, floor=self.floor,
            joined=self.joined, drives=drives,
        )  # fmt: skip
        self._bridge = Bridge(robot, self.physics)
        self.agreement = check_agreement(robot, self.physics, self._bridge)
        self.data = self._mj.MjData(self.physics)
        self._masses = _Masses(self._mj, self.physics)
        self._contacts = ContactTruth(self.physics, self.feet, robot.weight)
        self._pushes: list[tuple[int, Vec]] = []
        self._damping = self.physics.dof_damping.copy()
        self.reset(robot.q0)

    # ---- where the robot is
    @property
    def fallen(self) -> bool:
        """True if the base leans by more than 45° against the start, or has lost more than 40 % of its height."""
        if not self.model.nb:
            return False
        height = self._q[2] - self.floor
        return bool(_up(self._q) @ self._upright < np.cos(FALL_TILT) or height < (1.0 - FALL_DROP) * self._height)

    def missing(self, contacts: Iterable[Contact]) -> list[str]:
        """Names of the ``contacts`` for which this plant was given neither a foot nor a weld."""
        touching = {foot.link for foot in self.feet} | {weld.link for weld in self.joined}
        return [contact.name for contact in contacts if contact.frame not in touching]

    def on_floor(self, q: Vec) -> Vec:
        """``q`` (nq,) with the base moved up or down until the lowest foot touches the floor.

        Raises:
            InvalidInput: a robot without floating base or without contacts, or a wrong q.
        """
        if not self.model.nb or not self.feet:
            raise InvalidInput("only a floating base with contacts can be put on the floor")
        q = checks.array("q", q, (self.model.nq,))
        state = self.model.state()
        state.update(0.0, q, np.zeros(self.model.nv))
        placed = [(foot, state.frame(foot.link)) for foot in self.feet]
        q[2] += self.floor - min(foot.lowest(frame.rotation, frame.position) for foot, frame in placed)
        return q

    def settled(self, q: Vec) -> Vec:
        """``q`` (nq,) with the base where the feet carry the robot's weight at rest: it starts standing, not landing.

        The plant is left there.

        Raises:
            InvalidInput: as :meth:`on_floor`.
        """
        q = self.on_floor(q)
        touching, weight = q[2], self.model.weight
        sunk, above = touching - MOST_SINKING, touching
        for _ in range(50):  # halves of 2 cm down to rounding
            q[2] = 0.5 * (sunk + above)
            self.reset(q)
            if self._resting_force() > weight:
                sunk = q[2]
            else:
                above = q[2]
        return q

    def _resting_force(self) -> float:
        """Sum of the normal forces that the feet's penetration gives when nothing accelerates [N]."""
        mj, physics, data = self._mj, self.physics, self.data
        data.qacc[:] = 0.0
        mj.mj_inverse(physics, data)
        force, total = np.zeros(6), 0.0
        for i in range(data.ncon):
            mj.mj_contactForce(physics, data, i, force)
            total += force[0]
        return total

    def _place(self, q: Vec, v: Vec) -> None:
        self._masses.restore()
        self.physics.dof_damping[:] = self._damping
        self._mj.mj_resetData(self.physics, self.data)
        self._bridge.write(self.data, q, v)
        self._mj.mj_forward(self.physics, self.data)
        self._contacts.restart()
        self._pushes.clear()
        if self.model.nb:
            self._upright, self._height = _up(q), float(q[2] - self.floor)

    # ---- one step
    def _advance(self, command: Drive) -> tuple[Vec, Vec]:
        mj, physics, data = self._mj, self.physics, self.data
        self._bridge.write_torques(data, self._controls(command))
        data.xfrc_applied[:] = 0.0
        for body, force in self._pushes:
            data.xfrc_applied[body, :3] += force
        self._pushes.clear()
        self._contacts.begin_step()
        for _ in range(self.substeps):
            # The forces belong to the state before the step, and data still holds where they acted after it.
            mj.mj_step(physics, data)
            self._contacts.add(data, physics.opt.timestep, 1.0 / self.substeps)
        data.qfrc_applied[:] = 0.0
        return self._bridge.read(data)

    def _controls(self, command: Drive) -> Vec:
        """What the actuators get (nj,): torques, or what makes drives follow (:func:`wbc.sim.build.build_model`)."""
        if self.drives is None:
            return finite("command.tau", command.tau, self.t)
        model = self.model
        q, v = finite("command.q", command.q, self.t), finite("command.v", command.v, self.t)
        controls: Vec = self._stiffness * q[model.nq - model.nj :] + self._damping_gain * v[model.nb :]
        if self.drives.feed_forward and not np.isnan(command.tau).all():
            controls += finite("command.tau", command.tau, self.t)
        return controls

    def push(self, frame: str, force: Vec) -> None:
        force = checks.array("force", force, (3,))
        self._pushes.append((self._body(frame), force))
        self._pushed = self._pushed + force

    def push_joints(self, tau: Vec) -> None:
        for joint, torque in enumerate(checks.array("tau", tau, (self.model.nj,))):
            self.data.qfrc_applied[self._bridge.velocity_index(joint)] += torque

    def add_mass(self, frame: str, mass: float) -> None:
        self._masses.add(self._body(frame), checks.number("mass", mass, low=0.0))

    def brake(self, joint: str) -> None:
        """Set the brake of ``joint`` until the next ``reset``: it stops within the step and stays where it is.

        Raises:
            UnknownJoint: with the names that are near.
        """
        self.physics.dof_damping[self._bridge.velocity_index(self.model.joint(joint))] = BRAKE_DAMPING

    def _body(self, frame: str) -> int:
        mj = self._mj
        body = mj.mj_name2id(self.physics, mj.mjtObj.mjOBJ_BODY, checks.text("frame", frame))
        if body <= 0:
            names = (mj.mj_id2name(self.physics, mj.mjtObj.mjOBJ_BODY, i) for i in range(1, self.physics.nbody))
            raise UnknownFrame(frame, names, "physics knows the robot's links")
        return int(body)

    # ---- what others read
    def wrenches(self) -> Mapping[str, Vec]:
        """What force sensors in the feet measured in the last step, by link: the mean wrench (6,) on the robot, force
        [N] before moment [N m] about the link's origin at the step's start, world axes; zero before the first step."""
        return {foot.link: self._contacts.measured[i].copy() for i, foot in enumerate(self.feet)}

    def truth(self) -> Mapping[str, Vec | float]:
        """``plant.f.<contact>`` (6,), ``plant.slip.<contact>`` (2,) and ``plant.penetration.<contact>`` of the step; of
        a weld ``plant.f.<contact>`` (3,), the force alone, in the carrier's axes; of drives their torques at its end,
        ``plant.tau`` (nj,)."""
        columns: dict[str, Vec | float] = {}
        for i, foot in enumerate(self.feet):
            columns[f"plant.f.{foot.name}"] = self._contacts.wrench[i]
            columns[f"plant.slip.{foot.name}"] = self._contacts.slip[i]
            columns[f"plant.penetration.{foot.name}"] = float(self._contacts.penetration[i])
        for name, force in weld_forces(self.physics, self.data, self.joined).items():
            columns[f"plant.f.{name}"] = force
        if self.drives is not None:
            columns["plant.tau"] = self._bridge.read_torques(self.data)
        return columns

    def settings(self) -> dict[str, Any]:
        return {
            **super().settings(),
            "engine": f"MuJoCo {self._mj.__version__}",
            "substeps": self.substeps,
            **self.physics_settings.as_dict(),
            "sole_geometry": self.sole_geometry,
            "floor": self.floor,
            "friction": {foot.name: foot.friction for foot in self.feet},
            "drives": None if self.drives is None else self.drives.as_dict(self.model),
            "agreement with the model": self.agreement,
        }


def _up(q: Vec) -> Vec:
    """The world's vertical in base axes, from the quaternion x y z w."""
    x, y, z, w = q[3:7]
    return np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])


@final
class _Masses:
    """Point masses on links, and the way back."""

    def __init__(self, mj: Any, physics: Any) -> None:
        self._mj, self._physics = mj, physics
        self._arrays = [physics.body_mass, physics.body_ipos, physics.body_inertia, physics.body_iquat]
        self._original = [array.copy() for array in self._arrays]
        self._changed = False

    def add(self, body: int, mass: float) -> None:
        """A point mass at the origin of the link: mass, centre and inertia of both together (parallel axes)."""
        if mass == 0.0:
            return
        physics = self._physics
        old, centre = float(physics.body_mass[body]), physics.body_ipos[body].copy()
        about_centre = self._inertia(body)
        total = old + mass
        new_centre = old / total * centre
        inertia = about_centre + _point(old, centre - new_centre) + _point(mass, new_centre)
        moments, axes = np.linalg.eigh(inertia)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        physics.body_mass[body], physics.body_ipos[body], physics.body_inertia[body] = total, new_centre, moments
        self._mj.mju_mat2Quat(physics.body_iquat[body], axes.ravel())
        self._set_constants()

    def restore(self) -> None:
        """The masses of the URDF again."""
        if self._changed:
            for array, original in zip(self._arrays, self._original, strict=True):
                array[:] = original
            self._set_constants()
            self._changed = False

    def _inertia(self, body: int) -> Mat:
        axes = np.zeros(9)
        self._mj.mju_quat2Mat(axes, self._physics.body_iquat[body])
        R = axes.reshape(3, 3)
        result: Mat = R @ np.diag(self._physics.body_inertia[body]) @ R.T
        return result

    def _set_constants(self) -> None:
        # On scratch data: the engine resets the data that it computes constants with.
        self._mj.mj_setConst(self._physics, self._mj.MjData(self._physics))
        self._changed = True


def _point(mass: float, arm: Vec) -> Mat:
    """Inertia (3, 3) of a point mass at ``arm``."""
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
