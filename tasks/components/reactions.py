"""Reactions: what may be changed in a stack that runs, when something is wrong with the robot."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput, NotSupported
from wbc.models.model import RobotState
from wbc.stack.overrides import Motor
from wbc.stack.task import Task

from .diagnosis import Diagnosis
from .draft import Draft, task_of
from .momentum_observer import MomentumObserver

if TYPE_CHECKING:
    from wbc.stack.plan_view import PlanView

#: What is never given to a joint that lost a share, however large the share seems: commands are divided by the rest.
LEAST_LEFT = 0.05
#: What of a joint's motion may be bounded.
MOTION = ("position", "velocity", "acceleration")


@dataclass(frozen=True)
class Reaction(metaclass=TellsArguments):
    """Settings. ``apply`` says, in each tick in which a diagnosis stands, what it changes; nothing has to be undone."""

    #: Whether it cannot be undone: no second look is taken at a diagnosis that was answered by it.
    final: ClassVar[bool] = False

    def decide(self, diagnosis: Diagnosis, state: RobotState, plan: PlanView) -> Any:
        """Called once, in the tick of the diagnosis; what it returns is given to ``apply`` in each tick."""

    @abstractmethod
    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        """Write into the draft of a tick's overrides."""

    def hold(self, diagnosis: Diagnosis, state: RobotState, draft: Draft) -> None:
        """Write what changes with the state; mostly nothing."""

    def prepare(self, plan: PlanView) -> None:
        """Refuse, when a controller is made, what ``apply`` could not do.

        Raises:
            NotSupported, UnknownName: what the stack lacks.
        """


@final
@dataclass(frozen=True)
class Release(Reaction):
    """The joint gets no torque from now on: its motor is sent 0.

    It then moves as the others move it, so its own limits on position, velocity and acceleration, and the stiffness
    there of tasks on all joints, such as Posture, are taken away in the same tick; the damping stays. Where the joint
    leaves its limits, :attr:`FaultReaction.limits` brakes it. A task on some joints that names it, such as
    FrozenJoints, stays as it is.
    """

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        i = diagnosis.joint
        draft.motors[i] = Motor(share=0.0)
        draft.lift(i, *MOTION)
        soften(draft, i)


@final
@dataclass(frozen=True)
class Derate(Reaction):
    """The motor gives (1 − share) of what it is sent: the command is divided by that, the bounds multiplied.

    A joint decided on again has what the last decision says, of all that it is sent.
    """

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        draft.motors[diagnosis.joint] = Motor(share=float(np.clip(1.0 - diagnosis.share, LEAST_LEFT, 1.0)))


@final
@dataclass(frozen=True)
class Compensate(Reaction):
    """The motor delivers ``offset`` less than it is sent: its command is raised by that."""

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        draft.motors[diagnosis.joint] = Motor(offset=diagnosis.offset)


@final
@dataclass(frozen=True)
class Cap(Reaction):
    """The motor delivers no more than a ceiling, which becomes its torque limit."""

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        i = diagnosis.joint
        draft.motors[i] = Motor()
        draft.bound("torque", i, -diagnosis.ceiling, diagnosis.ceiling)


@final
@dataclass(frozen=True)
class Brake(Reaction):
    """The brake holds the joint: its acceleration is 0, and its torque is free, since the brake bears it.

    ``set`` is called with the joint's name and sets the brake of the real, or simulated, robot.
    """

    set: Callable[[str], None]
    final: ClassVar[bool] = True

    def decide(self, diagnosis: Diagnosis, state: RobotState, plan: PlanView) -> Any:
        self.set(diagnosis.joint_name)

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        i = diagnosis.joint
        draft.motors[i] = Motor(share=0.0)
        draft.lift(i, "torque", *MOTION)
        draft.bound("acceleration", i, 0.0, 0.0)


@final
@dataclass(frozen=True)
class Carry(Reaction):
    """The load that was found becomes part of the dynamics: its weight and inertia count as if the model had them.

    ``observer``, the one of the diagnosis, then takes it out of what is missing, so that faults and pushes are seen as
    before.
    """

    observer: MomentumObserver

    def decide(self, diagnosis: Diagnosis, state: RobotState, plan: PlanView) -> Any:
        if diagnosis.load is not None:
            self.observer.carry(diagnosis.load, state)

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        """Nothing that is the same in every state."""

    def hold(self, diagnosis: Diagnosis, state: RobotState, draft: Draft) -> None:
        if diagnosis.load is not None:
            weight, inertia = diagnosis.load.weight(state), diagnosis.load.inertia(state)
            draft.bias = weight if draft.bias is None else draft.bias + weight
            draft.inertia = inertia if draft.inertia is None else draft.inertia + inertia


@final
@dataclass(frozen=True)
class Weigh(Reaction):
    """A task gets ``factor`` times the weight that its user gave it."""

    task: str
    factor: float

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        draft.set(self.task, weight=draft.weights(draft.task(self.task)) * self.factor)

    def prepare(self, plan: PlanView) -> None:
        checks.number("Weigh.factor", self.factor, low=0.0)
        task_of(plan, self.task)


@final
@dataclass(frozen=True)
class Retarget(Reaction):
    """A task gets another target: a value or function of time, or what ``target(diagnosis, state, plan)`` makes of the
    moment with ``made=True``. It shifts a posture, or moves the load off a leg."""

    task: str
    target: Any
    made: bool = False

    def decide(self, diagnosis: Diagnosis, state: RobotState, plan: PlanView) -> Any:
        return self.target(diagnosis, state, plan) if self.made else self.target

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        if decided is not None:
            draft.set(self.task, target=decided)

    def prepare(self, plan: PlanView) -> None:
        checks.truth("Retarget.made", self.made)
        if not hasattr(task_of(plan, self.task), "target"):
            raise InvalidInput(f"{self.task} has no target that could be changed")


@final
@dataclass(frozen=True)
class Comply(Reaction):
    """All kinematic tasks comply: their stiffness becomes ``stiffness`` of what it was, their damping ``damping``."""

    stiffness: float = 0.0
    damping: float = 1.0

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        for task in draft.tasks():
            if isinstance(task, Task):
                kp, kd = draft.gains(task)
                draft.set(task.name, kp=self.stiffness * kp, kd=self.damping * kd)

    def prepare(self, plan: PlanView) -> None:
        checks.number("Comply.stiffness", self.stiffness, low=0.0)
        checks.number("Comply.damping", self.damping, low=0.0)


@final
@dataclass(frozen=True)
class Stop(Reaction):
    """Tasks on the positions of joints hold the configuration of this moment, all other tasks are dropped."""

    def decide(self, diagnosis: Diagnosis, state: RobotState, plan: PlanView) -> Any:
        return np.array(state.q_joints)

    def apply(self, diagnosis: Diagnosis, decided: Any, draft: Draft) -> None:
        for task in draft.tasks():
            if _holds_joints(task):
                draft.set(task.name, target=decided)
            else:
                draft.set(task.name, active=False)

    def prepare(self, plan: PlanView) -> None:
        if not any(_holds_joints(task) for task in plan.all_tasks):
            raise NotSupported("Stop holds the joints by a task on them, such as Posture; the stack has none")


def soften(draft: Draft, joint: int) -> None:
    """Tasks on the joints no longer pull this one; they still damp it."""
    for task in draft.tasks():
        if isinstance(task, Task) and task.on_joints and task.dim == draft.plan.model.nj:
            kp, kd = draft.gains(task)
            kp[joint] = 0.0
            draft.set(task.name, kp=kp, kd=kd)


def _holds_joints(task: Any) -> bool:
    """Whether the target is a configuration: without kp it would be a velocity."""
    return isinstance(task, Task) and task.on_joints and hasattr(task, "target") and bool(task.gains()[0].any())
