"""Scenarios that are there to be timed, soaked, or measured as they grow: what the controller answers is integrated."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.stack.formulation import Formulation
from wbc.stack.hierarchy import HIERARCHIES
from wbc.stack.stack import Stack

from .quality import Errors, Support, tracking_of_accelerations, tracking_of_velocities
from .robots import MadeRobot, RobotRecipe


class Certified(Scenario):
    """Good where every tick is certified and no limit is broken."""

    takes = 10.0

    def quality(self, trial: Trial) -> dict[str, Any]:
        """Figures of the run."""
        return {}

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        from ..scenarios import judge  # which all scenarios stand beside, these too

        (trial,) = trials
        return judge.verdict(trial, judge.common_checks(trial.run), figures=self.quality(trial))


@final
@dataclass(frozen=True)
class Problem:
    """What a workload asks of a robot: the stack; the errors of one tick by the names that they have among the figures;
    and what the contacts can give."""

    stack: Stack
    errors: Errors
    names: Sequence[str] = ("pos", "ori")
    supports: Sequence[Support] = ()


class Workload(Certified):
    """A robot, the stack that it is given, at which level and how often it ticks; see ``docs/benchmark.md``."""

    group: ClassVar[str] = "workloads"
    takes = 20.0
    hierarchies = tuple(HIERARCHIES)
    recipe: ClassVar[RobotRecipe]
    level: ClassVar[Formulation]
    dt: ClassVar[float]
    #: When a target steps, where the errors before it are told from those after it [s].
    step_time: ClassVar[float] = 0.0

    @abstractmethod
    def problem(self, made: MadeRobot, ticks: int) -> Problem:
        """Stack and references for a run of so many ticks."""

    def build(self, p: Parameters) -> Setup:
        made = self.recipe.made()
        problem = self.problem(made, round(p.settings.duration / self.dt))
        plant = IntegratorPlant(
            made.robot, dt=self.dt, level="velocity" if self.level.order == 1 else "acceleration"
        )  # fmt: skip
        plant.reset(made.q0)
        return Setup(
            stack=problem.stack, plant=plant, level=self.level, hierarchy=HIERARCHIES[p.settings.hierarchy],
            about=(made, problem),
        )  # fmt: skip

    def quality(self, trial: Trial) -> dict[str, Any]:
        made, problem = trial.about
        if self.level.dynamics:
            return tracking_of_accelerations(made, trial, problem.supports, problem.errors)
        return tracking_of_velocities(made, trial, problem.errors, names=problem.names, step_time=self.step_time)
