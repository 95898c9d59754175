"""Runs of the shipped scenarios, and what of their verdicts they fail."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import wbc
from tasks import Damping
from tasks.scenarios import SCENARIOS
from wbc.report.document import Figure, Plot
from wbc.sim.plant import ForwardDynamicsPlant
from wbc.sim.scenario import Parameters, ScenarioResult, Settings, Trial
from wbc.sim.simulate import simulate


def run(name: str, *parameters: str, solver: str = "pdas", **chosen: Any) -> ScenarioResult:
    """A run; ``chosen`` are its duration, plant and hierarchy, as usual where nothing is said."""
    scenario = SCENARIOS[name]
    chosen = scenario.choose(**{"plant": None, "hierarchy": None, "duration": None} | chosen)
    return scenario.run(scenario.parse(parameters), Settings(**chosen, solver=solver))


def failed(result: Any) -> set[str]:
    """What a verdict, or a list of its checks, says that is not met."""
    return {check.text for check in getattr(result, "verdict", result) if not check.ok}


def pictures(result: ScenarioResult) -> list[str]:
    """Names of the figures and plots that the scenario's own sections hold."""
    return [item.name for section in result.sections for item in section.items if isinstance(item, Figure | Plot)]


def parameters(scenario: Any, *given: str, plant: str = "mujoco", duration: float = 1.0) -> Parameters:
    """As its commands would give them."""
    return Parameters(scenario.parse(given), Settings(plant, "weighted", duration))


def resting(robot: Any) -> tuple[Any, wbc.Run]:
    """A plant at rest, and two ticks in it: what a judge asks for beside what it judges."""
    plant = ForwardDynamicsPlant(robot)
    plant.reset(robot.q0)
    controller = wbc.Controller(robot, wbc.Stack([Damping()]), level=wbc.InverseDynamics())
    return plant, simulate(controller, plant, duration=2e-3)


def trial(plant: Any, about: Any, run: wbc.Run) -> Trial:
    """A trial that nobody ran, for a judge."""
    setup: Any = SimpleNamespace(robot=None, plant=plant, about=about, stack=wbc.Stack([Damping()]))
    nobody: Any = None
    return Trial("", setup, nobody, run)
