"""Retargeting: a stack at the velocity level, to convergence in every frame of a motion.

In frame k, from the configuration of the frame before, Gauss-Newton steps of

    min ½ Σ w ‖J δ − e‖²    subject to   contacts that hold do not move,  q_low <= q <= q_high,  shapes stay apart

where q_low and q_high are what position, speed and acceleration limits leave of one frame's step:

    q_k = q_{k−1} + T v_k,   |v_k| <= v_max,   |v_k − v_{k−1}| <= a_max T,   q_min <= q_k <= q_max
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, final

import numpy as np
import pinocchio

from wbc.control.command import Command
from wbc.control.controller import Controller
from wbc.models.model import RobotState
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.body import SIDES
from wbc.motion.mapping import Table
from wbc.motion.targets import Targets
from wbc.stack.contact import Anchor, Contact
from wbc.stack.formulation import VelocityLevel
from wbc.stack.overrides import Overrides
from wbc.stack.schedule import Schedule
from wbc.stack.stack import Stack
from wbc.tasks import (
    CollisionAvoidance,
    Frame,
    HalfSpaceLimit,
    JointPositionLimits,
    Orientation,
    Point,
    Position,
    Posture,
    feet,
)
from wbc.types import Mat, Vec

#: A step is a tick of this length [s] in which tasks are asked for all of their error.
_DT = 1e-2
#: Steps of a frame at most, and steps shorter than this [rad, m] end it.
_STEPS, _SHORT = 12, 1e-4
_SETTLE = 30
#: Weight on staying near the joint positions of the frame before, and of the reference configuration [1/rad²].
_STAY, _NEAR = 3e-3, 1e-4
#: Friction of a hand that holds, and how far shapes are kept apart [m].
HAND_FRICTION = 0.6
_MARGIN = 0.005


@final
class _Frames(Schedule):
    """What of a stack changes from frame to frame: which contacts hold, and the joint positions within reach."""

    def __init__(self, names: Iterable[str], sets: Iterable[frozenset[str]]) -> None:
        super().__init__(name="frames of the motion")
        self.names, self._sets = tuple(names), frozenset(sets)
        self._now, self._bounds = frozenset[str](), Overrides()

    def contact_sets(self) -> Iterable[Iterable[str]]:
        return self._sets

    def contacts(self, state: RobotState, last: object) -> Iterable[str]:
        return self._now

    def before(self, state: RobotState, last: Any, plan: Any) -> Overrides:
        return self._bounds

    def use(self, held: frozenset[str], low: Vec, high: Vec) -> None:
        """From the next tick on."""
        self._now, self._bounds = held, Overrides(position=(low, high))


@final
class Retargeting:
    """The stack of a robot and a mapping, and the frames it has come to.

    Args:
        acceleration: limit on joint accelerations from frame to frame [rad/s²]; None: none.
        collisions: whether shapes of the robot are kept apart.
    """

    def __init__(
        self, robot: PinocchioModel, table: Table, targets: Targets, *, rate: float, acceleration: float | None,
        collisions: bool,
    ) -> None:  # fmt: skip
        self._robot, self._targets, self._period = robot, targets, 1.0 / rate
        self._acceleration = np.inf if acceleration is None else acceleration
        self._tasks: dict[str, Frame | Position | Orientation] = {}
        for part, one in table.followers.items():
            turns = one.orientation > 0.0 and part in targets.turned
            if one.position > 0.0 and turns:
                weights = {"position_weight": one.position, "orientation_weight": one.orientation}
                self._tasks[part] = Frame(one.frame, target=np.eye(4), rate=1.0 / _DT, name=part, **weights)
            elif one.position > 0.0:
                self._tasks[part] = Position(
                    one.frame, target=np.zeros(3), rate=1.0 / _DT, weight=one.position, name=part
                )
            elif turns:
                self._tasks[part] = Orientation(one.frame, rate=1.0 / _DT, weight=one.orientation, name=part)
        self._stay = Posture(robot.q0, weight=_STAY, rate=1.0 / _DT, name="stay")
        near = Posture(robot.q0, weight=_NEAR, rate=1.0 / _DT, name="reference")
        self.contacts = self._contacts = _contacts(robot, table, targets)
        self.held = [
            frozenset(one.name for part, one in self._contacts.items() if targets.holds[part][k])
            for k in range(len(targets.holds["left_foot"]))
        ]
        self._frames = _Frames([one.name for one in self._contacts.values()], self.held)
        limits: list[Any] = [JointPositionLimits()]
        limits += [
            HalfSpaceLimit(table.followers[f"{side}_wrist"].frame, normal=[0.0, 0.0, 1.0], offset=0.0) for side in SIDES
        ]
        if collisions:
            limits.append(CollisionAvoidance(margin=_MARGIN, reach=0.05, rate=1.0 / _DT))
        stack = Stack(
            [*self._tasks.values(), self._stay, near], subject_to=limits, contacts=list(self._contacts.values()),
            components=[self._frames],
        )  # fmt: skip
        self._controller = Controller(robot, stack, level=VelocityLevel(lm_damping=0.0), dt=_DT)
        self._v = np.zeros(robot.nj)
        self.unsolved: list[int] = []
        self.steps = 0

    def first(self) -> Vec:
        """A configuration to begin with: the reference configuration at the pelvis of the first frame."""
        q = np.array(self._robot.q0)
        q[:7] = pinocchio.SE3ToXYZQUAT(
            pinocchio.SE3(self._targets.turned["pelvis"][0], self._targets.places["pelvis"][0])
        )
        return q

    def frame(self, k: int, q: Vec) -> Vec:
        """The configuration (nq,) of frame k, from that of the frame before; of frame 0 from any."""
        robot, joints = self._robot, slice(7, None)
        low, high = robot.limits.q_min.copy(), robot.limits.q_max.copy()
        if k:
            v_max = robot.limits.v_max
            least = np.maximum(-v_max, self._v - self._acceleration * self._period)
            most = np.minimum(v_max, self._v + self._acceleration * self._period)
            near = np.clip(q[joints], low, high)
            # A joint that comes too fast to its limit stops there.
            low, high = (
                np.minimum(np.maximum(low, near + self._period * least), high),
                np.maximum(np.minimum(high, near + self._period * most), low),
            )
        self._aim(k, q)
        self._frames.use(self.held[k], low, high)
        before, still = q, np.zeros(robot.nv)
        command: Command | None = None
        for _ in range(_STEPS if k else 10 * _STEPS):
            command = self._controller.tick(k * self._period, q, still)
            q = command.q
            self.steps += 1
            if float(np.abs(command.v).max()) * _DT < _SHORT:
                break
        assert command is not None, "there is a step"
        if not command.status.ok:
            self.unsolved.append(k)
        self._v = (q[joints] - before[joints]) / self._period if k else np.zeros(robot.nj)
        return q

    def _aim(self, k: int, q: Vec) -> None:
        places, turned = self._targets.places, self._targets.turned
        for part, task in self._tasks.items():
            match task:
                case Frame():
                    pose = np.eye(4)
                    pose[:3, :3], pose[:3, 3] = turned[part][k], places[part][k]
                    task.target = pose
                case Position():
                    task.target = places[part][k]
                case Orientation():
                    task.target = turned[part][k]
        self._stay.target = q
        for part, contact in self._contacts.items():
            held = self._targets.holds[part]
            if held[k] and (k == 0 or not held[k - 1]):
                place = self._targets.places[part][k]
                contact.target = place if contact.dim == 3 else self._sole(contact, part, k)

    def _sole(self, contact: Contact, part: str, k: int) -> Anchor:
        origin = self._robot.feet[contact.frame].origin
        rotation = self._targets.turned[part][k]
        return Anchor(rotation, self._targets.places[part][k] + rotation @ np.array(origin))


def _contacts(robot: PinocchioModel, table: Table, targets: Targets) -> dict[str, Contact]:
    """Soles of the feet, and a point for a hand that holds in the motion; deadbeat where velocities are decided."""
    gains: Any = {"kp": 1.0 / _DT**2, "kd": 1.0 / _DT}
    soles = {contact.frame: contact for contact in feet(robot, **gains)}
    found = {f"{side}_foot": soles[table.followers[f"{side}_foot"].frame] for side in SIDES}
    for wrist in (f"{side}_wrist" for side in SIDES if targets.holds[f"{side}_wrist"].any()):
        found[wrist] = Point(table.followers[wrist].frame, friction=HAND_FRICTION, **gains)
    return found


def all_frames(retargeting: Retargeting, count: int, progress: Any) -> Mat:
    """Configurations (count, nq) of all frames."""
    q = retargeting.first()
    for _ in range(_SETTLE):  # staying where the robot was must not count in the first frame
        last, q = q, retargeting.frame(0, q)
        if float(np.abs(q - last).max()) < _SHORT:
            break
    found = np.empty((count, len(q)))
    for k in range(count):
        found[k] = q = retargeting.frame(k, q)
        progress((k + 1) / count)
    return found
