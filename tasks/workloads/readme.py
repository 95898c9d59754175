"""W6: the stack that the README shows, on the humanoid of W5, with a motion of the library."""

from __future__ import annotations

from typing import Any, ClassVar, final

from wbc.stack.formulation import InverseDynamics
from wbc.stack.stack import Stack

from .. import (
    CenterOfMass,
    JointPositionLimits,
    JointVelocityLimits,
    Orientation,
    Posture,
    Sinusoid,
    Sole,
    TorqueLimits,
)
from .quality import SoleSupport, angle, distance
from .robots import TALOS, MadeRobot
from .workload import Problem, Workload

_FEET = ("left_sole_link", "right_sole_link")
_TORSO = "torso_2_link"
_FRICTION = 0.6
_HALF_SIZE = (0.10, 0.065)


@final
class ReadmeStack(Workload):
    """The centre of mass sways sideways by a ``Sinusoid``, the torso stays upright, the soles stand."""

    name: ClassVar = "W6"
    summary: ClassVar = "readme: inverse dynamics of a humanoid, the stack of the README"
    recipe: ClassVar = TALOS
    level: ClassVar = InverseDynamics()
    dt: ClassVar = 1e-3
    duration: ClassVar = 4.0

    def problem(self, made: MadeRobot, ticks: int) -> Problem:
        sway = Sinusoid(made.com(), amplitude=[0.0, 0.04, 0.0], frequency=0.4)
        upright = made.placement(_TORSO).rotation
        stack = Stack(
            [
                CenterOfMass(target=sway, kp=100),
                Orientation(_TORSO, target=upright, kp=100, weight=0.1),
                Posture(made.q0, kp=10, weight=1e-3),
            ],
            contacts=[Sole(foot, half_size=_HALF_SIZE, friction=_FRICTION) for foot in _FEET],
            subject_to=[TorqueLimits(), JointVelocityLimits(), JointPositionLimits()],
        )
        torso = made.reference.getFrameId(_TORSO)
        supports = [SoleSupport(foot, _FRICTION, _HALF_SIZE) for foot in _FEET]

        def errors(data: Any, k: int) -> tuple[float, float]:
            return distance(sway(k * self.dt)[0], data.com[0]), angle(upright, data.oMf[torso].rotation)

        return Problem(stack, errors, supports=supports)
