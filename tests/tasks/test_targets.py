"""What may be given as a target, and trajectories, whose rates and accelerations are the derivatives of values."""

from __future__ import annotations

import re
from functools import partial
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import (
    CenterOfMass,
    ContactForce,
    Frame,
    MinimumJerk,
    Orientation,
    Piecewise,
    PoseInterpolation,
    Position,
    Posture,
    Samples,
    Sinusoid,
    Torque,
)
from tasks.motions import pose_motion, swing
from tests.tasks.rows_of import linear_rows, rows
from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.testing import robots
from wbc.testing.strategies import states
from wbc.types import Vec

NUMBERS = st.floats(-2.0, 2.0)
VECTORS = st.lists(NUMBERS, min_size=3, max_size=3).map(np.array)
SHARES, DURATIONS = st.floats(0.02, 0.98), st.floats(0.1, 3.0)
TURNS = VECTORS.map(lambda w: w * min(1.0, 3.0 / max(float(np.linalg.norm(w)), 1e-9)))
POSES = st.builds(lambda w, p: pinocchio.SE3(pinocchio.exp3(w), p), TURNS, VECTORS)


def moved(before: Any, after: Any) -> Vec:
    """The step from one value to another, rotations as vectors in world axes."""
    if isinstance(before, pinocchio.SE3):
        turn = pinocchio.log3(after.rotation @ before.rotation.T)
        return np.concatenate([after.translation - before.translation, turn])
    return after - before


def assert_consistent(motion: Any, t: float, size: float) -> None:
    h = 1e-5
    (before, rate_before, _), (_, rate, acceleration), (after, rate_after, _) = motion(t - h), motion(t), motion(t + h)
    np.testing.assert_allclose(moved(before, after) / (2 * h), rate, atol=1e-5 * size)
    np.testing.assert_allclose((rate_after - rate_before) / (2 * h), acceleration, atol=1e-4 * size)


@given(t=st.floats(0.0, 5.0), ramp=st.floats(0.1, 2.0), frequency=st.floats(0.1, 2.0))
def test_a_sinusoid_is_consistent_away_from_the_ends_of_its_ramp(t: float, ramp: float, frequency: float) -> None:
    motion = Sinusoid([1.0, 2.0], amplitude=[0.1, -0.2], frequency=frequency, phase=[0.0, 1.0], ramp=ramp)
    if abs(t - ramp) > 2e-5 and t > 2e-5:
        assert_consistent(motion, t, 10.0)


@given(*[VECTORS] * 4, DURATIONS, NUMBERS, st.floats(-0.9, 1.9).filter(lambda s: abs(s * (1 - s)) > 1e-3))
def test_a_minimum_jerk_is_consistent(start: Vec, end: Vec, u: Vec, w: Vec, T: float, t_0: float, share: float) -> None:
    motion = MinimumJerk(start, end, duration=T, start_time=t_0, start_rate=u, end_rate=w)
    assert_consistent(motion, t_0 + share * T, 1.0 + 1e3 / T**3)


@given(POSES, POSES, DURATIONS, SHARES, st.floats(0.0, 0.2))
def test_a_pose_interpolation_is_consistent(start: Any, end: Any, T: float, share: float, lift: float) -> None:
    motion = PoseInterpolation(start, end, duration=T, start_time=0.3, lift=lift)
    assert_consistent(motion, 0.3 + share * T, 1.0 + 1e3 / T**3)


@given(VECTORS, VECTORS, VECTORS, VECTORS, DURATIONS)
def test_a_minimum_jerk_keeps_its_ends_and_goes_on_uniformly(start: Vec, end: Vec, u: Vec, w: Vec, T: float) -> None:
    motion = MinimumJerk(start, end, duration=T, start_rate=u, end_rate=w)
    inside = 1e-6 * (1 + 1 / T**2)
    for t, value, rate, near in (
        (0.0, start, u, 1e-9), (T, end, w, 1e-9), (-0.5, start - 0.5 * u, u, 1e-9), (T + 2.0, end + 2.0 * w, w, 1e-9),
        (1e-10 * T, start, u, inside), ((1.0 - 1e-10) * T, end, w, inside),
    ):  # fmt: skip
        np.testing.assert_allclose(motion(t), (value, rate, np.zeros(3)), rtol=0, atol=near)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.integers(0, 4), st.floats(-1.0, 1.0))
def test_no_other_motion_between_the_same_ends_has_less_jerk(
    start: float, end: float, u: float, w: float, power: int, size: float
) -> None:
    """The jerk of any variation that vanishes at the ends up to its second derivative is orthogonal to the motion's."""
    motion = MinimumJerk([start], [end], duration=1.0, start_rate=u, end_rate=w)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    t = 0.5 * (nodes + 1.0)
    jerk = np.gradient(np.array([motion(s)[2][0] for s in np.linspace(0, 1, 2001)[1:-1]]), 1 / 2000)
    jerk = np.interp(t, np.linspace(0, 1, 2001)[1:-1], jerk)
    bump = np.polynomial.Polynomial([0, 0, 0, 1]) * np.polynomial.Polynomial([1, -1]) ** 3
    variation = (size * bump * np.polynomial.Polynomial([0, 1]) ** power).deriv(3)(t)
    with_it, without = (0.5 * weights @ (jerk + extra) ** 2 for extra in (variation, 0.0))
    assert with_it >= without - 1e-3 * (1.0 + abs(without))


@given(POSES, POSES, SHARES)
def test_a_pose_goes_straight_and_turns_about_one_axis_by_the_shortest_way(start: Any, end: Any, share: float) -> None:
    pose, rate, _ = PoseInterpolation(start, end, duration=1.0)(share)
    whole, done = moved(start, end), moved(start, pose)
    r = share**3 * (10 - 15 * share + 6 * share**2)
    np.testing.assert_allclose(done[:3], r * whole[:3], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(done[3:]), r * np.linalg.norm(whole[3:]), atol=1e-7)
    np.testing.assert_allclose(np.cross(rate[3:], whole[3:]), 0.0, atol=1e-7)


@given(POSES, POSES, st.floats(0.0, 0.2), SHARES)
def test_a_pose_begins_and_ends_at_rest_and_a_lift_is_on_top_halfway(
    start: Any, end: Any, lift: float, s: float
) -> None:
    motion, flat = (PoseInterpolation(start, end, duration=2.0, start_time=1.0, lift=x) for x in (lift, 0.0))
    for t, pose in ((0.0, start), (1.0, start), (3.0, end), (9.0, end)):
        got, rate, acceleration = motion(t)
        np.testing.assert_allclose(moved(pose, got), 0.0, atol=1e-7)
        assert not rate.any() and not acceleration.any()
    height = [motion(t)[0].translation[2] - flat(t)[0].translation[2] for t in (2.0, 1.0 + 2.0 * s)]
    assert height[0] == pytest.approx(lift) and -1e-12 <= height[1] <= lift + 1e-12


@given(st.lists(st.floats(0.0, 10.0), min_size=1, max_size=6, unique=True).map(sorted), st.floats(-1.0, 12.0))
def test_pieces_follow_one_another(starts: list[float], t: float) -> None:
    pieces = [(start, MinimumJerk([float(i)], [float(i)], duration=1.0)) for i, start in enumerate(starts)]
    assert Piecewise(pieces)(t)[0][0] == max(sum(start <= t for start in starts) - 1, 0)


@given(st.integers(1, 30), st.sampled_from([1e-3, 2e-3, 0.02]), st.floats(-1.0, 40.0))
def test_the_nearest_sample_holds(count: int, period: float, at: float) -> None:
    t = at * period
    given_at = period * np.arange(count)
    value = Samples(np.arange(count, dtype=float)[:, None], period=period)(t)[0]
    assert abs(t - given_at[int(value)]) <= np.abs(t - given_at).min() + 1e-12


@given(st.integers(0, 4999), st.sampled_from([1e-3, 2e-3, 1e-2]))
def test_a_tick_reads_its_own_sample(k: int, dt: float) -> None:
    assert Samples(np.arange(5000.0)[:, None], period=dt)(k * dt)[0] == k


def test_a_sinusoid_starts_at_its_center_and_at_rest_and_with_a_ramp_of_zero_in_full_motion() -> None:
    value, rate, acceleration = Sinusoid([3.0], amplitude=1.0, frequency=1.0, phase=0.7)(0.0)
    assert (value[0], rate[0], acceleration[0]) == (3.0, 0.0, 0.0)
    assert Sinusoid([0.0], amplitude=1.0, frequency=1.0, phase=np.pi / 2, ramp=0.0)(0.0)[0][0] == 1.0


# ---- what a task makes of a target
ARM, QUADRUPED, HUMANOID = robots()
TOOL = ARM.frame_names[-1]


@given(states(HUMANOID))
def test_a_task_at_its_target_has_no_error(state: RobotState):
    frame = state.frame("left_hand")
    here = pinocchio.SE3(frame.placement)
    for task in (
        Frame("left_hand", target=here),
        Frame("left_hand", target=here.homogeneous),
        Position("left_hand", target=frame.position),
        Orientation("left_hand", target=frame.rotation),
        CenterOfMass(target=state.com),
        Posture(state.q),
        Posture(state.q_joints),
    ):
        np.testing.assert_allclose(rows(task, state).e, 0.0, atol=1e-7)


@given(states(ARM))
def test_turning_by_the_rotation_error_reaches_the_target(state: RobotState):
    target = pinocchio.SE3.Random().rotation
    error = rows(Orientation(TOOL, target=target), state).e
    np.testing.assert_allclose(pinocchio.exp3(error) @ state.frame(TOOL).rotation, target, atol=1e-8)


def test_weights_of_position_and_orientation_may_be_said_apart():
    def weights(**given: Any) -> list[float]:
        return Frame(TOOL, target=np.eye(4), **given).weights().tolist()

    assert weights(weight=[1, 2, 3, 4, 5, 6]) == [1, 2, 3, 4, 5, 6]
    assert weights(orientation_weight=0.1) == [1, 1, 1, 0.1, 0.1, 0.1]
    assert weights(weight=5.0, position_weight=2.0) == [2, 2, 2, 5, 5, 5]


def test_a_target_may_be_assigned_between_ticks_and_is_checked_there():
    state, given = ARM.state(), np.zeros(3)
    task = Position(TOOL, target=given)
    before = rows(task, state).e.copy()
    given[:] = 100.0  # what a user changes later does not reach the task
    np.testing.assert_array_equal(rows(task, state).e, before)
    task.target = [0.0, 0.0, 1.0]
    np.testing.assert_allclose(rows(task, state).e - before, [0.0, 0.0, 1.0])
    with pytest.raises(InvalidInput, match=r"target must have shape \(3,\)"):
        task.target = [0.0, 1.0]
    np.testing.assert_allclose(rows(task, state).e - before, [0.0, 0.0, 1.0])
    assert task.target == [0.0, 0.0, 1.0]


def test_numbers_that_come_in_a_tick_are_left_to_the_certificate_but_not_shapes():
    state, broken = ARM.state(), [False]
    task = Position(TOOL, target=lambda t: np.full(3, np.nan) if broken[0] else np.zeros(3))
    task.prepare(ARM)
    broken[0] = True
    assert np.isnan(rows(task, state).e).all()
    task.target = lambda t: np.zeros(3 if t == 0.0 else 2)
    state.update(1.0, ARM.q0, np.zeros(ARM.nv))
    with pytest.raises(InvalidInput, match=r"\(3,\)"):
        rows(task, state)


FOLLOWING: dict[str, Any] = {  # tasks by what their targets are
    "position": (np.zeros(3), partial(Position, TOOL)),
    "rotation": (np.eye(3), partial(Orientation, TOOL)),
    "pose": (np.eye(4), partial(Frame, TOOL)),
    "joints": (ARM.q0, Posture),
}


@pytest.mark.parametrize("given", [None, "there", [0.0, None, 0.0], 1j], ids=repr)
@pytest.mark.parametrize("kind", FOLLOWING)
def test_a_target_that_is_no_numbers_any_more_is_named_in_its_tick(kind: str, given: Any):
    sound, task = FOLLOWING[kind]
    said = [sound]
    stack = wbc.Stack([task(target=lambda t: said[0])])
    controller = wbc.Controller(ARM, stack, level=wbc.AccelerationLevel())
    at_rest = ARM.q0, np.zeros(ARM.nv)
    assert controller.tick(0.0, *at_rest).status.ok
    said[0] = given
    assert not controller.tick(1e-3, *at_rest).status.ok
    assert re.search(r"\btarget must be a", controller.why) and repr(given) in controller.why, controller.why


@given(st.one_of(states(ARM), states(HUMANOID)))
def test_the_inverse_inertia_weight_is_the_kinetic_norm_of_the_torques_of_joints(state: RobotState):
    robot = state.model
    tau_0 = np.linspace(-3.0, 5.0, robot.nj)
    out = linear_rows(Torque(tau_0, weight="inverse_inertia"), state, robot.nj)
    weight = np.linalg.inv(state.M)[robot.nb :, robot.nb :]
    np.testing.assert_allclose(out.A.T @ out.A, weight, atol=1e-8 * np.abs(weight).max())
    np.testing.assert_allclose(out.b, out.A @ tau_0, atol=1e-9)


def test_a_torque_and_a_force_are_wished_for_row_by_row():
    state = ARM.state()
    torque = linear_rows(Torque(2.0), state, 7)
    np.testing.assert_array_equal(torque.A, np.eye(7))
    np.testing.assert_array_equal(torque.b, np.full(7, 2.0))
    force = linear_rows(ContactForce("left_sole", target=[0.0, 0.0, 400.0]), state, 6)
    np.testing.assert_array_equal(force.A, np.eye(6)[:3])
    np.testing.assert_array_equal(force.b, [0.0, 0.0, 400.0])


def test_poses_may_move_along_two_motions():
    way = Sinusoid([0.0] * 3, amplitude=0.1, frequency=0.5)
    assert_consistent(pose_motion(way, swing(np.eye(3), [0, 0, 2], angle=0.3, frequency=1)), 0.4, 1e-2)


def test_what_the_refusal_of_a_quaternion_says_is_taken():
    turn = pinocchio.Quaternion(np.cos(0.5), 0.0, 0.0, np.sin(0.5))  # one radian about z
    np.testing.assert_allclose(Orientation(TOOL, target=turn.matrix()).reference(0.0).value[0, 0], np.cos(1.0))
    Frame(TOOL, target=pinocchio.SE3(turn, np.zeros(3)))
