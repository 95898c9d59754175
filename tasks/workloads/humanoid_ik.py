"""W2: inverse kinematics of a humanoid on two feet whose speed limits bind after a step of both hands."""

from __future__ import annotations

from typing import Any, ClassVar, final

import numpy as np
import pinocchio as pin

from wbc.stack.formulation import VelocityLevel
from wbc.stack.stack import Stack

from .. import CenterOfMass, Frame, JointPositionLimits, JointVelocityLimits, Posture, Samples
from .quality import distance
from .references import step, sway, times
from .robots import G1, MadeRobot
from .workload import Problem, Workload

_FEET = ("left_ankle_roll_link", "right_ankle_roll_link")
_HANDS = ("left_wrist_yaw_link", "right_wrist_yaw_link")


@final
class HumanoidInverseKinematics(Workload):
    """Feet stay, the centre of mass sways, the hands circle; everything deadbeat, told apart by weights only."""

    name: ClassVar = "W2"
    summary: ClassVar = "humanoid-ik: inverse kinematics of a humanoid whose speed limits bind as its hands step"
    recipe: ClassVar = G1
    level: ClassVar = VelocityLevel(regularisation=1e-8)
    dt: ClassVar = 2e-3
    step_time: ClassVar = 3.0
    duration: ClassVar = 6.0

    def problem(self, made: MadeRobot, ticks: int) -> Problem:
        t = times(ticks, self.dt)
        com = sway(t, [0.02, 0.03, 0.02], [0.4, 0.5, 0.3]).moved(made.com()).position
        feet = [made.placement(foot) for foot in _FEET]
        hands = []
        for hand, phase in zip(_HANDS, (-0.5 * np.pi, 0.5 * np.pi), strict=True):
            start = made.placement(hand)
            circle = sway(t, [0.06, 0.04, 0.06], [0.5, 0.4, 0.5], [0.0, 0.0, phase])
            path = circle.moved(start.translation + step(t, self.step_time, [0.0, 0.0, 0.15]))
            hands.append([pin.SE3(start.rotation, position) for position in path.position])

        deadbeat = 1.0 / self.dt
        stand = [Frame(foot, target=pose, rate=deadbeat, weight=100.0) for foot, pose in zip(_FEET, feet, strict=True)]
        reach = [
            Frame(
                hand, target=Samples(poses, period=self.dt), rate=deadbeat, position_weight=1.0, orientation_weight=0.1
            )
            for hand, poses in zip(_HANDS, hands, strict=True)
        ]
        stack = Stack(
            [
                *stand,
                CenterOfMass(target=Samples(com, period=self.dt), rate=deadbeat, weight=10.0),
                *reach,
                Posture(made.q0, rate=deadbeat, weight=1e-4),
            ],
            subject_to=[JointPositionLimits(), JointVelocityLimits()],
        )
        model = made.reference
        foot_ids, hand_ids = ([model.getFrameId(frame) for frame in frames] for frames in (_FEET, _HANDS))

        def errors(data: Any, k: int) -> tuple[float, float, float]:
            where = [frame.translation for frame in data.oMf]
            return (
                max(distance(poses[k].translation, where[i]) for i, poses in zip(hand_ids, hands, strict=True)),
                distance(com[k], data.com[0]),
                max(distance(pose.translation, where[i]) for i, pose in zip(foot_ids, feet, strict=True)),
            )

        return Problem(stack, errors, ["hand_pos_m", "com_m", "foot_m"])
