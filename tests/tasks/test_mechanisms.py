"""Closed loops and wheels: the same motion, torques and reactions as in coordinates of the mechanism's own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import JointVelocity, LoopClosure, OmniWheel, Orientation, Position, Posture, Rolling, Torque, feet
from tests.stack.conftest import moving, standing
from tests.tasks.mechanisms import cart, four_bar, omni_cart
from tests.tasks.rows_of import finite, moment, rows
from tests.tasks.running import obeyed
from wbc.models.model import RobotModel
from wbc.stack.component import Schedule
from wbc.stack.task_rows import TaskRows
from wbc.testing import check_task, moments, robots
from wbc.types import Mat, Vec

# ---- a loop: the joint that the tree has not, and its reaction
HUMANOID = robots()[2]


@pytest.fixture(scope="module")
def linkage(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return four_bar(tmp_path_factory.mktemp("linkage"))


def closing(**more: Any) -> LoopClosure:
    return LoopClosure("rod_end", to="rocker_end", rows=["x", "z"], target=[0, 0, 0], **more)


def loop_rows(robot: RobotModel, q: Vec, v: Vec) -> TaskRows:
    """How far the loop is open, its Jacobian and its drift."""
    loop = closing()
    return loop.rows(moment(robot, q, v), loop.target)


def closed(robot: RobotModel, crank: float) -> Vec:
    """The configuration at a crank angle: where the circles of rod and rocker meet, above the ground."""
    crank_end, pivot = 0.2 * np.array([np.cos(crank), -np.sin(crank)]), np.array([0.4, 0.0])
    apart = pivot - crank_end
    length = float(np.linalg.norm(apart))
    along = (0.45**2 - 0.3**2 + length**2) / (2.0 * length)
    up = np.array([-apart[1], apart[0]]) / length * np.sqrt(0.45**2 - along**2)
    end = crank_end + along * apart / length + up
    rod, rocker = (np.arctan2(-d[1], d[0]) for d in (end - crank_end, end - pivot))
    angles = {"crank_joint": crank, "rod_joint": rod - crank, "rocker_joint": rocker}
    q = np.array([angles[name] for name in robot.joint_names])
    assert np.abs(loop_rows(robot, q, np.zeros(3)).e).max() < 1e-12
    return q


def eliminated(robot: RobotModel, q: Vec, crank_speed: float) -> tuple[Mat, Vec, Vec]:
    """v = G s and a = G ṡ + γ for the crank's speed s: the coordinates of the mechanism, by hand."""
    crank, others = robot.joint("crank_joint"), [robot.joint("rod_joint"), robot.joint("rocker_joint")]
    J = loop_rows(robot, q, np.zeros(3)).J
    G = np.zeros(3)
    G[crank] = 1.0
    G[others] = np.linalg.solve(J[:, others], -J[:, crank])
    v = G * crank_speed
    gamma = np.zeros(3)
    gamma[others] = np.linalg.solve(J[:, others], -loop_rows(robot, q, v).drift)
    return G, v, gamma


@pytest.mark.parametrize("crank", [-0.6, 0.2, 1.0])
@pytest.mark.parametrize("speed", [0.0, 2.0])
def test_the_motor_torque_is_that_of_the_mechanism_in_its_own_coordinate(linkage: Any, crank: float, speed: float):
    q = closed(linkage, crank)
    G, v, gamma = eliminated(linkage, q, speed)
    state, motor = moment(linkage, q, v), linkage.joint("crank_joint")
    stack = wbc.Stack(
        [Posture(q, kp=0.0, kd=3.0, weight=1e6 * np.eye(3)[motor])],
        contacts=[closing()],
        subject_to=[Torque(0.0, joints=["rod_joint", "rocker_joint"], name="no motors").exactly()],
    )
    command = wbc.Controller(linkage, stack, level=wbc.InverseDynamics()).tick(0.0, q, v)
    assert command.status.ok
    a = G * (-3.0 * speed) + gamma
    np.testing.assert_allclose(command.a, a, atol=1e-6)
    assert command.tau[motor] == pytest.approx(G @ (state.M @ a + state.h), abs=1e-5)
    # The reaction is what is missing in every joint: M a + h = tau + J' f.
    out = loop_rows(linkage, q, v)
    force = command.f["rod_end"]
    np.testing.assert_allclose(state.M @ command.a + state.h, command.tau + out.J.T @ force, atol=1e-6)
    assert np.abs(np.delete(command.tau, motor)).max() < 1e-6


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()])
def test_a_loop_that_has_opened_closes_again(linkage: RobotModel, level: Any):
    q = closed(linkage, 0.3)
    q[linkage.joint("rocker_joint")] += 0.05
    controller = wbc.Controller(
        linkage, wbc.Stack([Posture(q, weight=1e-3)], contacts=[closing()]), level=level, dt=2e-3
    )
    way = [q, *(q for q, _ in obeyed(controller, 500, q))]
    opened = [np.abs(loop_rows(linkage, q, np.zeros(3)).e).max() for q in way]
    # Critically damped with kp = 100, or e^(-5 t) at the velocity level: within one second to 1 %.
    assert opened[0] > 0.01 and opened[-1] < 0.01 * opened[0] and max(opened) < 1.01 * opened[0]


def test_a_bar_in_two_hands_pulls_both_alike_and_nothing_else():
    bar = LoopClosure("left_hand", to="right_hand", rows=["x", "y", "z", "rx", "ry", "rz"], name="bar")
    stack = standing(HUMANOID)
    carrying = wbc.Stack(stack.levels, contacts=[*stack.contacts, bar], subject_to=[*stack.subject_to])
    q, v = moving(HUMANOID, seed=1)
    controller = wbc.Controller(HUMANOID, carrying, level=wbc.InverseDynamics())
    command = controller.tick(0.0, q, v)
    assert command.status.ok and command.f["bar"].shape == (6,)
    state = moment(HUMANOID, q, v)
    weight = (
        sum(state.frame(c.frame).rotation @ command.f[c.frame][:3] for c in stack.contacts)
        + HUMANOID.mass * HUMANOID.gravity
    )
    # Newton: the bar is inside the robot and accelerates none of its mass as a whole.
    np.testing.assert_allclose(weight, HUMANOID.mass * (state.com_jacobian @ command.a + state.com_drift), atol=1e-5)


def test_a_schedule_that_lets_feet_go_keeps_loops_closed():
    class Standing(Schedule):
        def contact_sets(self) -> list[list[str]]:
            return [["left_sole"]]

        def contacts(self, state: Any, last: object) -> list[str]:
            return ["left_sole"]

    bar = LoopClosure("left_hand", to="right_hand", name="bar")
    stack = wbc.Stack([Posture(HUMANOID.q0)], contacts=[*feet(HUMANOID), bar], components=[Standing()])
    v = 0.1 * np.sin(np.arange(HUMANOID.nv))
    command = wbc.Controller(HUMANOID, stack, level=wbc.InverseDynamics()).tick(0.0, HUMANOID.q0, v)
    rows = bar.rows(moment(HUMANOID, HUMANOID.q0, v))
    np.testing.assert_allclose(rows.J @ command.a + rows.drift, -bar.kd * rows.J @ v, atol=1e-6)
    assert not command.f["right_sole"].any() and command.f["bar"].shape == (3,)


# ---- wheels turn a floating body into a driven one, as in the textbook
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
    *_, (q, _) = obeyed(controller, 150, on_the_ground(two_wheels) + 0.05 * np.eye(two_wheels.nq)[2])
    assert q[2] == pytest.approx(R, abs=1e-4)


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
def test_a_wheel_that_leans_still_rolls_and_one_that_lies_is_finite(robot: RobotModel):
    frame, first = robot.frame_names[-1], moments(robot, count=1)[0]
    state = moment(robot, *first[1:])
    up = state.frame(frame).rotation.T @ [0.0, 0.0, 1.0]
    assert finite(rows(Rolling(frame, radius=0.1, axle=up, ground=0.0), state))
    beside = up + 0.3 * np.cross(up, [1.0, 0.0, 0.0])
    check_task(Rolling(frame, radius=0.1, axle=beside, ground=0.0), robot, [first, first])
