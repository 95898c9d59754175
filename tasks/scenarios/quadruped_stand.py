"""A quadruped sways on four feet and takes two pushes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, final

from wbc.sim.scenario import Parameter, Progress, ScenarioResult

from .single import Single
from .standing import Demand, Stance, pushes_within, stand

STANCES: Mapping[str, Stance] = {
    "go2": Stance("base", (0.02, 0.03, 0.03), (0.7, 0.5, 1.0)),
    "quadruped": Stance("trunk", (0.02, 0.03, 0.02), (0.7, 0.5, 1.0)),
}
DEMAND = Demand(com_rms=2.5e-3, slip=1e-3)


@final
class QuadrupedStand(Single):
    """Torque control at 1 kHz in MuJoCo; pushed sideways at 1.5 s and forward at 6 s, 0.2 s each, at the trunk.

    ``push`` [N]. ``robot``: go2 (needs example-robot-data) or quadruped.
    """

    name: ClassVar[str] = "quadruped-stand"
    group: ClassVar[str] = "legs"
    takes = 15.0
    summary: ClassVar[str] = "a quadruped sways on four feet and takes two pushes"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "go2", "push": 30.0}
    robots = STANCES
    plants = ("mujoco",)
    duration = 10.0

    def play(self, parameters: Mapping[str, Any], solver: str, duration: float, progress: Progress) -> ScenarioResult:
        name = parameters["robot"]
        stance = STANCES[name]
        return stand(
            self.name, stance.robot(name), stance, pushes_within(duration, stance.upright, parameters["push"]), DEMAND,
            parameters=parameters, solver=solver, duration=duration, progress=progress,
        )  # fmt: skip
