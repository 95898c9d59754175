"""Draft: the overrides of one tick in the making, by one reaction after the other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np

from wbc.errors import UnknownName
from wbc.stack.overrides import QUANTITIES, Motor, Overrides
from wbc.stack.task import Objective, Task
from wbc.types import Mat, Vec

if TYPE_CHECKING:
    from wbc.stack.plan_view import PlanView


@final
class Draft:
    """Starts from the stack as its user set it; what is not said stays so.

    ``motors`` by joint; ``lifted`` joints by quantity; ``bounds`` (2, nj) by quantity, ±inf where nothing is said;
    ``bias`` (nv,) and ``inertia`` (nv, nv), or None.
    """

    def __init__(self, plan: PlanView) -> None:
        self.plan = plan
        self.motors: dict[int, Motor] = {}
        self.lifted: dict[str, set[int]] = {}
        self.bounds: dict[str, Mat] = {}
        self.bias: Vec | None = None
        self.inertia: Mat | None = None
        self._tasks: dict[str, Any] = {}
        self._settings: dict[str, dict[str, Any]] = {}

    def lift(self, joint: int, *quantities: str) -> None:
        """The stack's limits on these quantities of a joint do not hold."""
        for quantity in quantities:
            self.lifted.setdefault(quantity, set()).add(joint)

    def bound(self, quantity: str, joint: int, lower: float, upper: float) -> None:
        """Beside the limits of the stack a joint's quantity stays within these."""
        bounds = self.bounds.setdefault(quantity, np.full((2, self.plan.model.nj), [[-np.inf], [np.inf]]))
        bounds[0, joint], bounds[1, joint] = max(bounds[0, joint], lower), min(bounds[1, joint], upper)

    def tasks(self) -> list[Any]:
        """All tasks of the stack, as they are so far: copies to be read."""
        return [self.task(task.name) for task in self.plan.all_tasks]

    def task(self, name: str) -> Any:
        """A task as it is so far, a copy to be read.

        Raises:
            UnknownName: the stack has no such task.
        """
        if name not in self._tasks:
            self._tasks[name] = self.plan.binding.given(task_of(self.plan, name))
        return self._tasks[name]

    def set(self, name: str, **settings: Any) -> None:
        """Settings of a task in this tick: ``weight``, ``active``, ``kp``, ``kd``, ``rate``, ``target``."""
        self._settings.setdefault(name, {}).update(settings)

    def weights(self, task: Objective) -> Vec:
        """Weights (dim,) of a task as earlier reactions left them, a copy."""
        return np.array(self._so_far(task).get("weight", task.weights()))

    def gains(self, task: Task) -> tuple[Vec, Vec]:
        """kp and kd (dim,) of a task as earlier reactions left them, copies."""
        (kp, kd, _), said = task.gains(), self._so_far(task)
        return np.array(said.get("kp", kp)), np.array(said.get("kd", kd))

    def _so_far(self, task: Objective) -> dict[str, Any]:
        return self._settings.get(task.name, {})

    @property
    def share(self) -> Vec:
        """What motors are taken to give of what they are sent (nj,)."""
        share = np.ones(self.plan.model.nj)
        for joint, motor in self.motors.items():
            share[joint] = motor.share
        return share

    def overrides(self) -> Overrides:
        """The value that a component returns."""
        bounds: dict[str, Any] = {what: tuple(self.bounds[what]) for what in QUANTITIES if what in self.bounds}
        return Overrides(
            lifted=self.lifted, motors=self.motors, tasks=self._settings, bias=self.bias, inertia=self.inertia, **bounds
        )


def task_of(plan: PlanView, name: str) -> Any:
    """The plan's copy of a task, by name.

    Raises:
        UnknownName: the stack has no such task.
    """
    for task in plan.all_tasks:
        if task.name == name:
            return task
    raise UnknownName(name, [task.name for task in plan.all_tasks], "a reaction speaks of a task of the stack")
