"""W1: inverse kinematics of a fixed arm with seven joints; a step makes its speed limits bind for a while."""

from __future__ import annotations

from typing import Any, ClassVar, final

import numpy as np
import pinocchio as pin

from wbc.stack.formulation import VelocityLevel
from wbc.stack.stack import Stack

from .. import Frame, JointPositionLimits, JointVelocityLimits, Posture, Samples
from .quality import angle, distance
from .references import ramp, step, sway, times
from .robots import PANDA, MadeRobot
from .workload import Problem, Workload

_TOOL = "panda_hand_tcp"


@final
class PandaInverseKinematics(Workload):
    """The hand follows a path and turns about its own z axis; everything deadbeat, in one tick."""

    name: ClassVar = "W1"
    summary: ClassVar = "panda-ik: inverse kinematics of an arm whose speed limits bind after a step"
    recipe: ClassVar = PANDA
    level: ClassVar = VelocityLevel(regularisation=1e-8)
    dt: ClassVar = 1e-3
    step_time: ClassVar = 1.5
    duration: ClassVar = 4.0

    def problem(self, made: MadeRobot, ticks: int) -> Problem:
        t = times(ticks, self.dt)
        start = made.placement(_TOOL)
        path = sway(t, [0.06, 0.10, 0.08], [0.5, 0.4, 0.6]).moved(
            start.translation + step(t, self.step_time, [0, 0.15, 0])
        )
        turns = 0.3 * ramp(t)[0] * np.sin(2.0 * np.pi * 0.3 * t)
        poses = [
            pin.SE3(start.rotation @ pin.exp3(np.array([0.0, 0.0, turn])), position)
            for turn, position in zip(turns, path.position, strict=True)
        ]
        deadbeat = 1.0 / self.dt
        stack = Stack(
            [
                Frame(_TOOL, target=Samples(poses, period=self.dt), rate=deadbeat),
                Posture(made.q0, rate=deadbeat, weight=1e-4),
            ],
            subject_to=[JointPositionLimits(), JointVelocityLimits()],
        )
        tool = made.reference.getFrameId(_TOOL)

        def errors(data: Any, k: int) -> tuple[float, float]:
            actual = data.oMf[tool]
            return distance(poses[k].translation, actual.translation), angle(poses[k].rotation, actual.rotation)

        return Problem(stack, errors, ["ee_pos_m", "ee_ori_rad"])
