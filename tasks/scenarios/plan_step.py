"""What a change of contacts does to the torques, apart from what it does to the robot."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc.models.model import RobotState
from wbc.qp.solvers import by_name
from wbc.stack.component import Component
from wbc.stack.hierarchy import Weighted
from wbc.stack.plan import Plan
from wbc.stack.plan_view import PlanView
from wbc.types import Vec


@final
class PlanStep(Component):
    """Torques (nj,) [N m] of the plan before a change less those of the plan after it, in one and the same state.

    Zero where the plan has not changed. Both are asked with what the components override in this tick.
    """

    def __init__(self) -> None:
        super().__init__()
        self._plan: Plan | None = None
        self._former: Plan | None = None
        self._step: Vec = np.zeros(0)

    def prepare(self, model: Any) -> None:
        self._step = np.zeros(model.nj)

    def reset(self, state: RobotState) -> None:
        self._plan, self._former = None, None
        self._step[:] = 0.0

    def before(self, state: RobotState, last: object, plan: PlanView) -> None:
        assert isinstance(plan, Plan), "it is the controller's"
        self._former, self._plan = self._plan, plan

    def after(self, state: RobotState, command: Any) -> None:
        former = self._former
        self._step[:] = 0.0
        if former is None or former is self._plan:
            return
        former.fill(state)
        problem = former.problem
        if Weighted().open(problem, by_name("daqp")).solve().ok:
            first = problem.first_row + state.model.nb
            self._step[:] = command.tau - problem.value[first : first + state.model.nj]

    def signals(self) -> dict[str, Vec]:
        return {"tau": self._step}
