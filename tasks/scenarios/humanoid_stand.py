"""A humanoid stands, sways, draws a circle with a hand and takes two pushes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, final

from wbc.sim.scenario import Parameter

from .estimated import PARAMETERS
from .standing import Demand, Stance, StandingScenario

#: Elbows bent, so that the circle is within reach; ankles leaning back, so that the weight is over the soles; soles
#: flat, the three pitch angles of a leg adding up to nothing [rad].
_TALOS = {
    f"{limb}_{side}_{i}_joint": angle
    for side, sign in (("left", 1.0), ("right", -1.0))
    for limb, i, angle in (("arm", 1, 0.1 * sign), ("arm", 2, 0.25 * sign), ("arm", 4, -1.2), ("leg", 3, -0.456),
                           ("leg", 4, 0.859), ("leg", 5, -0.403), ("leg", 6, 0.0))
}  # fmt: skip
STANCES: Mapping[str, Stance] = {
    "talos": Stance("torso_2_link", (0.02, 0.05, 0.03), (0.5, 0.4, 0.6), hand="gripper_left_base_link", joints=_TALOS),
    "g1": Stance("torso_link", (0.01, 0.03, 0.02), (0.4, 0.5, 0.3), hand="left_wrist_yaw_link", geometry="spheres"),
    "humanoid": Stance("torso", (0.01, 0.03, 0.02), (0.5, 0.4, 0.6), hand="left_hand"),
}
DEMANDS: Mapping[str, Demand] = {
    "talos": Demand(com_rms=1.5e-3, slip=1e-3),
    "g1": Demand(com_rms=1.5e-3, slip=4e-3),
    "humanoid": Demand(com_rms=1.5e-3, slip=2e-3),
}
PUSH: Mapping[str, float] = {"talos": 60.0, "g1": 30.0, "humanoid": 40.0}


@final
class HumanoidStand(StandingScenario):
    """Torque control at 1 kHz in MuJoCo; pushed sideways at 1.5 s and forward at 6 s, 0.2 s each, at the torso.

    ``push`` [N]; auto: as strong as is usual for the robot. ``robot``: talos, g1 (both need example-robot-data) or
    humanoid.
    ``sensors``: a set of ``wbc.robots.SENSORS`` by which the base is estimated, its errors drawn by ``seed``; or truth.
    """

    name: ClassVar[str] = "humanoid-stand"
    takes = 30.0
    summary: ClassVar[str] = "a humanoid sways on its feet, draws a circle with a hand and takes two pushes"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "talos", "push": "auto", **PARAMETERS}
    robots = stances = STANCES
    demands, usual_push = DEMANDS, PUSH
