"""Two hands sent to one point, of ten robots: every pair keeps its margin to 1 mm, and the robot comes to rest."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import wbc
from tasks import CollisionAvoidance, JointLimits, Position, Posture
from wbc.models.collision import Distances

#: Hands that slide along each other take some seconds to where both are nearest to their target.
MARGIN, DT, SECONDS = 0.03, 2e-3, 10.0
HANDS = {
    "g1": ("left_rubber_hand", "right_rubber_hand"),
    "baxter": ("left_gripper_base_link", "right_gripper_base_link"),
    "tiago_dual": ("arm_left_tool_link", "arm_right_tool_link"),
    "tiago_pro": ("arm_left_tool_link", "arm_right_tool_link"),
    "pr2": ("l_gripper_palm_link", "r_gripper_palm_link"),
    "talos": ("gripper_left_base_link", "gripper_right_base_link"),
    "icub": ("l_hand", "r_hand"),
    "romeo": ("l_wrist", "r_wrist"),
    "alex": ("LeftGripperYawLink", "RightGripperYawLink"),
    "humanoid": ("left_hand", "right_hand"),
}


@pytest.mark.deep
@pytest.mark.parametrize("name", HANDS)
def test_hands_that_meet_keep_the_margin_and_come_to_rest(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of mimic joints and limits in the files
        robot: Any = wbc.load(name, base="fixed")
    state, q, v = robot.state(), np.array(robot.q0), np.zeros(robot.nv)
    middle = 0.5 * sum(state.frame(hand).position for hand in HANDS[name])
    tasks = [*(Position(hand, target=middle) for hand in HANDS[name]), Posture(q, weight=1e-3)]
    v_max = np.where(robot.limits.v_max > 0.0, robot.limits.v_max, 1.0)
    limits = [JointLimits(v_max=v_max), CollisionAvoidance(margin=MARGIN)]
    controller = wbc.Controller(robot, wbc.Stack(tasks, subject_to=limits), level=wbc.VelocityLevel(), dt=DT)
    everything, nearest, speeds = Distances(robot, margin=MARGIN, reach=0.2, count=10_000), [], []
    for k in range(round(SECONDS / DT)):
        command = controller.tick(k * DT, q, v)
        assert command.status.ok, controller.why
        q, v = command.q, command.v
        speeds.append(float(np.abs(v).max()))
        if k % 10 == 0:
            state.update(k * DT, q, v)
            everything.read(state)
            nearest.append(everything.distance.min())
    assert min(nearest) > MARGIN - 1e-3
    assert max(speeds[-round(0.5 / DT) :]) < 0.1
