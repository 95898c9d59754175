"""Reactions: what may be changed in a stack that runs, when something is wrong with the robot."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from tasks.components.diagnosis import Diagnosis
from tasks.components.momentum_observer import MomentumObserver
from wbc import checks
from wbc.errors import InvalidInput, NotSupported, UnknownName
from wbc.models.model import RobotState
from wbc.stack.task import Task
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.stack.plan import Plan

#: What is never given to a joint that lost a share, however large the share seems: commands are divided by the rest.
LEAST_LEFT = 0.05
#: What of a joint's motion may be bounded.
QUANTITIES = ("position", "velocity", "acceleration")


@dataclass(frozen=True)
class Reaction(ABC):
    """Settings. ``apply`` changes bounds, motors, weights or targets of the plan before it is filled; sizes never."""

    #: Whether it cannot be undone: no second look is taken at a diagnosis that was answered by it.
    final: ClassVar[bool] = False

    @abstractmethod
    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        """Do it, from this tick on."""

    def hold(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        """What has to be done in every tick while the diagnosis stands; mostly nothing."""

    def prepare(self, plan: Plan) -> None:
        """Refuse, before the first tick, what ``apply`` could not do.

        Raises:
            NotSupported, UnknownName: what the stack lacks.
        """


@final
@dataclass(frozen=True)
class Release(Reaction):
    """The joint's torque is 0 from now on: its bounds become [0, 0], its motor is sent nothing.

    It then moves as the others move it, so its own limits on position, velocity and acceleration, and the stiffness
    of tasks on the joints there, are taken away in the same tick; the damping stays. The limits come back as wishes
    through :attr:`FaultReaction.limits`.
    """

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        i = diagnosis.joint
        plan.actuators.set(i, share=0.0)
        for bound in plan.torque_bounds:
            bound[i] = 0.0
        lift_limits(plan, i)
        soften(plan, i)


@final
@dataclass(frozen=True)
class Derate(Reaction):
    """The motor gives (1 − share) of what it is sent: the command is divided by that, the bounds multiplied.

    A joint decided on again has what the last decision says, of all that it is sent.
    """

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        i = diagnosis.joint
        plan.actuators.set(i, share=float(np.clip(1.0 - diagnosis.share, LEAST_LEFT, 1.0)))
        _rebound(plan, i)


@final
@dataclass(frozen=True)
class Compensate(Reaction):
    """The motor gives ``offset`` less than it is sent: that much more is asked of it."""

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        plan.actuators.set(diagnosis.joint, offset=diagnosis.offset)
        _rebound(plan, diagnosis.joint)


@final
@dataclass(frozen=True)
class Cap(Reaction):
    """The motor gives what it is sent up to a ceiling: that is its torque limit now."""

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        i = diagnosis.joint
        plan.actuators.set(i)
        lower, upper = plan.torque_bounds
        lower[i], upper[i] = max(lower[i], -diagnosis.ceiling), min(upper[i], diagnosis.ceiling)


@final
@dataclass(frozen=True)
class Brake(Reaction):
    """The joint's brake holds it: its acceleration is 0 and its torque, the brake's now, is free.

    ``set`` is called with the joint's name and sets the brake of the real, or simulated, robot.
    """

    set: Callable[[str], None]
    final: ClassVar[bool] = True

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        i = diagnosis.joint
        assert plan.intervals is not None, "prepare has asked for limits"
        lower, upper = plan.torque_bounds
        lower[i], upper[i] = -np.inf, np.inf
        plan.actuators.set(i, share=0.0)
        lift_limits(plan, i)
        low, high = plan.intervals.bounds("acceleration")
        low[i] = high[i] = 0.0
        plan.intervals.replace("acceleration", low, high)
        self.set(diagnosis.joint_name)

    def prepare(self, plan: Plan) -> None:
        if plan.intervals is None:
            raise NotSupported("Brake holds a joint by limits on its motion, and the stack has none")


@final
@dataclass(frozen=True)
class Carry(Reaction):
    """The load found counts from now on: its weight and its inertia are terms of the dynamics, as if the model had it.

    ``observer``, the one of the diagnosis, then takes it out of what is missing, so that faults and pushes are seen as
    before.
    """

    observer: MomentumObserver

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        if diagnosis.load is not None:
            self.observer.carry(diagnosis.load)

    def hold(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        if diagnosis.load is not None:
            plan.extra_bias += diagnosis.load.weight(state)
            plan.add_inertia(diagnosis.load.inertia(state))


@final
@dataclass(frozen=True)
class Weigh(Reaction):
    """A task counts ``factor`` times as much as before."""

    task: str
    factor: float

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        task = _task(plan, self.task)
        task.weight = np.asarray(task.weight) * self.factor

    def prepare(self, plan: Plan) -> None:
        checks.number("Weigh.factor", self.factor, low=0.0)
        _task(plan, self.task)


@final
@dataclass(frozen=True)
class Retarget(Reaction):
    """A task gets another target: a value or function of time, or what ``target(diagnosis, state, plan)`` makes of the
    moment with ``made=True``. It shifts a posture, or moves the load off a leg."""

    task: str
    target: Any
    made: bool = False

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        target = self.target(diagnosis, state, plan) if self.made else self.target
        if target is not None:
            _task(plan, self.task).target = target

    def prepare(self, plan: Plan) -> None:
        if not hasattr(_task(plan, self.task), "target"):
            raise InvalidInput(f"{self.task} has no target that could be changed")


@final
@dataclass(frozen=True)
class Comply(Reaction):
    """All kinematic tasks give way: their stiffness becomes ``stiffness`` of what it was, their damping ``damping``."""

    stiffness: float = 0.0
    damping: float = 1.0

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        for task in plan.stack.tasks:
            if isinstance(task, Task):
                kp, kd = np.asarray(task.kp), np.asarray(task.kd if task.kd is not None else 2.0 * np.sqrt(task.kp))
                task.kp, task.kd = self.stiffness * kp, self.damping * kd

    def prepare(self, plan: Plan) -> None:
        checks.number("Comply.stiffness", self.stiffness, low=0.0)
        checks.number("Comply.damping", self.damping, low=0.0)


@final
@dataclass(frozen=True)
class Stop(Reaction):
    """Tasks on the joints hold the configuration of this moment, all other tasks are dropped."""

    def apply(self, diagnosis: Diagnosis, state: RobotState, plan: Plan) -> None:
        for task in plan.stack.tasks:
            if getattr(task, "on_joints", False) and hasattr(task, "target"):
                task.target = np.array(state.q_joints)
            else:
                task.active = False

    def prepare(self, plan: Plan) -> None:
        if not any(getattr(task, "on_joints", False) and hasattr(task, "target") for task in plan.stack.tasks):
            raise NotSupported("Stop holds the joints by a task on them, such as Posture; the stack has none")


def lift_limits(plan: Plan, joint: int) -> None:
    """No bounds on position, velocity and acceleration of one joint any more, until the controller starts again."""
    if plan.intervals is not None:
        for quantity in QUANTITIES:
            low, high = plan.intervals.bounds(quantity)
            low[joint], high[joint] = -np.inf, np.inf
            plan.intervals.replace(quantity, low, high)


def soften(plan: Plan, joint: int) -> None:
    """Tasks on the joints no longer pull this one; they still damp it."""
    for task in plan.stack.tasks:
        if isinstance(task, Task) and task.on_joints and task.dim == plan.model.nj:
            kp = np.broadcast_to(task.kp, task.dim).copy()
            kd = np.broadcast_to(2.0 * np.sqrt(kp) if task.kd is None else task.kd, task.dim).copy()
            kp[joint] = 0.0
            task.kp, task.kd = kp, kd


def _rebound(plan: Plan, joint: int) -> None:
    """Torques that commands within the model's limits give."""
    most: Vec = plan.model.limits.tau_max
    for bound, reached in zip(plan.torque_bounds, plan.actuators.bounds(-most, most), strict=True):
        bound[joint] = reached[joint]


def _task(plan: Plan, name: str) -> Any:
    for task in plan.stack.tasks:
        if task.name == name:
            return task
    raise UnknownName(name, [task.name for task in plan.stack.tasks], "a reaction speaks of a task of the stack")
