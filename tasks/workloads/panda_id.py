"""W3: inverse dynamics of a fixed arm; a step makes its torque limits and then its speed limits bind."""

from __future__ import annotations

from typing import Any, ClassVar, final

import numpy as np
import pinocchio as pin

from wbc.stack.formulation import InverseDynamics
from wbc.stack.stack import Stack

from .. import Frame, JointVelocityLimits, Posture, Samples, TorqueLimits
from .quality import angle, distance
from .references import step, sway, times
from .robots import PANDA, MadeRobot
from .workload import Problem, Workload

_TOOL = "panda_hand_tcp"


@final
class PandaInverseDynamics(Workload):
    """The hand follows a path with constant orientation, with velocity and acceleration fed forward."""

    name: ClassVar = "W3"
    summary: ClassVar = "panda-id: inverse dynamics of an arm whose torque and speed limits bind after a step"
    recipe: ClassVar = PANDA
    level: ClassVar = InverseDynamics(regularisation=1e-8)
    dt: ClassVar = 1e-3
    duration: ClassVar = 4.0

    def problem(self, made: MadeRobot, ticks: int) -> Problem:
        t = times(ticks, self.dt)
        start = made.placement(_TOOL)
        path = sway(t, [0.06, 0.10, 0.08], [0.5, 0.4, 0.6]).moved(start.translation + step(t, 1.5, [0, 0.25, 0]))
        still = np.zeros((ticks, 3))
        poses = [pin.SE3(start.rotation, position) for position in path.position]
        rates, accelerations = np.hstack([path.rate, still]), np.hstack([path.acceleration, still])
        stack = Stack(
            [
                Frame(_TOOL, target=Samples(poses, period=self.dt, rates=rates, accelerations=accelerations), kp=400.0),
                Posture(made.q0, kp=10.0, weight=1e-3),
            ],
            subject_to=[TorqueLimits(), JointVelocityLimits()],
        )
        tool = made.reference.getFrameId(_TOOL)

        def errors(data: Any, k: int) -> tuple[float, float]:
            actual = data.oMf[tool]
            return distance(poses[k].translation, actual.translation), angle(start.rotation, actual.rotation)

        return Problem(stack, errors)
