"""With jerk limits an acceleration never jumps, and every other limit still holds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks import JointJerkLimits, JointLimits, JointPositionLimits, JointVelocityLimits
from wbc.stack.interval import JointIntervals
from wbc.testing import robots
from wbc.types import Vec

from .test_interval import ARM, LEVELS, beyond, bounds, limits, step, unlimited

SEEDS = st.integers(0, 2**32 - 1)


def intervals_with_jerk(rng: np.random.Generator, n: int = 60) -> JointIntervals:
    """Joints at rest amid ranges of 1 cm to 10 rad; braking takes half a tick to 1000 ticks to set in."""
    dt = 10 ** rng.uniform(-3.5, -2)
    intervals = unlimited(n, dt)
    half = 0.5 * 10 ** rng.uniform(-2, 1, n)
    B = 10 ** rng.uniform(0, 2, n)
    v_max = np.where(rng.random(n) < 0.2, np.inf, 10 ** rng.uniform(-1, 1, n))
    j_max = B / dt * 10 ** rng.uniform(-3, 0.3, n)
    for quantity, limit in (("position", half), ("velocity", v_max), ("acceleration", B), ("jerk", j_max)):
        intervals.replace(quantity, -limit, limit)
    return intervals


def chosen(habit: str, rng: np.random.Generator, n: int, ticks: int) -> Vec:
    """Which share of each interval is taken, tick by tick (ticks, n)."""
    if habit == "any":
        return rng.random((ticks, n))
    if habit == "either":
        return rng.integers(0, 2, (ticks, n)).astype(float)
    turns = rng.random((ticks, n)) < (0.0 if habit == "always up" else 0.01)
    return (np.cumsum(turns, axis=0) % 2 == 0).astype(float)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("habit", ["always up", "up and down", "any", "either"])
@given(SEEDS)
def test_from_rest_whatever_is_chosen_keeps_jerk_and_all_other_limits(level: str, habit: str, seed: int):
    rng = np.random.default_rng(seed)
    intervals = intervals_with_jerk(rng)
    n, dt = len(intervals.joint_names), intervals.dt
    jerk = limits(intervals, "jerk")[1]
    q, v, last = np.zeros(n), np.zeros(n), np.zeros(n)
    for share in chosen(habit, rng, n, ticks=300):
        lower, upper = bounds(intervals, level, q, v)
        assert (lower <= upper).all()
        q, v, a = step(level, q, v, np.clip(lower + share * (upper - lower), lower, upper), dt)
        assert (np.abs(a - last) <= jerk * dt * (1 + 1e-9) + 1e-9 * (1 + np.abs(v).max() / dt)).all()
        for quantity, value in (("position", q), ("velocity", v), ("acceleration", a)):
            assert beyond(value, limits(intervals, quantity)) <= 1e-9
        intervals.remember(a)
        last = a


@pytest.mark.parametrize("level", LEVELS)
def test_a_joint_still_gets_to_its_limits(level: str):
    constraints = [JointPositionLimits(lower=-1.0, upper=1.0), JointVelocityLimits(2.0), JointJerkLimits(200.0)]
    intervals = JointIntervals(constraints, ARM, dt=1e-3)
    q, v, fastest = np.zeros(ARM.nj), np.zeros(ARM.nj), 0.0
    for _ in range(4000):
        q, v, a = step(level, q, v, bounds(intervals, level, q, v)[1], 1e-3)
        intervals.remember(a)
        fastest = max(fastest, float(v.max()))
    np.testing.assert_allclose(q, 1.0, atol=1e-3)
    assert fastest > 1.5


@given(SEEDS, st.sampled_from(LEVELS))
def test_the_interval_is_never_empty_whatever_went_before(seed: int, level: str):
    rng = np.random.default_rng(seed)
    intervals = intervals_with_jerk(rng)
    n = len(intervals.joint_names)
    intervals.remember(rng.normal(size=n) * 10 ** rng.uniform(-3, 4, n))
    q, v = (rng.normal(size=n) * 10 ** rng.uniform(-6, 2, n) for _ in range(2))
    lower, upper = bounds(intervals, level, q, v)
    assert (lower <= upper).all() and np.isfinite(lower).all() and np.isfinite(upper).all()


@given(SEEDS, st.sampled_from(LEVELS))
def test_bounds_are_never_wider_than_without_jerk_limits(seed: int, level: str):
    rng = np.random.default_rng(seed)
    intervals = intervals_with_jerk(rng)
    n = len(intervals.joint_names)
    q, v = 0.5 * rng.normal(size=n), rng.normal(size=n)
    intervals.remember(rng.normal(size=n) * 10 ** rng.uniform(-1, 3, n))
    lower, upper = bounds(intervals, level, q, v)
    intervals.replace("jerk", -np.inf, np.inf)
    free = bounds(intervals, level, q, v)
    assert (lower >= free[0] - 1e-9 * (1 + np.abs(free[0]))).all()
    assert (upper <= free[1] + 1e-9 * (1 + np.abs(free[1]))).all()


def test_joints_without_a_jerk_limit_are_as_they_were():
    first = ARM.joint_names[0]
    constraints = [JointPositionLimits(lower=-1.0, upper=1.0), JointVelocityLimits(2.0)]
    free = JointIntervals(constraints, ARM, dt=1e-3)
    one = JointIntervals([*constraints, JointJerkLimits({first: 100.0})], ARM, dt=1e-3)
    q, v = np.full(ARM.nj, 0.95), np.full(ARM.nj, 0.5)
    for with_one, without in zip(bounds(one, "acceleration", q, v), bounds(free, "acceleration", q, v), strict=True):
        np.testing.assert_array_equal(with_one[1:], without[1:])
        assert with_one[0] != without[0]


def test_the_last_acceleration_can_be_forgotten():
    intervals = JointIntervals([JointJerkLimits(100.0)], ARM, dt=1e-3)
    zero = np.zeros(ARM.nj)
    intervals.remember(zero + 5.0)
    np.testing.assert_allclose(bounds(intervals, "acceleration", zero, zero), (zero + 4.9, zero + 5.1))
    intervals.remember(zero)
    np.testing.assert_allclose(bounds(intervals, "acceleration", zero, zero), (zero - 0.1, zero + 0.1))


def test_a_bound_that_keeps_jerk_says_so():
    intervals = JointIntervals([JointVelocityLimits(2.0), JointJerkLimits(100.0)], ARM, dt=1e-3)
    _, upper = bounds(intervals, "acceleration", np.zeros(ARM.nj), np.zeros(ARM.nj))
    assert intervals.cause(0, upper[0], upper=True) == "jerk"


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
def test_all_limits_in_one_object_are_the_single_ones(robot):
    all_in_one = JointLimits(lower=-0.5, upper=0.5, v_max=1.0, a_max=20.0, j_max=500.0, tau_max=10.0)
    quantities = [constraint.quantity for constraint in all_in_one.constraints(frozenset())]
    assert quantities == ["position", "velocity", "acceleration", "jerk", "torque"]
    for constraint in all_in_one.constraints(frozenset()):
        assert (
            constraint.bounds(robot)[1].tolist()
            == [getattr(constraint, "upper", None) or constraint.bounds(robot)[1][0]] * robot.nj
        )


def approach(room: float, u: float, B: float, v_max: float, j: float, dt: float) -> float:
    """The acceleration towards a limit as the docstring of the kernel has it, for one joint and in scalars."""
    T = dt + B / j
    w = -B * T + np.sqrt((B * T) ** 2 + 2.0 * B * room)
    slope = 0.0 if w >= v_max else -u * B / (w + B * T)  # the bound falls while the limit comes nearer
    left, share = min(w, v_max) - u, 0.5 * j
    return slope - share * dt + np.sqrt((share * dt) ** 2 + 2.0 * share * left)


@given(SEEDS)
def test_a_bound_that_falls_is_followed_while_it_falls(seed: int):
    rng = np.random.default_rng(seed)
    dt, B, j, v_max = 1e-3, 10 ** rng.uniform(0.5, 2), 10 ** rng.uniform(2, 4), 10 ** rng.uniform(-0.5, 1)
    room = 10 ** rng.uniform(-2, 0)
    T = dt + B / j
    u = rng.uniform(0.3, 0.99) * min(v_max, -B * T + np.sqrt((B * T) ** 2 + 2.0 * B * room))
    expected = approach(room, u, B, v_max, j, dt)
    intervals = unlimited(1, dt)
    for quantity, limit in (("position", 10.0), ("velocity", v_max), ("acceleration", B), ("jerk", j)):
        intervals.replace(quantity, -limit, limit)
    q = 10.0 - room - 0.5 * u * dt
    intervals.remember(np.array([np.clip(expected, -B, B)]))  # where jerk leaves what the approach wants
    _, upper = bounds(intervals, "acceleration", np.array([q]), np.array([u]))
    np.testing.assert_allclose(upper[0], np.clip(expected, -B, B), rtol=1e-6, atol=1e-6 * B)
