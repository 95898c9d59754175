"""Whatever samples come, and whenever: the reference is bounded, does not overshoot, and rests at the last one."""

from __future__ import annotations

import pickle
from copy import copy
from itertools import pairwise
from threading import Thread
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import Follow, JointVelocityLimits, Position
from wbc.errors import InvalidInput
from wbc.types import Mat, Vec

LIMITS = st.tuples(*[st.floats(-2.0, 2.0).map(lambda x: 10.0**x)] * 3)
LAGS = st.sampled_from([0.01, 0.1, 1.0])
SEEDS = st.integers(0, 10**6)


def limits(values: tuple[float, float, float], kind: str = "") -> dict[str, float]:
    return dict(zip((f"{kind}velocity", f"{kind}acceleration", f"{kind}jerk"), values, strict=True))


def turned(rotation: Mat, by: Any) -> Mat:
    return pinocchio.exp3(np.array(by, dtype=float)) @ rotation


def drawn_turn(rng: np.random.Generator) -> Mat:
    quaternion = rng.normal(size=4)
    return pinocchio.Quaternion(*(quaternion / np.linalg.norm(quaternion))).matrix()


def drawn_reads(rng: np.random.Generator, lag: float, reads: int) -> Vec:
    """Times of reads: steady ones, then such as a busy computer makes."""
    steps = lag * np.concatenate([np.full(reads // 2, 0.03), rng.exponential(0.05, reads - reads // 2)])
    return np.concatenate([[0.0], np.cumsum(np.minimum(steps, 0.9))])


def followed(follow: Follow, times: Vec, samples: dict[int, Any]) -> tuple[list[Any], Mat, Mat]:
    """Values, rates and accelerations; sample i is pushed before read i."""
    found = []
    for i, t in enumerate(times):
        if i in samples:
            follow.push(samples[i])
        found.append(follow(float(t)))
    return [x for x, _, _ in found], np.array([v for _, v, _ in found]), np.array([a for _, _, a in found])


def assert_bounded(times: Vec, steps: Mat, rates: Mat, seconds: Mat, most: tuple[float, float, float]) -> None:
    """Finite differences of the reference, and what it says of itself, are within the limits to rounding."""
    dt, one = np.diff(times)[:, None], 1.0 + 1e-9
    assert (abs(rates) <= most[0] * one).all() and (abs(seconds) <= most[1] * one).all()
    assert (abs(steps) <= most[0] * dt * (1.0 + 1e-6) + 1e-14).all()
    assert (abs(np.diff(rates, axis=0)) <= most[1] * dt * one + 1e-14).all()
    assert (abs(np.diff(seconds, axis=0)) <= most[2] * dt * one + 1e-14).all()


@given(LIMITS, LAGS, SEEDS, st.floats(-3.0, 1.0))
def test_a_vector_keeps_its_limits_and_stays_between_the_samples(
    most: tuple[float, float, float], lag: float, seed: int, size: float
) -> None:
    rng = np.random.default_rng(seed)
    times = drawn_reads(rng, lag, 400)
    samples = {int(i): 10.0**size * rng.normal(size=2) for i in rng.choice(400, 12)}
    values, rates, seconds = followed(Follow([0.0, 0.0], **limits(most), lag=lag), times, samples)
    assert_bounded(times, np.diff(values, axis=0), rates, seconds, most)
    hull, slack = np.array([np.zeros(2), *samples.values()]), most[2] * (lag / 60) ** 3 + 1e-14
    assert (hull.min(axis=0) - slack <= values).all() and (values <= hull.max(axis=0) + slack).all()


@given(LIMITS, LAGS, SEEDS)
def test_a_turn_keeps_its_limits_whatever_the_jump(most: tuple[float, float, float], lag: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = drawn_reads(rng, lag, 300)
    samples = {int(i): drawn_turn(rng) for i in rng.choice(300, 8)}
    values, rates, seconds = followed(Follow(np.eye(3), **limits(most, "angular_"), lag=lag), times, samples)
    steps = np.array([pinocchio.log3(b @ a.T) for a, b in pairwise(values)])
    assert_bounded(times, np.zeros_like(steps), rates, seconds, most)
    dt = np.diff(times)
    assert (np.linalg.norm(steps, axis=1) <= np.sqrt(3) * most[0] * dt * (1.0 + 1e-6) + 1e-14).all()


@given(SEEDS, st.floats(0.3, 30.0))
def test_the_rate_of_a_turn_is_how_fast_it_turns(seed: int, speed: float) -> None:
    rng = np.random.default_rng(seed)
    turn = Follow(np.eye(3), angular_velocity=speed, angular_acceleration=10 * speed, angular_jerk=200 * speed)
    times, samples = 1e-4 * np.arange(1500), {0: drawn_turn(rng), 700: drawn_turn(rng)}
    values, rates, _ = followed(turn, times, samples)
    steps = np.array([pinocchio.log3(b @ a.T) for a, b in zip(values, values[2:], strict=False)])
    np.testing.assert_allclose(steps / 2e-4, rates[1:-1], atol=1e-5 * speed * max(1.0, speed))


@given(LIMITS, LAGS, SEEDS)
def test_it_comes_to_rest_at_the_last_sample_in_about_the_least_time(
    most: tuple[float, float, float], lag: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    V, A, J = most
    way = min(V / A + A / J, 10.0) * V * rng.uniform(0.1, 3.0)
    least = 2.0 * (way / V + V / A + A / J + (way / J) ** (1 / 3))
    follow = Follow([0.0], **limits(most), lag=lag)
    follow(0.0), follow(1e-9)
    follow.push([way])
    for k in range(int(4.0 * (least + 20.0 * lag))):
        value, rate, second = follow(1.0 + 0.25 * k)
    assert value == [way] and rate == second == [0.0]


@pytest.mark.parametrize("lag", [0.02, 0.1, 0.5])
def test_it_is_its_lag_behind_samples_that_move_steadily(lag: float) -> None:
    follow = Follow([0.0], lag=lag, acceleration=50.0, jerk=1e4)
    for t in np.arange(0.0, 12 * lag, lag / 100):
        follow.push([0.2 * t])
        value, rate, _ = follow(t)
    np.testing.assert_allclose([value[0], rate[0]], [0.2 * (t - lag), 0.2], atol=0.2 * lag * 0.03)


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.6, 0.0, -0.8]])
def test_a_half_turn_goes_one_way_though_the_samples_shake_about_it(axis: list[float]) -> None:
    follow, rng = Follow(np.eye(3)), np.random.default_rng(3)
    half = turned(np.eye(3), np.pi * np.array(axis))
    for k in range(3000):
        follow.push(turned(half, 0.02 * rng.normal(size=3)))
        value, _, _ = follow(2e-3 * k)
    assert np.linalg.norm(pinocchio.log3(half @ value.T)) < 0.05


def test_turns_that_go_on_and_on_are_followed() -> None:
    follow = Follow(np.eye(3), lag=0.05)
    for t in np.arange(0.0, 20.0, 0.01):  # three turns about one axis, whichever sign a quaternion may have
        follow.push(turned(np.eye(3), [0.0, 0.0, t]))
        _, rate, _ = follow(t)
        if t > 1.0:
            np.testing.assert_allclose(rate, [0.0, 0.0, 1.0], atol=0.05)


def test_the_same_samples_and_reads_give_the_same_reference_to_the_last_bit() -> None:
    rng = np.random.default_rng(5)
    times, samples = drawn_reads(rng, 0.1, 500), {i: rng.normal(size=3) for i in range(0, 500, 7)}
    once, again = Follow(np.zeros(3)), Follow(np.zeros(3))
    first = followed(once, times, samples)[0]
    again(-3.0)
    again.reset()
    for i, t in enumerate(times):
        if i in samples:
            again.push(samples[i])
        value = again(t)[0]
        assert (value == first[i]).all() and (again(t)[0] == value).all() and (again(0.0)[0] == value).all()


def test_after_a_pause_or_when_time_is_set_back_it_goes_on_from_where_it_was() -> None:
    follow = Follow([0.0], velocity=0.5)
    values = []
    for start in (0.0, 1e9, -50.0):  # a computer that slept, another clock
        follow.push([100.0])
        values += [float(follow(start + 0.01 * k)[0][0]) for k in range(100)]
    assert 1.0 < values[-1] < 0.5 * 4.0 and (np.diff(values) >= 0.0).all()
    assert np.delete(np.diff(values), 99).max() <= 0.005 * (1 + 1e-6)


@pytest.mark.parametrize("before", [True, False])
def test_a_controller_that_was_made_follows_as_one_that_was_reset(before: bool) -> None:
    """Whether the first sample comes before the controller is made or after."""
    robot, found = wbc.load("arm"), []
    for again in (False, True):
        hand = Follow([0.4, 0.0, 0.5])
        if before:
            hand.push([0.4, 0.2, 0.5])
        stack = wbc.Stack([Position("tool", target=hand)], subject_to=[JointVelocityLimits()])
        controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel())
        if again:
            hand.reset([0.4, 0.0, 0.5])
            controller.reset()
        if again or not before:
            hand.push([0.4, 0.2, 0.5])
        found.append([controller.tick(1e-3 * k, robot.q0, np.zeros(robot.nv)).v.copy() for k in range(20)])
    np.testing.assert_array_equal(*found)
    assert (found[0][0] != found[0][-1]).any()


def test_what_is_no_sample_is_refused_and_counted_and_changes_nothing() -> None:
    pose = Follow(pinocchio.SE3.Identity())
    for bad in (np.full((4, 4), np.nan), np.eye(3), 2.0 * np.eye(4), None, "hand"):
        with pytest.raises(InvalidInput):
            pose.push(bad)
    with pytest.raises(InvalidInput):
        pose.push(np.eye(4), t=float("nan"))
    assert (pose.refused, pose.pushed) == (6, 0)
    pose(0.0)
    assert pose(1.0)[0] == pinocchio.SE3.Identity()


def test_samples_that_come_late_are_left_out_whatever_clock_they_have() -> None:
    follow = Follow([0.0])
    for t, x in ((1.7e9, 1.0), (1.7e9 + 0.02, 2.0), (1.7e9 + 0.01, 3.0), (1.7e9 + 0.02, 4.0)):
        follow.push([x], t=t)
    for k in range(9):
        value = follow(float(k))[0]
    assert value == [2.0] and (follow.pushed, follow.late) == (2, 2)


def test_samples_may_come_from_another_thread() -> None:
    follow = Follow([0.0, 0.0])
    threads = [Thread(target=lambda: [follow.push(np.full(2, k / 1000)) for k in range(1001)]) for _ in range(3)]
    for thread in threads:
        thread.start()
    for k in range(300):
        assert np.ptp(follow(1e-3 * k)[0]) == 0.0  # a sample is taken whole
    for thread in threads:
        thread.join()
    assert follow.pushed == 3003


def test_a_copy_is_another_one_that_rests_where_this_one_is() -> None:
    follow = Follow(pinocchio.SE3.Identity(), velocity=0.2, lag=0.3)
    follow.push(pinocchio.SE3(np.eye(3), np.ones(3)))
    where = [follow(0.1 * k) for k in range(5)][-1][0]
    for other in (copy(follow), pickle.loads(pickle.dumps(follow))):
        assert other(0.0)[0].isApprox(where) and not other(1.0)[1].any()
        other.push(pinocchio.SE3.Identity())
    assert follow.pushed == 1 and follow(0.5)[1].any()
