"""W5: inverse dynamics of a humanoid on two soles that shifts nearly all its weight from one foot to the other."""

from __future__ import annotations

from typing import Any, ClassVar, final

from wbc.stack.formulation import InverseDynamics
from wbc.stack.stack import Stack
from wbc.stack.task import Objective

from .. import CenterOfMass, JointVelocityLimits, Orientation, Posture, Sole, TorqueLimits
from .quality import SoleSupport, angle, distance
from .references import sway, times
from .robots import TALOS, MadeRobot
from .workload import Problem, Workload

_FEET = ("left_sole_link", "right_sole_link")
_TORSO = "torso_2_link"
_FRICTION = 0.3
_HALF_SIZE = (0.10, 0.065)


@final
class HumanoidInverseDynamics(Workload):
    """The centre of mass sways, the torso keeps its orientation, the soles stand."""

    name: ClassVar = "W5"
    summary: ClassVar = "humanoid-id: inverse dynamics of a humanoid whose weight goes from one foot to the other"
    recipe: ClassVar = TALOS
    level: ClassVar = InverseDynamics(regularisation=1e-8)
    dt: ClassVar = 1e-3
    duration: ClassVar = 4.0

    def problem(self, made: MadeRobot, ticks: int) -> Problem:
        com = sway(times(ticks, self.dt), [0.02, 0.05, 0.03], [0.5, 0.4, 0.6]).moved(made.com())
        upright = made.placement(_TORSO).rotation
        levels: list[list[Objective]] = [
            [
                CenterOfMass(target=com.track(self.dt), kp=100.0),
                Orientation(_TORSO, target=upright, kp=100.0, weight=0.1),
            ],
            [Posture(made.q0, kp=10.0, weight=1e-3)],
        ]
        stack = Stack(
            levels,
            subject_to=[TorqueLimits(), JointVelocityLimits()],
            contacts=[
                Sole(
                    foot,
                    half_size=_HALF_SIZE,
                    friction=_FRICTION,
                    friction_model="outer",
                    kp=100.0,
                    kd=20.0,
                    force_weight=1e-6,
                )
                for foot in _FEET
            ],
        )
        torso = made.reference.getFrameId(_TORSO)
        supports = [SoleSupport(foot, _FRICTION, _HALF_SIZE) for foot in _FEET]

        def errors(data: Any, k: int) -> tuple[float, float]:
            return distance(com.position[k], data.com[0]), angle(upright, data.oMf[torso].rotation)

        return Problem(stack, errors, supports=supports)
