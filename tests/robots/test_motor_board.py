"""MotorBoard: motors follow the law through the device's frames, late, within limits, and stop when orders stop."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
import pytest

import wbc
from tests.robots.builders import board_of, go2
from wbc.errors import InvalidInput
from wbc.robots import Franka, LeRobot, MotorBoard, Ros2Control, Sensors
from wbc.robots.device import Device, Order, Reading
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import ForwardDynamicsPlant

pytest.importorskip("mujoco")
pytestmark = pytest.mark.physics
ARM = wbc.load("arm")


def board_for(device: Device | None = None, **settings: Any) -> Any:
    return board_of(device or Ros2Control(ARM.joint_names, rate=500.0), ARM, **settings)


def readings(board: MotorBoard, seconds: float) -> list[Reading]:
    found = []
    for _ in range(round(seconds / 1e-3)):
        board.sleep(1e-3)
        if (frame := board.receive()) is not None:
            found.append(board.device.unpack(frame))
    return found


def test_states_come_at_the_rate_of_the_device_and_late():
    board, arrived, said = board_for(state_delay=5e-3), [], []
    for k in range(1, 101):
        for reading in readings(board, 1e-3):
            arrived.append(1e-3 * k)
            said.append(reading.time)
    np.testing.assert_allclose(np.subtract(arrived, said), 5e-3, atol=1e-9)
    np.testing.assert_allclose(np.diff(said), 2e-3, atol=1e-9)


def test_orders_act_late_and_a_plant_gets_their_torques():
    board = board_for(delay=7e-3)
    board.send(np.full(7, 0.5))
    given = {}
    for k in range(12):
        board.sleep(1e-3)
        given[k] = board._tau.copy()
    assert all((given[k] == 0.5).all() == (k >= 7) for k in given)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_failing_motor_fails_here_as_in_a_simulation_and_torques_are_cut_at_their_limits(share: float):
    most = ARM.limits.tau_max
    fault = ActuatorFault(joint="elbow", effectiveness=share, start=0.05)
    board = board_for(disturbances=[fault], timeout=1.0)
    board.send(2.0 * most)
    said = np.array([reading.tau for reading in readings(board, 0.1)])
    left = np.ones((len(said), ARM.nj))
    left[25:, ARM.joint("elbow")] = share
    np.testing.assert_allclose(said, left * most, rtol=1e-6)


@pytest.mark.parametrize("make", [ForwardDynamicsPlant, MujocoPlant])
def test_a_hand_is_stronger_than_a_motor_at_its_limit(make: Any):
    """Oracle: M Δa = hand, with the motors at their limits in both runs."""
    hand, velocities = 2.0 * ARM.limits.tau_max, []
    for push in (0.0, 1.0):
        board = MotorBoard(Ros2Control(ARM.joint_names, rate=500.0, interface="effort"), make(ARM, dt=1e-4))
        board.send(10.0 * ARM.limits.tau_max)
        board.hand[:] = push * hand
        board.sleep(1e-4)
        velocities.append(board.plant.v)
    state = ARM.state()
    state.update(0.0, ARM.q0, np.zeros(ARM.nv))
    change = state.M @ (velocities[1] - velocities[0]) / 1e-4
    np.testing.assert_allclose(change, hand, rtol=1e-2, atol=1e-2 * hand.max())


def test_an_own_controller_keeps_the_posture_before_the_first_order():
    board = board_for()
    readings(board, 1.0)
    assert np.abs(board.plant.q - ARM.q0).max() < 0.06 and np.abs(board.plant.v).max() < 0.1


@pytest.mark.parametrize("on_timeout", ["hold", "damp", "limp"])
def test_what_motors_do_when_orders_stop(on_timeout: str):
    board = board_for(timeout=0.05, on_timeout=on_timeout)
    board.send(np.full(7, 2.0))
    board.sleep(0.049)
    assert (board._tau == 2.0).all()
    board.sleep(0.1)
    v = board.plant.v
    board.sleep(1e-3)
    wanted = {"hold": np.full(7, 2.0), "limp": np.zeros(7), "damp": -board._damping * v}[on_timeout]
    np.testing.assert_allclose(board._tau, wanted)


def test_a_frame_that_is_not_taken_counts_and_changes_nothing():
    board = board_for()
    board.send(np.ones(7))
    board.sleep(2e-3)
    board.send(np.full(7, np.nan))
    board.sleep(2e-3)
    assert board.refused == 1 and "nan" in board.why and (board._tau == 1.0).all()


def test_positions_through_signs_gears_and_degrees_reach_the_joints():
    device = LeRobot(ARM.joint_names)
    joint_map = device.joint_map(ARM, sign={"elbow": -1}, gear={"wrist_pitch": 3.0}, offset={"elbow": 20.0})
    board = board_for(device, joint_map=joint_map, timeout=10.0)
    goal = ARM.q0 + 0.1
    board.send(device.encode(Order(joint_map.position_to_device(goal)), board._last))
    last = readings(board, 2.0)[-1]
    assert np.abs(board.plant.q - goal).max() < 0.06  # drives sag under gravity
    np.testing.assert_allclose(joint_map.position_from_device(last.q), board.plant.q, atol=1e-3)


def test_gravity_is_added_by_robots_that_do_so():
    device = Franka()
    names = dict(zip(ARM.joint_names, device.motors, strict=True))
    board = board_for(device, joint_map=device.joint_map(ARM, names=names), timeout=10.0)
    board.send(np.zeros(7))
    before = board.plant.q
    board.sleep(0.2)
    np.testing.assert_allclose(board.plant.q, before, atol=1e-3)


def test_noise_is_that_of_its_seed_and_of_the_size_asked_for():
    def noisy(seed: int) -> Any:
        sensors = Sensors(joint_position=1e-3, joint_velocity=0.05, joint_torque=0.2)
        board = board_for(sensors=sensors, seed=seed)
        return np.array([np.concatenate([r.q, r.dq, r.tau]) for r in readings(board, 2.0)])

    one, same, other = noisy(1), noisy(1), noisy(2)
    assert (one == same).all() and not (one == other).any()
    settled = np.diff(one[500:], axis=0).std(axis=0) / np.sqrt(2.0)
    np.testing.assert_allclose(settled[:7], 1e-3, rtol=0.2)
    np.testing.assert_allclose(settled[7:14], 0.05, rtol=0.2)
    np.testing.assert_allclose(settled[14:], 0.2, rtol=0.2)


def test_an_imu_sees_how_its_robot_stands_and_is_turned():
    robot, mounted = wbc.load("quadruped", base="fixed"), pinocchio.exp3(np.array([0.0, 0.0, np.pi / 2]))
    device, joint_map = go2(robot)
    board = MotorBoard(device, MujocoPlant(robot), joint_map=joint_map, imu=mounted)
    attitude = pinocchio.exp3(np.array([0.3, 0.0, 0.0]))
    board.tilt(attitude)
    reading = readings(board, 0.1)[-1]
    R = pinocchio.Quaternion(reading.quaternion).toRotationMatrix()
    np.testing.assert_allclose(R, attitude @ mounted, atol=1e-6)
    np.testing.assert_allclose(R @ reading.acceleration, [0.0, 0.0, 9.81], atol=1e-5)
    np.testing.assert_allclose(board.plant.physics.opt.gravity, attitude.T @ [0.0, 0.0, -9.81])


@pytest.mark.parametrize("seconds", [-1.0, np.nan, np.inf])
def test_time_goes_on_and_never_back(seconds: float):
    board = board_for()
    with pytest.raises(InvalidInput, match="seconds"):
        board.sleep(seconds)
    board.sleep(0.01)
    assert board.clock() == pytest.approx(0.01)


def test_a_robot_is_held_at_an_attitude_by_physics_alone():
    group = Ros2Control(ARM.joint_names)
    with pytest.raises(InvalidInput, match="ForwardDynamicsPlant has a gravity that cannot be turned"):
        MotorBoard(group, ForwardDynamicsPlant(ARM)).tilt(np.eye(3))
    with pytest.raises(InvalidInput, match="attitude"):
        MotorBoard(group, MujocoPlant(ARM)).tilt(2.0 * np.eye(3))
