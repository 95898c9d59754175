"""RobotKinematics: LeRobot's calls in degrees; the oracle is Pinocchio's own forward kinematics and the limits."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

import wbc
from tests.robots.builders import sliding
from wbc.errors import InvalidInput, UnknownFrame, UnknownJoint
from wbc.robots import RobotKinematics

URDF = Path(wbc.__file__).parent / "models" / "robots" / "arm.urdf"
ARM = RobotKinematics(URDF, "tool")
START = np.array([0.0, 20.0, 0.0, 80.0, 0.0, 45.0, 0.0])
FAR = np.array([3.0, 0.0, 0.4])
LOW, HIGH = (np.rad2deg(x) for x in (ARM.robot.limits.q_min, ARM.robot.limits.q_max))


def pose_by_pinocchio(degrees: np.ndarray) -> np.ndarray:
    model = pinocchio.buildModelFromUrdf(str(URDF))
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.deg2rad(degrees))
    return data.oMf[model.getFrameId("tool")].homogeneous


def drawn(seed: int) -> np.ndarray:
    share = np.random.default_rng(seed).uniform(0.1, 0.9, 7)
    return (1.0 - share) * np.maximum(LOW, -180.0) + share * np.minimum(HIGH, 180.0)


def test_calls_are_those_of_lerobot():
    init, forward, inverse = (
        list(inspect.signature(one).parameters.items())
        for one in (RobotKinematics, ARM.forward_kinematics, ARM.inverse_kinematics)
    )
    assert [(name, one.default) for name, one in init][1:] == [
        ("target_frame_name", "gripper_frame_link"),
        ("joint_names", None),
    ]
    assert init[0][0] == "urdf_path" and [name for name, _ in forward] == ["joint_pos_deg"]
    assert [name for name, _ in inverse[:2]] == ["current_joint_pos", "desired_ee_pose"]
    assert [(name, one.default) for name, one in inverse[2:]] == [
        ("position_weight", 1.0),
        ("orientation_weight", 0.01),
    ]


@given(seed=st.integers(0, 2**32 - 1))
def test_forward_kinematics_is_that_of_pinocchio(seed: int):
    np.testing.assert_allclose(ARM.forward_kinematics(drawn(seed)), pose_by_pinocchio(drawn(seed)), atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_pose_nearby_is_reached_within_the_limits(seed: int):
    start = drawn(seed)
    goal = np.clip(start + np.random.default_rng(seed).uniform(-10.0, 10.0, 7), LOW, HIGH)
    there = ARM.inverse_kinematics(start, pose_by_pinocchio(goal))
    assert ARM.found.ok, ARM.found.reason
    np.testing.assert_allclose(pose_by_pinocchio(there), pose_by_pinocchio(goal), atol=1e-4)
    assert (there >= LOW - 1e-6).all() and (there <= HIGH + 1e-6).all()
    assert np.abs(there - start).max() < 90.0, "it goes to another branch"


def on_circle(pose: np.ndarray, angle: float) -> np.ndarray:
    """A pose moved along a circle of 8 cm, upright and across."""
    moved = pose.copy()
    moved[:3, 3] += 0.08 * np.array([0.0, np.sin(angle), np.cos(angle) - 1.0])
    return moved


def test_a_stream_of_poses_has_no_jumps():
    q, pose, steps = START, ARM.forward_kinematics(START), []
    for k in range(100):
        goal = on_circle(pose, 0.063 * k)
        moved = ARM.inverse_kinematics(q, goal)
        steps.append(np.abs(moved - q).max())
        q = moved
        assert np.abs(ARM.forward_kinematics(q) - goal).max() < 1e-4
    assert max(steps) < 5.0


def test_what_cannot_be_met_is_weighed_from_every_start():
    """Five joints follow a circle with an orientation that they cannot keep; the oracle is least squares of SciPy."""
    arm = RobotKinematics(URDF, "tool", ARM.joint_names[:5])
    q, pose = START[:5], arm.forward_kinematics(START[:5])

    def residual(degrees: np.ndarray, goal: np.ndarray) -> np.ndarray:
        there = arm.forward_kinematics(degrees)
        return np.concatenate([there[:3, 3] - goal[:3, 3], 0.1 * pinocchio.log3(goal[:3, :3].T @ there[:3, :3])])

    for k in range(20):
        goal = on_circle(pose, 0.1 * k)
        q = arm.inverse_kinematics(q, goal)
        best = least_squares(residual, q, args=(goal,), x_scale=10.0)
        assert residual(q, goal) @ residual(q, goal) <= 1.001 * residual(best.x, goal) @ residual(best.x, goal) + 1e-12
    assert not arm.found.ok and np.abs(residual(q, goal)[:3]).max() < 0.01


def test_weights_leave_out_what_is_0_and_a_gripper_comes_back():
    start = np.array([*START, 33.0])
    goal = ARM.forward_kinematics(start)
    goal[:3, :3] = goal[:3, :3] @ pinocchio.exp3(np.array([0.0, 0.5, 0.0]))
    place = ARM.inverse_kinematics(start, goal, orientation_weight=0.0)
    np.testing.assert_allclose(place, start, atol=1e-6)  # it is there already, and 33 is the gripper
    turned = ARM.inverse_kinematics(start, goal, position_weight=0.0)
    np.testing.assert_allclose(ARM.forward_kinematics(turned)[:3, :3], goal[:3, :3], atol=1e-4)
    assert len(turned) == 8 and turned[7] == 33.0
    with pytest.raises(InvalidInput, match="nothing to reach"):
        ARM.inverse_kinematics(start, goal, 0.0, 0.0)


def test_out_of_reach_ends_near_and_says_so():
    begin = ARM.forward_kinematics(START)
    there = ARM.forward_kinematics(ARM.inverse_kinematics(START, pinocchio.SE3(begin[:3, :3], FAR).homogeneous))
    assert not ARM.found.ok and "Position" in ARM.found.reason
    assert there[0, 3] > begin[0, 3] + 0.1, "it goes nearer"


def test_joints_in_another_order_and_joints_that_are_not_named():
    names = list(ARM.joint_names)
    back, some = RobotKinematics(URDF, "tool", names[::-1]), RobotKinematics(URDF, "tool", names[:6])
    q = drawn(1)
    np.testing.assert_allclose(back.forward_kinematics(q[::-1]), ARM.forward_kinematics(q))
    goal = some.forward_kinematics(q[:6])
    goal[2, 3] -= 0.02
    there = some.inverse_kinematics(q[:6], goal, orientation_weight=0.0)
    assert some.found.ok and abs(some.found.q[6] - some.robot.q0[6]) < 1e-9 and there.shape == (6,)


def test_joints_that_slide_have_no_degrees(tmp_path: Path):
    sliding(tmp_path)
    with pytest.raises(InvalidInput, match="joint 'gripper' slides"):
        RobotKinematics(tmp_path / "own.urdf", "l4")
    angles = RobotKinematics(tmp_path / "own.urdf", "l4", ["base", "lift", "elbow"])
    turned = angles.forward_kinematics([90.0, 0.0, 0.0])
    np.testing.assert_allclose(turned[:3, :3] @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-12)


def test_names_and_shapes_are_checked():
    with pytest.raises(UnknownFrame):
        RobotKinematics(URDF)
    with pytest.raises(UnknownJoint):
        RobotKinematics(URDF, "tool", ["gripper"])
    with pytest.raises(InvalidInput, match="4 entries for 7 joints"):
        ARM.forward_kinematics(np.zeros(4))
    with pytest.raises(InvalidInput, match="desired_ee_pose"):
        ARM.inverse_kinematics(np.zeros(7), np.eye(3))
