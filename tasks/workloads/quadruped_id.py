"""W4: inverse dynamics of a quadruped on four points; its target needs more acceleration than friction allows."""

from __future__ import annotations

from typing import Any, ClassVar, final

from wbc.stack.formulation import InverseDynamics
from wbc.stack.stack import Stack
from wbc.stack.task import Objective

from .. import CenterOfMass, JointVelocityLimits, Orientation, Point, Posture, TorqueLimits
from .quality import PointSupport, angle, distance
from .references import sway, times
from .robots import GO2, MadeRobot
from .workload import Problem, Workload

_FEET = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")
_BASE = "base"
_FRICTION = 0.5


@final
class QuadrupedInverseDynamics(Workload):
    """The centre of mass sways, the base keeps its orientation, the feet stand."""

    name: ClassVar = "W4"
    summary: ClassVar = "quadruped-id: inverse dynamics of a quadruped whose target needs more than friction allows"
    recipe: ClassVar = GO2
    level: ClassVar = InverseDynamics(regularisation=1e-8)
    dt: ClassVar = 1e-3
    duration: ClassVar = 4.0

    def problem(self, made: MadeRobot, ticks: int) -> Problem:
        com = sway(times(ticks, self.dt), [0.02, 0.03, 0.03], [0.7, 2.0, 1.0]).moved(made.com())
        upright = made.placement(_BASE).rotation
        levels: list[list[Objective]] = [
            [
                CenterOfMass(target=com.track(self.dt), kp=100.0),
                Orientation(_BASE, target=upright, kp=100.0),
            ],
            [Posture(made.q0, kp=10.0, weight=1e-4)],
        ]
        stack = Stack(
            levels,
            subject_to=[TorqueLimits(), JointVelocityLimits()],
            contacts=[
                Point(foot, friction=_FRICTION, friction_model="outer", kp=100.0, kd=20.0, force_weight=1e-6)
                for foot in _FEET
            ],
        )
        base = made.reference.getFrameId(_BASE)
        supports = [PointSupport(foot, _FRICTION) for foot in _FEET]

        def errors(data: Any, k: int) -> tuple[float, float]:
            return distance(com.position[k], data.com[0]), angle(upright, data.oMf[base].rotation)

        return Problem(stack, errors, supports=supports)
