"""What a state says is what a moving robot does: everything is checked against finite differences of the motion.

Along q ⊕ ε v the velocity is v and the acceleration is zero, so derivatives along it are Jacobians times v, and drifts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.models.builders import at
from tests.models.planar_oracle import ROBOTS as PLANAR
from wbc.errors import InvalidInput, UnknownFrame, UnknownJoint
from wbc.models import RobotModel, RobotState, load

FRAMES = {
    "arm": ["tool", "forearm", "base", "elbow"],
    "quadruped": ["front_left_foot", "rear_right_foot", "trunk"],
    "humanoid": ["left_sole", "right_hand", "head", "left_knee"],
}
ROBOTS = {name: load(name) for name in FRAMES} | {"arm that floats": load("arm", base="floating")} | PLANAR
STEP = 1e-5

robots = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)


def of_any_robot(test: Callable[..., None]) -> Callable[..., None]:
    """A property that is asked of every robot, wherever it is."""
    return robots(given(seed=st.integers(0, 2**32 - 1))(test))


def somewhere(robot: RobotModel, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A random configuration and velocity."""
    rng = np.random.default_rng(seed)
    return robot.random_configuration(rng), rng.normal(size=robot.nv)


def rate(robot: RobotModel, q: np.ndarray, v: np.ndarray, value: Callable[[RobotState], np.ndarray]) -> np.ndarray:
    """Derivative of a value along the motion with velocity v and no acceleration, by central difference."""
    after, before = (np.array(value(at(robot, robot.integrate(q, h * v), v))) for h in (STEP, -STEP))
    return (after - before) / (2 * STEP)


def close(actual: np.ndarray, expected: np.ndarray) -> bool:
    return bool(np.allclose(actual, expected, rtol=1e-6, atol=1e-6))


@of_any_robot
def test_world_jacobians_give_the_velocity_of_the_origin_and_the_angular_velocity(robot: RobotModel, seed: int):
    q, v = somewhere(robot, seed)
    for name in FRAMES.get(robot.name, robot.frame_names):
        frame = at(robot, q, v).frame(name)
        linear = rate(robot, q, v, lambda s, name=name: s.frame(name).position)
        spin = rate(robot, q, v, lambda s, name=name: s.frame(name).rotation) @ frame.rotation.T
        twist = frame.jacobian() @ v
        assert close(twist[:3], linear)
        assert close(pin.skew(twist[3:]), spin)


@of_any_robot
def test_local_jacobians_give_the_body_twist(robot: RobotModel, seed: int):
    q, v = somewhere(robot, seed)
    for name in FRAMES.get(robot.name, robot.frame_names):
        frame = at(robot, q, v).frame(name)
        after, before = (pin.SE3(at(robot, robot.integrate(q, h * v), v).frame(name).placement) for h in (STEP, -STEP))
        twist = pin.log6(before.actInv(after)).vector / (2 * STEP)
        assert close(frame.jacobian_local() @ v, twist)


@of_any_robot
def test_drifts_are_accelerations_without_joint_acceleration(robot: RobotModel, seed: int):
    q, v = somewhere(robot, seed)
    for name in FRAMES.get(robot.name, robot.frame_names):
        frame = at(robot, q, v).frame(name)
        assert close(frame.drift(), rate(robot, q, v, lambda s, name=name: s.frame(name).jacobian() @ s.v))
        local = rate(robot, q, v, lambda s, name=name: s.frame(name).jacobian_local() @ s.v)
        assert close(frame.drift_local(), local)


@of_any_robot
def test_the_centre_of_mass_moves_with_its_jacobian_and_drift(robot: RobotModel, seed: int):
    q, v = somewhere(robot, seed)
    state = at(robot, q, v)
    assert close(state.com_jacobian @ v, rate(robot, q, v, lambda s: s.com))
    assert close(state.com_drift, rate(robot, q, v, lambda s: s.com_jacobian @ s.v))


@of_any_robot
def test_the_centroidal_momentum_is_that_of_the_whole_mass_and_of_the_velocity_s_gradient(robot: RobotModel, seed: int):
    q, v = somewhere(robot, seed)
    state = at(robot, q, v)
    momentum = state.centroidal_map @ v
    assert close(momentum[:3], robot.mass * state.com_jacobian @ v)
    assert close(state.centroidal_drift, rate(robot, q, v, lambda s: s.centroidal_map @ s.v))
    if robot.nb:  # the base's share of M v is the whole momentum, seen from the base
        base = state.frame(robot.frame_names[0])
        linear, angular = (base.rotation @ part for part in np.split((state.M @ v)[:6], 2))
        assert close(momentum[3:], angular - np.cross(state.com - base.position, linear))


@of_any_robot
def test_the_coriolis_matrix_gives_the_bias_and_the_rate_of_the_inertia_matrix(robot: RobotModel, seed: int):
    """Property 56."""
    q, v = somewhere(robot, seed)
    state = at(robot, q, v)
    assert close(state.coriolis @ v + state.g, state.h)
    assert close(state.coriolis + state.coriolis.T, rate(robot, q, v, lambda s: s.M))


@of_any_robot
def test_gravity_is_the_weight_at_the_centre_of_mass(robot: RobotModel, seed: int):
    state = at(robot, *somewhere(robot, seed))
    assert np.allclose(state.g, -robot.mass * state.com_jacobian.T @ robot.gravity, atol=1e-9)


@of_any_robot
def test_integrate_and_difference_are_inverse(robot: RobotModel, seed: int):
    q, step = somewhere(robot, seed)
    if robot.nb:  # a turn by more than π has a shorter one
        step[3:6] *= min(1.0, 3.0 / np.linalg.norm(step[3:6]))
    assert np.allclose(robot.difference(q, robot.integrate(q, step)), step, atol=1e-9)
    assert np.allclose(robot.difference(q, q), 0.0, atol=1e-12)


@of_any_robot
def test_random_configurations_keep_the_limits(robot: RobotModel, seed: int):
    q, _ = somewhere(robot, seed)
    joints = q[robot.nq - robot.nj :]
    assert ((joints >= robot.limits.q_min) & (joints <= robot.limits.q_max)).all()
    if robot.nb:
        assert np.linalg.norm(q[:3]) <= 1.0
        assert np.linalg.norm(q[3:7]) == pytest.approx(1.0)
    assert np.array_equal(q, robot.random_configuration(np.random.default_rng(seed)))


@robots
def test_joint_views_are_the_tails_of_q_and_v(robot: RobotModel):
    q, v = somewhere(robot, 1)
    state = at(robot, q, v)
    assert np.array_equal(state.q_joints, q[-robot.nj :]) and np.array_equal(state.v_joints, v[-robot.nj :])
    assert np.shares_memory(state.q, state.q_joints) and np.shares_memory(state.v, state.v_joints)


def test_a_new_state_is_at_the_reference_configuration_and_at_rest():
    for robot in ROBOTS.values():
        state = robot.state()
        assert state.t == 0.0 and np.array_equal(state.q, robot.q0) and not state.v.any()


def test_the_state_keeps_what_it_was_given_not_the_arrays():
    robot = ROBOTS["arm"]
    q, v = somewhere(robot, 2)
    state = at(robot, q, v)
    q[:] = v[:] = np.nan
    assert np.isfinite(state.q).all() and np.isfinite(state.M).all()


def test_what_is_read_cannot_be_written():
    state = ROBOTS["humanoid"].state()
    frame = state.frame("torso")
    for array in (
        state.q, state.v, state.M, state.h, state.g, state.com, state.com_jacobian, state.com_drift,
        state.centroidal_map, state.centroidal_drift, frame.position, frame.rotation,
    ):  # fmt: skip
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


@pytest.mark.parametrize("wrong", [np.zeros(6), np.zeros(8), np.zeros((1, 7)), np.float64(0.0), 0.0, [0.0] * 7, None])
def test_a_wrong_size_is_refused_and_changes_nothing(wrong: object):
    state = at(ROBOTS["arm"], *somewhere(ROBOTS["arm"], 3))
    q, M = state.q.copy(), state.M.copy()
    with pytest.raises(InvalidInput, match=r"q must (have shape \(7,\)|be an array)"):
        state.update(1.0, wrong, np.zeros(7))  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match=r"v must (have shape \(7,\)|be an array)"):
        state.update(1.0, np.zeros(7), wrong)  # type: ignore[arg-type]
    assert state.t == 0.0 and np.array_equal(state.q, q) and np.array_equal(state.M, M)


def test_unknown_names_are_answered_with_near_ones():
    robot = ROBOTS["humanoid"]
    with pytest.raises(UnknownFrame, match="no frame 'left_foots'; did you mean 'left_foot'"):
        robot.state().frame("left_foots")
    with pytest.raises(UnknownJoint, match="no joint 'lef_knee'; did you mean 'left_knee'"):
        robot.joint("lef_knee")
    assert robot.joint_names[robot.joint("left_knee")] == "left_knee"


def test_internal_frames_are_not_frames_of_the_robot():
    assert not {"universe", "root_joint"} & set(ROBOTS["humanoid"].frame_names)
    with pytest.raises(UnknownFrame):
        ROBOTS["humanoid"].state().frame("universe")
