"""Retargeting: a stack at the velocity level, to convergence in every frame of a motion.

In frame k, from the configuration of the frame before, Gauss-Newton steps of

    min ½ Σ w ‖J δ − e‖²    subject to   contacts that hold do not move,  q_low <= q <= q_high,  shapes stay apart

where q_low and q_high are what position, speed and acceleration limits leave of one frame's step:

    q_k = q_{k−1} + T v_k,   |v_k| <= v_max,   |v_k − v_{k−1}| <= a_max T,   q_min <= q_k <= q_max
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, final

import numpy as np
import pinocchio

from wbc.control.controller import Controller
from wbc.models.model import RobotState
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.body import SIDES
from wbc.motion.mapping import Table
from wbc.motion.targets import Targets
from wbc.stack.component import Schedule
from wbc.stack.contact import Anchor, Contact
from wbc.stack.formulation import VelocityLevel
from wbc.stack.overrides import Overrides
from wbc.stack.stack import Stack
from wbc.tasks import (
    CollisionAvoidance,
    Damping,
    Frame,
    HalfSpaceLimit,
    JointPositionLimits,
    Point,
    Position,
    Posture,
    Samples,
    feet,
)
from wbc.tolerances import SAME
from wbc.types import Mat, Vec

#: A step is a tick of this length [s] in which tasks are asked for all of their error.
_DT = 1e-2
#: Steps of a frame at most, and steps shorter than this [rad, m] end it.
_STEPS, _SHORT = 12, 3e-4
#: Weight on short steps, and on staying near the reference configuration [1/rad²].
_STAY, _NEAR = 1e-4, 3e-4
#: Friction of a hand that holds, and how far shapes are kept apart [m].
HAND_FRICTION = 0.6
_MARGIN = 0.005
_NOTHING = Overrides()


@final
class _Frames(Schedule):
    """What of a stack changes from frame to frame: which contacts hold, and the joint positions within reach."""

    def __init__(self, names: Iterable[str], sets: Iterable[frozenset[str]]) -> None:
        super().__init__(name="frames of the motion")
        self.names, self._sets = tuple(names), frozenset(sets)
        self._now, self._bounds = frozenset[str](), _NOTHING

    def contact_sets(self) -> Iterable[Iterable[str]]:
        return self._sets

    def contacts(self, state: RobotState, last: object) -> Iterable[str]:
        return self._now

    def before(self, state: RobotState, last: Any, plan: Any) -> Overrides:
        return self._bounds

    def use(self, held: frozenset[str], positions: tuple[Vec, Vec] | None) -> None:
        """From the next tick on."""
        self._now, self._bounds = held, _NOTHING if positions is None else Overrides(position=positions)


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
        tasks: list[Any] = []
        for part, one in table.followers.items():
            turns = one.orientation if part in targets.turned else 0.0
            if turns > 0.0:
                poses = np.tile(np.eye(4), (len(targets.places[part]), 1, 1))
                poses[:, :3, :3], poses[:, :3, 3] = targets.turned[part], targets.places[part]
                samples, weights = Samples([*poses], period=self._period), {"orientation_weight": turns}
                weights["position_weight"] = one.position
                tasks.append(Frame(one.frame, target=samples, rate=1.0 / _DT, name=part, **weights))
            elif one.position > 0.0:
                samples = Samples(targets.places[part], period=self._period)
                tasks.append(Position(one.frame, target=samples, rate=1.0 / _DT, weight=one.position, name=part))
        near = Posture(robot.q0, weight=_NEAR, rate=1.0 / _DT, name="reference")
        self.contacts = self._contacts = _contacts(robot, table, targets)
        self.held = [
            frozenset(one.name for part, one in self._contacts.items() if targets.holds[part][k])
            for k in range(len(targets.holds["left_foot"]))
        ]
        self._schedule = _Frames([one.name for one in self._contacts.values()], self.held)
        limits: list[Any] = [JointPositionLimits()]
        limits += [
            HalfSpaceLimit(table.followers[f"{side}_wrist"].frame, normal=[0.0, 0.0, 1.0], offset=0.0) for side in SIDES
        ]
        if collisions:
            limits.append(CollisionAvoidance(margin=_MARGIN, reach=0.05, rate=1.0 / _DT))
        stack = Stack(
            [*tasks, Damping(weight=_STAY), near], subject_to=limits, contacts=list(self._contacts.values()),
            components=[self._schedule],
        )  # fmt: skip
        self._controller = Controller(robot, stack, level=VelocityLevel(lm_damping=0.0), dt=_DT)
        self._v, self._still = np.zeros(robot.nj), np.zeros(robot.nv)
        self.unsolved: list[int] = []
        self.steps = 0

    def frames(self, count: int, progress: Callable[[float], None]) -> Mat:
        """Configurations (count, nq) of frames, from the reference configuration at the pelvis of the first."""
        turned, places = self._targets.turned["pelvis"], self._targets.places["pelvis"]
        found, q = np.empty((count, self._robot.nq)), np.array(self._robot.q0)
        q[:7] = pinocchio.SE3ToXYZQUAT(pinocchio.SE3(turned[0], places[0]))
        for k in range(count):
            found[k] = q = self.frame(k, q)
            progress((k + 1) / count)
        return found

    def frame(self, k: int, q: Vec) -> Vec:
        """The configuration (nq,) of frame k, from that of the frame before; of frame 0 from any.

        Most frames keep the limits of speed and acceleration by themselves; those that do not are found once more,
        with joint positions within what the limits leave.
        """
        low, high = self._within_reach(q[7:])
        self._aim(k)
        self._schedule.use(self.held[k], None)
        found, ok = self._converged(k, q)
        if k and ((found[7:] < low - SAME) | (found[7:] > high + SAME)).any():
            self._schedule.use(self.held[k], (low, high))
            found, ok = self._converged(k, q)
        if not ok:
            self.unsolved.append(k)
        self._v = (found[7:] - q[7:]) / self._period if k else self._v
        return found

    def _within_reach(self, joints: Vec) -> tuple[Vec, Vec]:
        """Joint positions (nj,) between which the next frame is."""
        limits, T = self._robot.limits, self._period
        least = np.maximum(-limits.v_max, self._v - self._acceleration * T)
        most = np.minimum(limits.v_max, self._v + self._acceleration * T)
        near = np.clip(joints, limits.q_min, limits.q_max)
        low = np.clip(near + T * least, limits.q_min, limits.q_max)  # a joint that comes too fast to its limit stops
        return low, np.maximum(np.clip(near + T * most, limits.q_min, limits.q_max), low)

    def _converged(self, k: int, q: Vec) -> tuple[Vec, bool]:
        """Where steps from q (nq,) end, and whether the last one was solved."""
        for _ in range(_STEPS if k else 10 * _STEPS):
            command = self._controller.tick(k * self._period, q, self._still)
            q = command.q
            self.steps += 1
            if float(np.abs(command.v).max()) * _DT < _SHORT:
                break
        return q, command.status.ok

    def _aim(self, k: int) -> None:
        """Contacts that begin are held where they are to be; tasks know their targets by the time."""
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
