"""FaultReaction: changes the stack by a table when a motor fails or something touches the robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.component import Component
from wbc.stack.overrides import Overrides
from wbc.stack.task import Task, TaskRows
from wbc.types import Vec

from .diagnosis import ACTUATOR, KINDS, Diagnoser, Diagnosis
from .draft import Draft
from .momentum_observer import MomentumObserver
from .reactions import Cap, Carry, Derate, Reaction, Release

if TYPE_CHECKING:
    from wbc.stack.plan_view import PlanView


@final
@dataclass(frozen=True)
class When(metaclass=TellsArguments):
    """One line of the table: on a diagnosis of ``kind``, of one of ``joints`` (none: any), do ``reactions``."""

    kind: str
    reactions: Sequence[Reaction]
    joints: Sequence[str] = ()

    def __post_init__(self) -> None:
        checks.one_of("kind", self.kind, KINDS)
        checks.items("joints", self.joints, "names of joints")
        for i, reaction in enumerate(checks.items("reactions", self.reactions, "reactions")):
            checks.instance(f"reactions[{i}]", reaction, Reaction, "a reaction such as Release()")

    def holds(self, diagnosis: Diagnosis) -> bool:
        """Whether the line is about this diagnosis."""
        return diagnosis.kind == self.kind and (not self.joints or diagnosis.joint_name in self.joints)


#: What helps where motors are redundant, as in the legs of a robot that stands on both.
TABLE: Sequence[When] = (
    When("total", [Release()]),
    When("partial", [Derate()]),
    When("saturation", [Cap()]),
)


class _Standing(NamedTuple):
    """A decision that holds: its reactions, each with what it decided at that moment."""

    diagnosis: Diagnosis
    reactions: tuple[tuple[Reaction, Any], ...]

    @property
    def is_final(self) -> bool:
        return any(reaction.final for reaction, _ in self.reactions)


@final
class FaultReaction(Component):
    """Overrides bounds, motors, weights and targets of the running stack as a table says; the QP does the rest.

    The diagnosis falls some ticks after the observer's alarm (:class:`~tasks.components.diagnosis.Diagnoser`), and the
    change is in the QP of the same tick: nothing is compiled anew. The first line of ``table`` that matches the
    diagnosis applies; if none matches, the decision is logged and nothing changes. Afterwards the joint is watched
    again, so that a wrong first estimate is corrected: a decision on a motor replaces the one before it on that motor.
    The members of the stack stay as their user set them; ``controller.reset()`` forgets all decisions.

    Args:
        observer: in the stack too, before this.
        table: lines of :class:`When`; by default a dead joint is released, a weak one gets a larger command, a joint
            with a ceiling is limited by it.
        noise: standard deviation (nj,) of the missing torques of one tick without a fault (``Thresholds.noise``), a
            number, or 0: decisions wait until it no longer matters.
        start: no diagnosis before this time after the first tick [s].
        hands: frames that may pick something up: a load in one of them is distinguished from a push once the robot has
            moved.
        lockout, settle: after a decision no other joint is judged for ``lockout`` [s], the same one for ``settle`` [s].
        dominance: a joint is diagnosed as faulty if it exceeds its threshold this many times as far as any other. Use
            less where wrong masses appear in joints that the fault moves.
        recheck: time after a decision at which it is made again with all measurements since [s].

    If a later diagnosis says that a motor is sound (``instead_of``), or that a push was a payload, the first decision
    is withdrawn. Decisions on other motors stay, and a brake stays set.

    :attr:`limits` is a task to be put among the stack's: it brakes joints that were released where they leave their
    limits. :attr:`events` lists diagnoses and what was done. Signals: ``kind`` (0 nothing new, else the place in
    ``KINDS`` from 1 on), ``joint`` (-1: none), ``share`` (nj,), the share of its command that each motor is assumed to
    deliver.

    Raises:
        InvalidInput: a table or number that makes no sense; when a controller is made, an observer that is not in the
            stack before this, or :attr:`limits` in a stack without this. NotSupported, UnknownName: then too, a
            reaction the stack does not allow.

    Example:
        >>> import wbc
        >>> from wbc.tasks import Derate, FaultReaction, MomentumObserver, Posture, Release, TorqueLimits, When
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
        checks.instance(f"{self.name}.observer", observer, MomentumObserver, "a MomentumObserver")
        table = checks.items(f"{self.name}.table", table, "When(kind, reactions)")
        for i, line in enumerate(table):
            checks.instance(f"{self.name}.table[{i}]", line, When, "When(kind, reactions)")
            if any(isinstance(one, Carry) and one.observer is not observer for one in line.reactions):
                raise InvalidInput(f"{self.name}.table[{i}]: Carry needs {self.name}'s own observer")
        self.observer, self.table = observer, tuple(table)
        self.noise, self.hands = noise, tuple(checks.items(f"{self.name}.hands", hands, "frames"))
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
        #: The task that brakes released joints where they leave their limits.
        self.limits = _ReleasedLimits(name=f"{self.name} limits")
        self.limits.set_by = self
        self._standing: list[_Standing] = []
        self._fixed: Overrides | None = None
        self.events: list[tuple[Diagnosis, tuple[Reaction, ...]]] = []

    def prepare(self, model: RobotModel) -> None:
        self._noise = checks.gains(f"{self.name}.noise", self.noise, model.nj)
        for hand in self.hands:
            model.check_frame(hand)
        self._names, self._share = model.joint_names, np.ones(model.nj)
        self._last = (0.0, -1.0)

    def check(self, plan: PlanView) -> None:
        components = plan.stack.components
        if self.observer not in components or components.index(self.observer) > components.index(self):
            raise InvalidInput(f"{self.name} needs its observer in the stack's components, before it")
        for line in self.table:
            for joint in line.joints:
                plan.model.joint(joint)
            for reaction in line.reactions:
                reaction.prepare(plan)
        self._has_limits = any(task.name == self.limits.name for task in plan.stack.tasks)
        self._fixed = None  # it speaks of the tasks of the stack before

    def reset(self, state: RobotState) -> None:
        self.events, self._standing = [], []
        self._diagnoser: Diagnoser | None = None
        self._share[:], self._last = 1.0, (0.0, -1.0)
        self._fixed = None
        self._made_of: tuple[int, Vec] = (-1, np.zeros(0))

    def before(self, state: RobotState, last: object, plan: PlanView) -> Overrides | None:
        if self._diagnoser is None:
            self._diagnoser = Diagnoser(
                self._names, noise=self._noise, hands=self.hands,
                **self._times | {"start": state.t + self._times["start"]},
            )  # fmt: skip
        self._last = (0.0, -1.0)
        diagnosis = self._diagnoser.tick(state, self.observer)
        if diagnosis is not None:
            self._react(diagnosis, state, plan)
        return self._overrides(state, plan) if self._standing else None

    def _react(self, diagnosis: Diagnosis, state: RobotState, plan: PlanView) -> None:
        line = next((line for line in self.table if line.holds(diagnosis)), None)
        reactions = () if line is None else tuple(line.reactions)
        if diagnosis.instead_of or diagnosis.kind == "payload":
            self._standing = [
                one for one in self._standing
                if one.is_final or (one.diagnosis.kind != "external"
                                    and one.diagnosis.joint not in diagnosis.instead_of)
            ]  # fmt: skip
        if reactions:
            decided = tuple((reaction, reaction.decide(diagnosis, state, plan)) for reaction in reactions)
            self._standing = [one for one in self._standing if not _is_replaced(one.diagnosis, by=diagnosis)]
            self._standing.append(_Standing(diagnosis, decided))
        self._fixed = None
        self._share[:] = self._draft(plan).share
        self._remember(diagnosis, reactions)

    def _draft(self, plan: PlanView) -> Draft:
        draft = Draft(plan)
        for diagnosis, reactions in self._standing:
            for reaction, decided in reactions:
                reaction.apply(diagnosis, decided, draft)
        return draft

    def _overrides(self, state: RobotState, plan: PlanView) -> Overrides:
        """What the decisions that stand change; the same value while nothing changes but the state."""
        released = np.flatnonzero(self._share == 0.0)
        wanted = self.limits.wanted(state, released) if self._has_limits else np.zeros(0)
        assigned, before = self._made_of
        if self._fixed is None or assigned != plan.binding.assigned or not np.array_equal(wanted, before):
            draft = self._draft(plan)
            if wanted.any():
                draft.set(self.limits.name, weight=wanted)
            self._fixed, self._made_of = draft.overrides(), (plan.binding.assigned, wanted)
        held = Draft(plan)
        for diagnosis, reactions in self._standing:
            for reaction, _ in reactions:
                reaction.hold(diagnosis, state, held)
        if held.bias is None and held.inertia is None:
            return self._fixed
        return replace(self._fixed, bias=held.bias, inertia=held.inertia)

    def _remember(self, diagnosis: Diagnosis, reactions: tuple[Reaction, ...]) -> None:
        assert self._diagnoser is not None
        self.events.append((diagnosis, reactions))
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
        for dead in np.flatnonzero(self._share == 0.0):
            self._diagnoser.ignore(int(dead))

    def signals(self) -> Mapping[str, Vec | float]:
        return {"kind": self._last[0], "joint": self._last[1], "share": self._share}


def _is_replaced(former: Diagnosis, *, by: Diagnosis) -> bool:
    """Whether a decision is on the motor that a later one is on."""
    return former.kind in ACTUATOR and by.kind in ACTUATOR and former.joint == by.joint


@final
class _ReleasedLimits(Task):
    """Joints without torque are braked where they leave their limits; of other joints it says nothing.

    Where a released joint is outside its position limits, or would be after ``ahead`` seconds at its speed, the
    acceleration −kd v is asked for it. There is no kp: the others can only throw a hanging joint back, and a serial
    arm's swung ten times as far beyond when they did. The weight is 0 until :class:`FaultReaction` overrides it.
    """

    on_joints = True

    def __init__(self, *, kd: float = 40.0, pull: float = 1.0, ahead: float = 0.05, name: str) -> None:
        super().__init__(kp=0.0, kd=kd, weight=0.0, name=name)
        self.pull, self.ahead = pull, ahead

    def prepare(self, model: RobotModel) -> None:
        self.dim, self.units, self.labels = model.nj, model.joint_units, model.joint_names
        self._limits = model.limits

    def wanted(self, state: RobotState, released: Any) -> Vec:
        """Weight (nj,) of each row: ``pull`` where a released joint is, or will be, outside its limits, else 0."""
        q, limits = state.q_joints, state.model.limits
        soon = q + self.ahead * state.v_joints
        wanted = np.zeros(len(q))
        for i in released:
            if min(q[i], soon[i]) < limits.q_min[i] or max(q[i], soon[i]) > limits.q_max[i]:
                wanted[i] = self.pull
        return wanted

    def fill(self, state: RobotState, out: TaskRows) -> None:
        q, limits = state.q_joints, self._limits
        out.e[:] = np.clip(q, limits.q_min, limits.q_max) - q
        out.rate_ref[:], out.acc_ref[:] = 0.0, 0.0
