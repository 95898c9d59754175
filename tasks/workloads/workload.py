"""Scenarios that are there to be timed, soaked, or measured as they grow: what the controller answers is integrated."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.stack.formulation import Formulation
from wbc.stack.hierarchy import HIERARCHIES
from wbc.stack.stack import Stack
from wbc.types import Vec

from .robots import MadeRobot, RobotRecipe


class Certified(Scenario):
    """Good where every tick is certified and no limit is broken."""

    def quality(self, trial: Trial) -> dict[str, Any]:
        """Figures of the run."""
        return {}

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        from ..scenarios import judge  # which all scenarios stand beside, these too

        (trial,) = trials
        return judge.verdict(trial, judge.common_checks(trial.run), figures=self.quality(trial))


@final
@dataclass(frozen=True)
class Record:
    """What happened in one closed loop of N ticks.

    q (N + 1, nq) and v (N + 1, nv) are the states, the last one behind the last tick; a (N, nv), tau (N, nj) and
    forces (N, contacts, 3 or 6) the answers where the level has them.
    """

    q: Vec
    v: Vec
    a: Vec
    tau: Vec
    forces: Vec

    @classmethod
    def of(cls, trial: Trial) -> Record:
        """The record of a trial on a plant that integrates."""
        run, plant, contacts = trial.run, trial.setup.plant, trial.setup.stack.contacts
        nothing = np.zeros((run.rows, 0))
        forces = [run[f"f.{contact.name}"] for contact in contacts]
        return cls(
            q=np.vstack([run["q"], plant.q]), v=np.vstack([run["v"], plant.v]),
            a=run["a"] if "a" in run else nothing, tau=run["tau"] if "tau" in run else nothing,
            forces=np.stack(forces, axis=1) if forces else np.zeros((run.rows, 0, 0)),
        )  # fmt: skip

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.a)


@final
@dataclass(frozen=True)
class Problem:
    """What a workload asks of a robot: the stack, and how its result is judged."""

    stack: Stack
    judge: Callable[[Record], dict[str, Any]]


class Workload(Certified):
    """A robot, the stack that it is given, at which level and how often it ticks; see ``docs/benchmark.md``."""

    group: ClassVar[str] = "workloads"
    hierarchies = tuple(HIERARCHIES)
    recipe: ClassVar[RobotRecipe]
    level: ClassVar[Formulation]
    dt: ClassVar[float]

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
            about=problem,
        )  # fmt: skip

    def quality(self, trial: Trial) -> dict[str, Any]:
        problem: Problem = trial.about
        return problem.judge(Record.of(trial))
