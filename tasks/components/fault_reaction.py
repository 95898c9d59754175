"""FaultReaction: a table of what to change in the stack when a motor fails or something touches the robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from tasks.components.diagnosis import KINDS, Diagnoser, Diagnosis
from tasks.components.momentum_observer import MomentumObserver
from tasks.components.reactions import QUANTITIES, Cap, Derate, Reaction, Release
from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.component import Component
from wbc.stack.task import Objective, Task, TaskRows
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.stack.plan import Plan


@final
@dataclass(frozen=True)
class When:
    """One line of the table: on a diagnosis of ``kind``, of one of ``joints`` (none: any), do ``reactions``."""

    kind: str
    reactions: Sequence[Reaction]
    joints: Sequence[str] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InvalidInput(f"kind is {self.kind!r}; it must be one of {', '.join(KINDS)}")
        for i, reaction in enumerate(self.reactions):
            if not isinstance(reaction, Reaction):
                raise InvalidInput(f"reactions[{i}] is {reaction!r}; it must be a reaction such as Release()")

    def holds(self, diagnosis: Diagnosis) -> bool:
        """Whether the line is about this diagnosis."""
        return diagnosis.kind == self.kind and (not self.joints or diagnosis.joint_name in self.joints)


#: What helps where motors are redundant, as in the legs of a robot that stands on both.
TABLE: Sequence[When] = (
    When("total", [Release()]),
    When("partial", [Derate()]),
    When("saturation", [Cap()]),
)


@final
class FaultReaction(Component):
    """Changes bounds, motors, weights and targets of the running stack as a table says; the QP does the rest.

    The diagnosis falls some ticks after the observer's alarm (:class:`~tasks.components.diagnosis.Diagnoser`), and the
    change is in the QP of the same tick: nothing is compiled anew. The first line of ``table`` that is about the
    diagnosis holds; where none is, the decision is logged and nothing changes. Afterwards the joint is watched again,
    so that a wrong first estimate mends itself. ``controller.reset()`` takes everything back.

    Args:
        observer: in the stack too, before this.
        table: lines of :class:`When`; by default a dead joint is released, a weak one asked for more, a joint with a
            ceiling limited by it.
        noise: standard deviation (nj,) of what one tick's missing torques show without a fault
            (``Thresholds.noise``), a number, or 0: decisions wait until it no longer matters.
        start: no diagnosis before this time after the first tick [s].
        hands: frames that may pick something up: a load in one of them is told from a push once the robot has moved.
        lockout, settle: after a decision no other joint is judged for ``lockout`` [s], the same one for ``settle`` [s].
        dominance: how many times as far beyond its threshold a joint is as any other, if it is its own fault; less
            where wrong masses show in joints that the fault sets moving.
        recheck: so long after a decision it is made again with all that was seen since [s].

    Where a later diagnosis says that a motor is sound after all (``instead_of``), or that a payload is what was taken
    for a push, everything is taken back, and what was decided on other motors done again; a brake stays set.

    :attr:`limits` is a task to be put among the stack's: it keeps joints that were released within their limits, as a
    wish. :attr:`events` lists diagnoses and what was done. Signals: ``kind`` (0 nothing new, else the place in
    ``KINDS`` from 1 on), ``joint`` (-1: none), ``share`` (nj,), what motors are taken to give of what they are sent.

    Raises:
        InvalidInput: a table or number that makes no sense; in the first tick, an observer that is not in the stack
            before this. NotSupported, UnknownName: in the first tick, a reaction the stack does not allow.

    Example:
        >>> import wbc
        >>> from tasks import Derate, FaultReaction, MomentumObserver, Posture, Release, TorqueLimits, When
        >>> robot = wbc.load("arm")
        >>> observer = MomentumObserver(gain=100.0, threshold=1.0, persistence=2)
        >>> reaction = FaultReaction(observer, table=[When("total", [Release()]), When("partial", [Derate()])])
        >>> stack = wbc.Stack([Posture(robot.q0)], subject_to=[TorqueLimits()], components=[observer, reaction])
        >>> command = wbc.Controller(robot, stack, level=wbc.InverseDynamics()).tick(0.0, robot.q0, 0 * robot.q0)
        >>> reaction.events
        []
    """

    def __init__(
        self, observer: MomentumObserver, *, table: Sequence[When] = TABLE, noise: Any = 0.0, start: float = 0.5,
        lockout: float = 0.5, settle: float = 0.02, recheck: float = 0.1,
        dominance: float = 10.0, hands: Sequence[str] = (), name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(name=name)
        if not isinstance(observer, MomentumObserver):
            raise InvalidInput(f"{self.name}.observer is {observer!r}; it must be a MomentumObserver")
        for i, line in enumerate(table):
            if not isinstance(line, When):
                raise InvalidInput(f"{self.name}.table[{i}] is {line!r}; it must be When(kind, reactions)")
        self.observer, self.table = observer, tuple(table)
        self.noise, self.hands = noise, tuple(hands)
        self._times = {
            what: checks.number(f"{self.name}.{what}", value, low=0.0)
            for what, value in (
                ("start", start),
                ("lockout", lockout),
                ("settle", settle),
                ("recheck", recheck),
                ("dominance", dominance),
            )
        }
        #: The task that keeps released joints within their limits, as a wish.
        self.limits = _ReleasedLimits(name=f"{self.name} limits")
        self._before: _Before | None = None
        self._standing: list[tuple[Diagnosis, tuple[Reaction, ...]]] = []
        self.events: list[tuple[Diagnosis, tuple[Reaction, ...]]] = []

    def prepare(self, model: RobotModel) -> None:
        noise = np.asarray(self.noise, dtype=np.float64)
        self._noise = checks.array(f"{self.name}.noise", np.full(model.nj, noise) if noise.ndim == 0 else noise,
                                   (model.nj,))  # fmt: skip
        self.limits.prepare(model)
        for hand in self.hands:
            model.check_frame(hand)
        self._names, self._share = model.joint_names, np.ones(model.nj)
        self._last = (0.0, -1.0)

    def reset(self, state: RobotState) -> None:
        if self._before is not None:
            self._before.restore_tasks()
        self._before = None
        self.events, self._standing = [], []
        self._diagnoser: Diagnoser | None = None
        self._share[:], self._last = 1.0, (0.0, -1.0)
        self.limits.release(())

    def before(self, state: RobotState, last: object, plan: Plan) -> None:
        if self._diagnoser is None:
            self._begin(state, plan)
        assert self._diagnoser is not None
        self._last = (0.0, -1.0)
        self.limits.watch(state)
        diagnosis = self._diagnoser.tick(state, self.observer)
        if diagnosis is not None:
            self._react(diagnosis, state, plan)
        for decided, reactions in self._standing:
            for reaction in reactions:
                reaction.hold(decided, state, plan)

    def _react(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        line = next((line for line in self.table if line.holds(diagnosis)), None)
        reactions = () if line is None else tuple(line.reactions)
        if self._before is None:
            self._before = _Before(plan)
        if diagnosis.instead_of or diagnosis.kind == "payload":
            self._take_back(diagnosis, state, plan)
        for reaction in reactions:
            reaction.apply(diagnosis, state, plan)
        if reactions:
            self._standing.append((diagnosis, reactions))
        self._remember(diagnosis, reactions, plan)

    def _take_back(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        """Undo all, then do again what was decided on motors that are not acquitted, and on loads."""
        assert self._before is not None
        self._before.restore(plan)
        self._standing = [
            (decided, reactions) for decided, reactions in self._standing
            if decided.kind != "external" and decided.joint not in diagnosis.instead_of
        ]  # fmt: skip
        for decided, reactions in self._standing:
            for reaction in reactions:
                if not reaction.final:
                    reaction.apply(decided, state, plan)

    def _begin(self, state: RobotState, plan: Plan) -> None:
        components = plan.stack.components
        if self.observer not in components or components.index(self.observer) > components.index(self):
            raise InvalidInput(f"{self.name} needs its observer in the stack's components, before it")
        for line in self.table:
            for joint in line.joints:
                plan.model.joint(joint)
            for reaction in line.reactions:
                reaction.prepare(plan)
        self._diagnoser = Diagnoser(
            self._names, noise=self._noise, hands=self.hands,
            **self._times | {"start": state.t + self._times["start"]},
        )  # fmt: skip

    def _remember(self, diagnosis: Diagnosis, reactions: tuple[Reaction, ...], plan: Plan) -> None:
        assert self._diagnoser is not None
        self.events.append((diagnosis, reactions))
        self._share[:] = plan.actuators.share
        self._last = (1.0 + KINDS.index(diagnosis.kind), float(diagnosis.joint))
        if any(reaction.final for reaction in reactions):
            self._diagnoser.settle(diagnosis.joint)
        if reactions and diagnosis.kind == "payload":
            for joint in range(len(self._names)):
                self.observer.restart(joint)
        elif reactions:
            self.observer.restart(diagnosis.joint)
        else:
            self._diagnoser.leave(diagnosis)
        dead = tuple(int(joint) for joint in np.flatnonzero(self._share == 0.0))
        for joint in dead:
            self._diagnoser.ignore(joint)
        self.limits.release(dead)

    def signals(self) -> Mapping[str, Vec | float]:
        return {"kind": self._last[0], "joint": self._last[1], "share": self._share}


@final
class _ReleasedLimits(Task):
    """Joints without torque are wished back when they leave their limits; of other joints it says nothing.

    Where a released joint is outside its position limits, or would be after ``ahead`` seconds at its speed, the
    acceleration kp (limit − q) − kd v is wished for it; elsewhere the weight of its row is 0.
    """

    on_joints = True

    def __init__(self, *, kp: float = 400.0, weight: float = 1.0, ahead: float = 0.05, name: str) -> None:
        super().__init__(kp=kp, weight=0.0, name=name)
        self._pull, self.ahead = weight, ahead
        self._released: tuple[int, ...] = ()

    def prepare(self, model: RobotModel) -> None:
        self.dim, self.units, self.labels = model.nj, model.joint_units, model.joint_names
        self._limits, self._on = model.limits, np.zeros(model.nj)

    def release(self, joints: tuple[int, ...]) -> None:
        """From now on these joints are released, and no others."""
        self._released = joints
        if not joints and np.any(self.weight):
            self._on[:] = 0.0
            self.weight = self._on

    def watch(self, state: RobotState) -> None:
        """Turn the wish of each released joint on or off, before the plan is filled."""
        q, v, limits = state.q_joints, state.v_joints, self._limits
        soon = q + self.ahead * v
        wanted = np.zeros(self.dim)
        for i in self._released:
            if min(q[i], soon[i]) < limits.q_min[i] or max(q[i], soon[i]) > limits.q_max[i]:
                wanted[i] = self._pull
        if (wanted != self._on).any():
            self._on = wanted
            self.weight = wanted

    def fill(self, state: RobotState, out: TaskRows) -> None:
        q, limits = state.q_joints, self._limits
        out.e[:] = np.clip(q, limits.q_min, limits.q_max) - q
        out.rate_ref[:], out.acc_ref[:] = 0.0, 0.0


@final
class _Before:
    """What reactions may change, as it was before the first of them."""

    def __init__(self, plan: Plan) -> None:
        self._tasks = [(task, _settings(task)) for task in plan.stack.tasks]
        self._torque = [bound.copy() for bound in plan.torque_bounds]
        self._motion = {} if plan.intervals is None else {what: plan.intervals.bounds(what) for what in QUANTITIES}

    def restore_tasks(self) -> None:
        for task, settings in self._tasks:
            for what, value in settings.items():
                setattr(task, what, value)

    def restore(self, plan: Plan) -> None:
        self.restore_tasks()
        plan.actuators.reset()
        for bound, before in zip(plan.torque_bounds, self._torque, strict=True):
            bound[:] = before
        for quantity, bounds in self._motion.items():
            assert plan.intervals is not None, "it had bounds before"
            plan.intervals.replace(quantity, *bounds)


def _settings(task: Objective) -> dict[str, Any]:
    names = ("weight", "active", "kp", "kd", "target")
    return {name: getattr(task, name) for name in names if hasattr(task, name)}
