"""Single: what scenarios have in common that run on one plant and under one hierarchy."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping
from typing import Any, ClassVar, final

from wbc.errors import UnknownRobot
from wbc.sim.scenario import Progress, Scenario, ScenarioResult


class Single(Scenario):
    """A scenario with nothing to choose but its parameters, and with robots that it knows."""

    #: The values that the parameter ``robot`` may have, None: any; and what the scenario knows of them.
    robots: ClassVar[Collection[str] | None] = None
    knows: ClassVar[str] = "how these stand"

    @final
    def run(
        self,
        parameters: Mapping[str, Any],
        *,
        solver: str,
        hierarchy: str,
        duration: float,
        plant: str,
        progress: Progress,
    ) -> ScenarioResult:
        del hierarchy, plant  # there is one of each
        if self.robots is not None and parameters["robot"] not in self.robots:
            raise UnknownRobot(parameters["robot"], self.robots, f"{self.name} knows {self.knows}")
        return self.play(parameters, solver, duration, progress)

    @abstractmethod
    def play(self, parameters: Mapping[str, Any], solver: str, duration: float, progress: Progress) -> ScenarioResult:
        """Do it, as :meth:`~wbc.sim.scenario.Scenario.run` says."""
