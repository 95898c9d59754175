"""A quadruped sways on four feet and takes two pushes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, final

from wbc.sim.scenario import Parameter

from .estimated import PARAMETERS
from .standing import Demand, Stance, StandingScenario

STANCES: Mapping[str, Stance] = {
    "go2": Stance("base", (0.02, 0.03, 0.03), (0.7, 0.5, 1.0)),
    "quadruped": Stance("trunk", (0.02, 0.03, 0.02), (0.7, 0.5, 1.0)),
}
DEMAND = Demand(com_rms=2.5e-3, slip=1e-3)


@final
class QuadrupedStand(StandingScenario):
    """Torque control at 1 kHz in MuJoCo; pushed sideways at 1.5 s and forward at 6 s, 0.2 s each, at the trunk.

    ``push`` [N]. ``robot``: go2 (needs example-robot-data) or quadruped.
    ``sensors``: a set of ``wbc.robots.SENSORS`` by which the base is estimated, its errors drawn by ``seed``; or truth.
    """

    name: ClassVar[str] = "quadruped-stand"
    takes = 15.0
    summary: ClassVar[str] = "a quadruped sways on four feet and takes two pushes"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "go2", "push": 30.0, **PARAMETERS}
    robots = stances = STANCES
    demands = dict.fromkeys(STANCES, DEMAND)
