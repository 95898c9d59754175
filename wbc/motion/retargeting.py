"""retarget: the motion of a person as a motion of a robot, by a stack at the velocity level.

It is solved to convergence in every frame. In frame k, from the configuration of the frame before, Gauss-Newton steps

    min ½ Σ w ‖J δ − e‖²    subject to   contacts that hold do not move,  q_low <= q <= q_high,  shapes stay apart

where q_low and q_high are what position, speed and acceleration limits leave of one frame's step:

    q_k = q_{k−1} + T v_k,   |v_k| <= v_max,   |v_k − v_{k−1}| <= a_max T,   q_min <= q_k <= q_max
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import compress
from os import PathLike
from typing import Any, final

import numpy as np
import pinocchio

from wbc import checks, tasks
from wbc.arguments import tells_arguments
from wbc.control.controller import Controller
from wbc.errors import InvalidInput
from wbc.files import Place
from wbc.models.model import RobotState
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.clip import SIDES, Motion
from wbc.motion.mapping import Table
from wbc.motion.repair import repaired
from wbc.motion.retargeted import Retargeted
from wbc.motion.targets import anchor, targets
from wbc.motion.witness import Witness
from wbc.sim.scenario import Progress, silent
from wbc.stack.component import Schedule
from wbc.stack.contact import Contact
from wbc.stack.formulation import VelocityLevel
from wbc.stack.overrides import Overrides
from wbc.stack.stack import Stack
from wbc.tolerances import SAME
from wbc.types import Mat, Vec

#: A step is a tick of this length [s] in which tasks have to remove all of their error.
_DT = 1e-2
#: Steps of a frame at most, and steps shorter than this [rad, m] end it.
_STEPS, _SHORT = 12, 3e-4
#: Weight on short steps, and on staying near the reference configuration [1/rad²].
_STAY, _NEAR = 1e-4, 3e-4
#: Friction of a hand that holds, and how far shapes are kept apart [m].
HAND_FRICTION = 0.6
_MARGIN = 0.005


@final
class _Frames(Schedule):
    """What of a stack changes from frame to frame: which contacts hold, and the joint positions within reach."""

    def __init__(self, sets: Sequence[frozenset[str]]) -> None:
        super().__init__(name="frames of the motion")
        self._sets, self.frame = sets, 0
        self.bounds: Overrides | None = None

    def contact_sets(self) -> Iterable[Iterable[str]]:
        return set(self._sets)

    def contacts(self, state: RobotState, last: object) -> Iterable[str]:
        return self._sets[self.frame]

    def before(self, state: RobotState, last: Any, plan: Any) -> Overrides | None:
        return self.bounds


@final
class Retargeting:
    """The stack of a robot and a mapping, and the frames it has come to.

    Args:
        acceleration: limit on joint accelerations from frame to frame [rad/s²]; inf: none.
        collisions: whether shapes of the robot are kept apart.
    """

    def __init__(
        self, robot: PinocchioModel, table: Table, targets: Motion, *, acceleration: float, collisions: bool
    ) -> None:
        self._robot, self._targets, self._period = robot, targets, 1.0 / targets.rate
        self._acceleration, self._pelvis = acceleration, table.followers["pelvis"].frame
        objectives: list[Any] = []
        for part, one in table.followers.items():
            places, turns = targets.positions[part], one.orientation if part in targets.rotations else 0.0
            asked: dict[str, Any] = {"rate": 1.0 / _DT, "name": part}
            if turns > 0.0:
                poses = [pinocchio.SE3(R, p) for R, p in zip(targets.rotations[part], places, strict=True)]
                asked |= {"position_weight": one.position, "orientation_weight": turns}
                objectives.append(tasks.Frame(one.frame, target=tasks.Samples(poses, period=self._period), **asked))
            elif one.position > 0.0:
                samples = tasks.Samples(places, period=self._period)
                objectives.append(tasks.Position(one.frame, target=samples, weight=one.position, **asked))
        reference = tasks.Posture(robot.q0, weight=_NEAR, rate=1.0 / _DT, name="reference")
        objectives += [tasks.Damping(weight=_STAY), reference]
        self.contacts = _contacts(robot, table, targets)
        names, flags = [one.name for one in self.contacts.values()], [targets.contacts[part] for part in self.contacts]
        self._schedule = _Frames([frozenset(compress(names, held)) for held in zip(*flags, strict=True)])
        hands = [table.followers[f"{side}_wrist"].frame for side in SIDES]
        limits: list[Any] = [tasks.JointPositionLimits()]
        limits += [tasks.HalfSpaceLimit(hand, normal=[0.0, 0.0, 1.0], offset=0.0) for hand in hands]
        limits += [tasks.CollisionAvoidance(margin=_MARGIN, reach=0.05, rate=1.0 / _DT)] * collisions
        stack = Stack(objectives, subject_to=limits, contacts=list(self.contacts.values()), components=[self._schedule])
        self._controller = Controller(robot, stack, level=VelocityLevel(lm_damping=0.0), dt=_DT)
        self._v, self._still = np.zeros(robot.nj), np.zeros(robot.nv)
        self.unsolved: list[int] = []
        self.steps = 0

    def frames(self, progress: Callable[[float], None]) -> Mat:
        """Configurations (N, nq) of all frames, from the reference configuration at the pelvis of the first."""
        count, asked = self._targets.frames, self._targets
        found, q, state = np.empty((count, self._robot.nq)), np.array(self._robot.q0), self._robot.state()
        state.update(0.0, q, self._still)
        goal = pinocchio.SE3(asked.rotations["pelvis"][0], asked.positions["pelvis"][0])
        base = goal * state.pose(self._pelvis).inverse() * pinocchio.XYZQUATToSE3(q[:7])
        q[:7] = pinocchio.SE3ToXYZQUAT(base)
        for k in range(count):
            found[k] = q = self.frame(k, q)
            progress((k + 1) / count)
        return found

    def frame(self, k: int, q: Vec) -> Vec:
        """The configuration (nq,) of frame k, from that of the frame before; of frame 0 from any.

        Most frames keep the limits of speed and acceleration by themselves; those that do not are found once more,
        with joint positions within what the limits leave: bounds that change cost as much as the rest of a tick.
        """
        for part, contact in self.contacts.items():
            held = self._targets.contacts[part]
            if held[k] and (k == 0 or not held[k - 1]):
                contact.target = anchor(contact, self._targets, part, k)
        self._schedule.frame, self._schedule.bounds = k, None
        found, ok = self._converged(k, q)
        if k:
            low, high = self._within_reach(q[7:])
            if max((low - found[7:]).max(), (found[7:] - high).max()) > SAME:
                self._schedule.bounds = Overrides(position=(low, high))
                found, ok = self._converged(k, q)
            self._v = (found[7:] - q[7:]) / self._period
        self.unsolved += [k] * (not ok)
        return found

    def _converged(self, k: int, q: Vec) -> tuple[Vec, bool]:
        """Where steps from q (nq,) end, and whether the last one was solved."""
        for _ in range(_STEPS if k else 10 * _STEPS):
            command = self._controller.tick(k * self._period, q, self._still)
            q, self.steps = command.q, self.steps + 1
            if float(np.abs(command.v).max()) * _DT < _SHORT:
                break
        return q, command.status.ok

    def _within_reach(self, joints: Vec) -> tuple[Vec, Vec]:
        """Joint positions (nj,) between which the next frame is."""
        limits, T = self._robot.limits, self._period
        least = np.maximum(-limits.v_max, self._v - self._acceleration * T)
        most = np.minimum(limits.v_max, self._v + self._acceleration * T)
        near = joints.clip(limits.q_min, limits.q_max)
        low = (near + T * least).clip(limits.q_min, limits.q_max)  # a joint that comes too fast to its limit stops
        return low, np.maximum((near + T * most).clip(limits.q_min, limits.q_max), low)


def _contacts(robot: PinocchioModel, table: Table, targets: Motion) -> dict[str, Contact]:
    """Soles of the feet, and a point for a hand that holds in the motion; deadbeat where velocities are decided."""
    gains: Any = {"kp": 1.0 / _DT**2, "kd": 1.0 / _DT}
    soles = {contact.frame: contact for contact in tasks.feet(robot, **gains)}
    found = {f"{side}_foot": soles[table.followers[f"{side}_foot"].frame] for side in SIDES}
    for wrist in (f"{side}_wrist" for side in SIDES if targets.contacts[f"{side}_wrist"].any()):
        found[wrist] = tasks.Point(table.followers[wrist].frame, friction=HAND_FRICTION, **gains)
    return found


@tells_arguments
def retarget(
    motion: Motion | Place, robot: PinocchioModel, mapping: Table | Place | None = None, *,
    acceleration: float | None = 200.0, collisions: bool = True, repair: bool = False, progress: Progress = silent,
) -> Retargeted:  # fmt: skip
    """The motion of a person as a motion of ``robot``, with a verdict for every frame.

    The person's size is fitted to the robot's; feet that stand and hands that hold are found in the motion and do not
    slip; limits of position, speed and acceleration hold; shapes of the robot stay apart. Then inverse dynamics says of
    each frame whether forces and torques for it exist, or what is missing. Equations: this module's and
    :mod:`wbc.motion.witness`'s.

    Args:
        motion: what was read by :meth:`Motion.read`, or a file.
        robot: with a floating base and two feet.
        mapping: which frame follows which part of the body: a table, a TOML file, or by default what the library has
            for the G1, Talos and its own humanoid.
        acceleration: limit on joint accelerations [rad/s²]; None: none.
        collisions: whether the robot's own shapes are kept apart.
        repair: whether to search for a similar motion that is possible where this one is not: first one that is slower,
            then one whose joints move differently (:mod:`wbc.motion.repair`). The motion before is kept as ``before``,
            and ``added`` is how much longer it takes now.
        progress: called with the share that is done, and a word.

    Raises:
        InvalidInput: a motion, mapping or robot that makes no sense. UnknownMapping: none for this robot.
            UnknownName: rotations or contacts of a part that no body has.

    Example:
        >>> import wbc
        >>> from wbc.motion import made
        >>> robot = wbc.load("humanoid", base="floating")
        >>> found = wbc.retarget(made("squat"), robot)
        >>> found.q.shape, found.certified
        ((240, 37), 1.0)
    """
    checks.instance("robot", robot, PinocchioModel, "a robot from wbc.load(..., base='floating')")
    most = np.inf if acceleration is None else checks.number("acceleration", acceleration, low=0.0, strict=True)
    collisions, repair = checks.truth("collisions", collisions), checks.truth("repair", repair)
    checks.function("progress", progress, "a function of a share and a word")
    if not isinstance(motion, Motion | str | PathLike):
        raise InvalidInput(f"motion is {checks.shown(motion)}; it must be a Motion or the path of a file")
    motion = motion if isinstance(motion, Motion) else Motion.read(motion)
    table = Table.of(robot, mapping)
    asked, scale = targets(motion, robot, table)
    stack = Retargeting(robot, table, asked, acceleration=most, collisions=collisions)
    share = 0.25 if repair else 0.5
    q = stack.frames(lambda done: progress(share * done, "retargeting"))
    witness = Witness(robot, stack.contacts, collisions=collisions)
    judged = witness.judge(q, motion.rate, asked.contacts, lambda done: progress(share * (1.0 + done), "judging"))
    found = Retargeted(robot, motion, table, asked, scale, stack.contacts, q, judged, tuple(stack.unsolved))
    if not repair or found.certified == 1.0:
        return found
    return repaired(found, witness, lambda done, word: progress(0.5 + 0.5 * done, word))
