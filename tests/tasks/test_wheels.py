"""Wheels as constraints turn a floating body into a driven one: its motion is that of the textbook."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import JointVelocity, OmniWheel, Orientation, Position, Posture, Rolling
from tests.tasks.mechanisms import cart, omni_cart
from tests.tasks.rows_of import finite, moment, rows
from wbc.models.model import RobotModel
from wbc.testing import check_task, moments, robots

R, HALF_TRACK = 0.1, 0.2
LEVELS = [wbc.VelocityLevel(), wbc.AccelerationLevel()]


@pytest.fixture(scope="module")
def two_wheels(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return cart(tmp_path_factory.mktemp("cart"))


@pytest.fixture(scope="module")
def four_wheels(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return omni_cart(tmp_path_factory.mktemp("omni"))


def on_the_ground(robot: RobotModel, yaw: float = 0.0) -> np.ndarray:
    q = np.array(robot.q0)
    q[:7] = [0.0, 0.0, R, 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)]
    return q


def driven(
    robot: RobotModel, constraints: list[Any], wheels: np.ndarray, yaw: float, level: Any = LEVELS[0]
) -> np.ndarray:
    """Velocity (nv,) of the robot when its wheels turn as asked; its body stays level."""
    upright = [Orientation("body", weight=[1.0, 1.0, 0.0], kp=0.0), Position("body", target=[R], axes="z", kp=0.0)]
    stack = wbc.Stack(
        [JointVelocity(wheels, kd=50.0), *upright], subject_to=[constraint.exactly() for constraint in constraints]
    )
    controller = wbc.Controller(robot, stack, level=level, dt=1e-3)
    q, v = on_the_ground(robot, yaw), np.zeros(robot.nv)
    for tick in range(1 if level.order == 1 else 400):
        command = controller.tick(1e-3 * tick, q, v)
        assert command.status.ok
        v = command.v
    return v


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
@pytest.mark.parametrize(("left", "right"), [(2.0, 2.0), (1.0, 3.0), (-1.0, 1.0)])
def test_two_rolling_wheels_are_a_differential_drive(two_wheels: RobotModel, left: float, right: float, level: Any):
    constraints = [Rolling(f"{side}_wheel", radius=R) for side in ("left", "right")]  # both forbid going sideways
    v = driven(two_wheels, constraints, np.array([left, right]), 0.7, level)
    np.testing.assert_allclose(v[:3], [R * (left + right) / 2, 0.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(v[3:6], [0.0, 0.0, R * (right - left) / (2 * HALF_TRACK)], atol=1e-4)


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.floats(-3.0, 3.0))
def test_four_mecanum_wheels_go_every_way(four_wheels: RobotModel, twist: list[float], yaw: float):
    """Each wheel drives along the axle of its roller, at ±45° to its heading, and slips across it."""
    vx, vy, wz = twist
    names = four_wheels.joint_names
    rollers = {"front_left": 1, "front_right": -1, "rear_left": -1, "rear_right": 1}
    speeds = []
    for name in names:
        x, y = (0.3 if "front" in name else -0.3), (0.2 if "left" in name else -0.2)
        hub = np.array([vx - wz * y, vy + wz * x])
        speeds.append((hub[0] + rollers[name] * hub[1]) / R)
    constraints = [OmniWheel(f"{n}_wheel", radius=R, roller=rollers[n] * np.pi / 4) for n in names]
    v = driven(four_wheels, constraints, np.array(speeds), yaw)
    np.testing.assert_allclose(v[[0, 1, 5]], [vx, vy, wz], atol=1e-4)


def test_a_wheel_in_the_air_comes_down_to_the_ground(two_wheels: RobotModel):
    constraints = [Rolling("left_wheel", radius=R, ground=0.0), OmniWheel("right_wheel", radius=R, ground=0.0)]
    stack = wbc.Stack(
        [Posture([0.0, 0.0], weight=1e-3)], subject_to=[constraint.exactly() for constraint in constraints]
    )
    controller = wbc.Controller(two_wheels, stack, level=wbc.AccelerationLevel(), dt=0.01)
    q, v = on_the_ground(two_wheels), np.zeros(two_wheels.nv)
    q[2] += 0.05
    for tick in range(150):
        command = controller.tick(0.01 * tick, q, v)
        q, v = command.q, command.v
    assert q[2] == pytest.approx(R, abs=1e-4)


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
def test_a_wheel_that_leans_still_rolls_and_one_that_lies_is_finite(robot: RobotModel):
    frame, first = robot.frame_names[-1], moments(robot, count=1)[0]
    state = moment(robot, *first[1:])
    up = state.frame(frame).rotation.T @ [0.0, 0.0, 1.0]
    assert finite(rows(Rolling(frame, radius=0.1, axle=up, ground=0.0), state))
    beside = up + 0.3 * np.cross(up, [1.0, 0.0, 0.0])
    check_task(Rolling(frame, radius=0.1, axle=beside, ground=0.0), robot, [first, first])
