"""TorqueRun: what runs of a torque-controlled robot on an exact plant have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import wbc
from wbc.models.model import RobotModel
from wbc.sim.disturbance import Disturbance
from wbc.sim.scenario import Progress
from wbc.sim.simulate import simulate

from .exact_plant import ExactPlant


@final
@dataclass(frozen=True)
class TorqueRun:
    """How to run: the solver, for how long [s], who is told of the progress, what stands in the metadata."""

    solver: str
    duration: float
    progress: Progress
    meta: Mapping[str, Any]

    def __call__(
        self,
        robot: RobotModel,
        stack: wbc.Stack,
        plant: ExactPlant,
        *,
        disturbances: Sequence[Disturbance] = (),
        before_tick: Callable[[float], None] | None = None,
    ) -> wbc.Run:
        """The record of ``stack`` on ``robot`` driving ``plant``, a regularisation below all that is looked at."""
        level = wbc.InverseDynamics(regularisation=1e-11)
        controller = wbc.Controller(robot, stack, level=level, solver=self.solver, dt=plant.dt)
        return simulate(
            controller, plant, duration=self.duration, disturbances=disturbances, before_tick=before_tick,
            progress=self.progress, meta=self.meta,
        )  # fmt: skip
