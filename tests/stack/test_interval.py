"""Limits on positions, velocities and accelerations never contradict each other, and hold for as long as one looks."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks import JointAccelerationLimits, JointPositionLimits, JointVelocityLimits
from wbc.errors import InvalidInput
from wbc.stack.interval import BRAKING, RETURN_SPEED, JointIntervals
from wbc.testing import robots
from wbc.types import Vec

ARM = robots()[0]
SEEDS = st.integers(0, 2**32 - 1)
LEVELS = ("acceleration", "velocity")


def unlimited(n: int, dt: float, braking: float | None = None) -> JointIntervals:
    """Of n joints without limits; ``braking`` is what a constraint on positions says."""
    model: Any = SimpleNamespace(nj=n, joint_names=tuple(f"joint {i}" for i in range(n)), joint_units=("rad",) * n)
    bounds = np.full(n, -np.inf), np.full(n, np.inf)
    none: Any = SimpleNamespace(quantity="position", name="", braking=braking, bounds=lambda _: bounds)
    return JointIntervals([none], model, dt)


def random_intervals(rng: np.random.Generator, n: int = 100) -> JointIntervals:
    """Limits over many magnitudes: none, equal positions, zero velocities, hard and soft accelerations."""
    braking = rng.choice([None, 3.0])
    intervals = unlimited(n, 10 ** rng.uniform(-3.5, -1.5), braking)

    def some(share: float) -> Any:
        return rng.random(n) < share

    middle, width = rng.normal(size=n), np.where(some(0.1), 0.0, 10 ** rng.uniform(-9, 1, n))
    if rng.random() < 0.8:
        lower, upper = middle - width / 2, middle + width / 2
        intervals.replace("position", np.where(some(0.1), -np.inf, lower), np.where(some(0.1), np.inf, upper))
    for quantity, smallest, largest in (("velocity", -6, 3), ("acceleration", -3, 4)):
        if rng.random() < 0.7:
            down, up = (np.where(some(0.2), np.inf, 10 ** rng.uniform(smallest, largest, n)) for _ in range(2))
            intervals.replace(quantity, np.where(some(0.05), 0.0, -down), np.where(some(0.05), 0.0, up))
    return intervals


def bounds(intervals: JointIntervals, level: str, q: Vec, v: Vec) -> tuple[Vec, Vec]:
    lower, upper = np.full(len(q), np.nan), np.full(len(q), np.nan)
    intervals.write(("velocity", "acceleration").index(level) + 1, q, v, lower, upper)
    return lower, upper


def step(level: str, q: Vec, v: Vec, chosen: Vec, dt: float) -> tuple[Vec, Vec, Vec]:
    """Position, velocity and acceleration after one tick of the level."""
    if level == "velocity":
        return q + chosen * dt, chosen, (chosen - v) / dt
    return q + v * dt + 0.5 * chosen * dt**2, v + chosen * dt, chosen


def limits(intervals: JointIntervals, quantity: str) -> tuple[Vec, Vec]:
    upper, mirrored = intervals._limits[quantity]
    return -mirrored, upper


def beyond(value: Vec, interval: tuple[Vec, Vec]) -> float:
    return float(max((interval[0] - value).max(), (value - interval[1]).max()))


def braking_of(intervals: JointIntervals) -> tuple[Vec, Vec]:
    """What a joint brakes with on its way down and on its way up, from the statement of the class."""
    low, high = limits(intervals, "acceleration")
    given = intervals._braking
    return tuple(  # type: ignore[return-value]
        np.minimum(np.where(np.isinf(a) & (given is None), BRAKING, a), np.inf if given is None else given)
        for a in (high, -low)
    )


def viable_start(intervals: JointIntervals, level: str, rng: np.random.Generator) -> tuple[Vec, Vec]:
    """States from which all limits can be kept, many of them on the very edge."""
    low, high = limits(intervals, "position")
    low, high = np.maximum(low, np.minimum(high, 0.0) - 100.0), np.minimum(high, np.maximum(low, 0.0) + 100.0)
    q = low + (high - low) * rng.choice([0.0, 1.0, 0.5, rng.random()], len(low))
    fastest = []
    for room, B in zip((q - low, high - q), braking_of(intervals), strict=True):
        margin = 0.5 * B * intervals.dt if level == "acceleration" else 0.0
        speed = -margin + np.sqrt(margin**2 + 2.0 * B * np.maximum(room, 0.0))
        fastest.append(speed)
    v_low, v_high = limits(intervals, "velocity")
    v = np.where(rng.random(len(q)) < 0.5, -np.minimum(fastest[0], -v_low), np.minimum(fastest[1], v_high))
    return q, np.clip(v * rng.choice([1.0, rng.random()], len(q)), -100.0, 100.0)


@given(SEEDS)
def test_the_interval_is_never_empty_wherever_the_joint_is(seed: int):
    rng = np.random.default_rng(seed)
    intervals = random_intervals(rng)
    n = len(intervals.joint_names)
    low, high = limits(intervals, "position")
    q = rng.normal(size=n) * 10 ** rng.uniform(-6, 3, n)
    q = np.where((rng.random(n) < 0.3) & np.isfinite(high), high, q)
    q = np.where((rng.random(n) < 0.3) & np.isfinite(low), low, q)
    v = np.where(rng.random(n) < 0.2, 0.0, rng.normal(size=n) * 10 ** rng.uniform(-6, 4, n))
    for level in LEVELS:
        lower, upper = bounds(intervals, level, q, v)
        assert (lower <= upper).all()
        assert (lower < np.inf).all() and (upper > -np.inf).all()


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("habit", ["highest", "lowest", "either", "anything", "to and fro"])
@given(SEEDS)
def test_whatever_is_chosen_inside_keeps_every_limit_for_ever(level: str, habit: str, seed: int):
    rng = np.random.default_rng(seed)
    intervals = random_intervals(rng, n=50)
    q, v = viable_start(intervals, level, rng)
    # At the velocity level accelerations only count where they are limited, there all joints are.
    if level == "velocity" and not intervals._has_acceleration:
        v = np.clip(v, *limits(intervals, "velocity"))
    for tick in range(400):
        lower, upper = bounds(intervals, level, q, v)
        share = {
            "highest": 1.0, "lowest": 0.0, "either": rng.integers(0, 2, len(q)), "anything": rng.random(len(q)),
            "to and fro": tick // 40 % 2,
        }[habit]  # fmt: skip
        large = 1e3 if level == "velocity" else 1e5
        low, high = np.clip(lower, -large, large), np.clip(upper, -large, large)
        q, v, a = step(level, q, v, np.clip(low + share * (high - low), lower, upper), intervals.dt)
        assert beyond(q, limits(intervals, "position")) <= 1e-9
        assert beyond(v, limits(intervals, "velocity")) <= 1e-9
        assert beyond(a, limits(intervals, "acceleration")) <= 1e-9


@pytest.mark.parametrize("habit", ["highest", "lowest"])
@pytest.mark.parametrize("end", [0.5, 1.0], ids=["as the model", "as MuJoCo"])
@given(SEEDS)
def test_pressed_against_its_limit_a_joint_comes_to_rest_there(end: float, habit: str, seed: int):
    """Also where a plant moves by the velocity at the end of the tick, and accelerates more or less than it is told;
    from a little outside, and from a speed that leads there."""
    rng, n = np.random.default_rng(seed), 20
    intervals = unlimited(n, 10 ** rng.uniform(-3.0, -1.5))
    intervals.replace("position", -1.0, 1.0)
    intervals.replace("velocity", -2.0, 2.0)
    most = np.where(rng.random(n) < 0.3, np.inf, 10 ** rng.uniform(0.5, 3.0, n))
    intervals.replace("acceleration", -most, most)
    side = 1.0 if habit == "highest" else -1.0
    q = side * (1.0 + rng.choice([-1.0, 1.0], n) * 10 ** rng.uniform(-9.0, -3.0, n))
    v, given = side * rng.choice([0.0, 1.0], n) * 10 ** rng.uniform(-6.0, -3.0, n), rng.uniform(0.8, 1.15, n)
    for _ in range(600):
        lower, upper = bounds(intervals, "acceleration", q, v)
        a = given * (upper if habit == "highest" else lower)
        q, v = q + (v + end * a * intervals.dt) * intervals.dt, v + a * intervals.dt
    assert np.abs(side * q - 1.0).max() < 1e-9
    assert np.abs(v).max() < 1e-9


@given(SEEDS)
def test_with_velocity_limits_alone_the_next_tick_may_be_at_the_limit(seed: int):
    rng = np.random.default_rng(seed)
    intervals = JointIntervals([JointVelocityLimits()], ARM, dt=1e-3)
    v_max = ARM.limits.v_max
    v = rng.uniform(-1, 1, ARM.nj) * v_max
    lower, upper = bounds(intervals, "acceleration", rng.normal(size=ARM.nj), v)
    rounding = 8.0 * np.finfo(np.float64).eps * v_max.max() / 1e-3  # near its limit v_max − v is nothing but that
    np.testing.assert_allclose(lower, (-v_max - v) / 1e-3, rtol=0.0, atol=rounding)
    np.testing.assert_allclose(upper, (v_max - v) / 1e-3, rtol=0.0, atol=rounding)


@given(SEEDS, st.sampled_from([-0.5, 0.0, 0.3, 0.9, 1.1, 3.0]), st.booleans())
def test_velocities_within_positions_and_velocities_alone_are_bounded_by_the_nearer_limit(
    seed: int, near: float, mirrored: bool
):
    rng = np.random.default_rng(seed)
    dt, up = 0.01, rng.uniform(0.1, 1.0, ARM.nj)
    positions = JointPositionLimits(lower=-up) if mirrored else JointPositionLimits(lower=-np.inf, upper=up)
    intervals = JointIntervals([positions, JointVelocityLimits(up)], ARM, dt)
    q = rng.uniform(-0.5, 0.5, ARM.nj) * up
    for start in (q, np.r_[up[0] * (1.0 - near * dt), q[1:]], q):
        lower, upper = bounds(intervals, "velocity", -start if mirrored else start, rng.normal(size=ARM.nj))
        if mirrored:
            lower, upper = -upper, -lower
        outside = near < 0.0 and start is not q
        if not outside:
            np.testing.assert_allclose(upper, np.minimum((up - start) / dt, up), rtol=1e-9)
        np.testing.assert_array_equal(lower, -up)
        assert intervals.recovering == outside
        nearer = "position" if start is not q and near < 1.0 else "velocity"
        near_end = -upper[0] if mirrored else upper[0]
        assert intervals.cause(0, near_end, upper=not mirrored) == nearer


@given(SEEDS)
def test_no_bound_ever_asks_for_more_than_full_braking(seed: int):
    rng = np.random.default_rng(seed)
    intervals = random_intervals(rng)
    n = len(intervals.joint_names)
    lower, upper = bounds(intervals, "acceleration", 3 * rng.normal(size=n), 10 * rng.normal(size=n))
    down, up = braking_of(intervals)
    assert (upper >= -up).all() and (lower <= down).all()


@pytest.mark.parametrize("a_max", [None, 5.0, 80.0])
@given(st.floats(1e-6, 1.0), st.floats(-10.0, 10.0), st.booleans())
def test_from_outside_a_joint_is_back_in_the_time_that_braking_and_returning_take(a_max, distance, speed, above):
    constraints: list[Any] = [JointPositionLimits(lower=-1.0, upper=1.0), JointVelocityLimits(2.0)]
    if a_max is not None:
        constraints.append(JointAccelerationLimits(a_max))
    intervals = JointIntervals(constraints, ARM, dt=1e-3)
    side, B, v_max = (1.0 if above else -1.0), a_max or BRAKING, 2.0
    q, v = np.full(ARM.nj, side * (1.0 + distance)), np.full(ARM.nj, side * speed)
    outward, dt = max(speed, 0.0), intervals.dt
    furthest = distance + outward**2 / (2 * B) + outward * dt / 2
    allowed = 1.1 * (abs(speed) / B + furthest / v_max + v_max / (2 * B)) + 2 * dt
    for _ in range(int(allowed / dt)):
        lower, upper = bounds(intervals, "acceleration", q, v)
        slowest_return = upper if above else lower
        q, v, a = step("acceleration", q, v, slowest_return, intervals.dt)
        assert np.abs(a).max() <= B * (1 + 1e-12) or a_max is None
        if (np.abs(q) <= 1.0 + 1e-12).all():
            return
    pytest.fail(f"still at {q[0]:.6f} rad after {allowed:.3f} s")


@given(st.floats(1e-6, 1.0), st.sampled_from([0.5, np.inf]))
def test_from_outside_a_velocity_leads_straight_back(distance: float, v_max: float):
    intervals = JointIntervals([JointPositionLimits(lower=-1.0, upper=1.0), JointVelocityLimits(v_max)], ARM, dt=1e-2)
    q, speed = np.full(ARM.nj, 1.0 + distance), min(v_max, RETURN_SPEED)
    for _ in range(int(np.ceil(distance / speed / 1e-2 - 1e-6)) + 1):
        lower, upper = bounds(intervals, "velocity", q, np.zeros(ARM.nj))
        assert (lower <= upper).all() and (upper >= -speed).all()
        q = q + upper * 1e-2
    assert (q <= 1.0 + 1e-12).all()


def test_a_joint_of_equal_limits_stays_and_comes_to_stay():
    intervals = JointIntervals([JointPositionLimits(lower=0.3, upper=0.3)], ARM, dt=1e-3)
    held = np.full(ARM.nj, 0.3)
    for level in LEVELS:
        for bound in bounds(intervals, level, held, np.zeros(ARM.nj)):
            np.testing.assert_allclose(bound, 0.0, atol=1e-12)
    q, v = held + 1e-3, np.zeros(ARM.nj)
    for _ in range(200):
        q, v, _ = step("acceleration", q, v, bounds(intervals, "acceleration", q, v)[1], 1e-3)
    np.testing.assert_allclose(q, held, atol=1e-9)
    np.testing.assert_allclose(v, 0.0, atol=1e-9)


@pytest.mark.parametrize(("braking", "expected"), [(2.0, 2.0), (None, 50.0)])
def test_braking_is_as_gentle_as_asked(braking: float | None, expected: float):
    constraints = [JointPositionLimits(lower=-1.0, upper=1.0, braking=braking), JointAccelerationLimits(50.0)]
    intervals = JointIntervals(constraints, ARM, dt=1e-3)
    q, v, hardest = np.zeros(ARM.nj), np.zeros(ARM.nj), 0.0
    for _ in range(3000):
        q, v, a = step("acceleration", q, v, bounds(intervals, "acceleration", q, v)[1], 1e-3)
        hardest = max(hardest, float(-a.min()))
    assert 0.9 * expected <= hardest <= expected
    np.testing.assert_allclose(q, 1.0, atol=1e-3)


def test_constraints_on_the_same_quantity_intersect():
    intervals = JointIntervals([JointVelocityLimits(1.0), JointVelocityLimits(0.5, name="slow")], ARM, dt=1e-3)
    lower, upper = bounds(intervals, "velocity", np.zeros(ARM.nj), np.zeros(ARM.nj))
    assert (lower == -0.5).all() and (upper == 0.5).all()


def test_constraints_that_leave_a_joint_nothing_are_refused_by_its_name():
    constraints = [JointPositionLimits(lower=-1.0, upper=0.0), JointPositionLimits(lower=0.5, upper=1.0, name="other")]
    with pytest.raises(InvalidInput, match=f"other: joint '{ARM.joint_names[0]}' is left no position"):
        JointIntervals(constraints, ARM, dt=1e-3)


def test_bounds_may_be_replaced_between_ticks_and_come_back():
    intervals = JointIntervals([JointVelocityLimits(1.0)], ARM, dt=1e-3)
    zero = np.zeros(ARM.nj)
    before = bounds(intervals, "acceleration", zero, zero)
    intervals.replace("velocity", -0.1, np.full(ARM.nj, 0.2))
    lower, upper = bounds(intervals, "acceleration", zero, zero)
    np.testing.assert_allclose((lower, upper), (zero - 100.0, zero + 200.0))
    intervals.replace("position", -0.5, 0.5)
    assert (bounds(intervals, "acceleration", zero + 0.5, zero)[1] <= 1e-12).all()
    intervals.replace("velocity", -1.0, 1.0)
    intervals.replace("position", -np.inf, np.inf)
    for bound, again in zip(before, bounds(intervals, "acceleration", zero, zero), strict=True):
        np.testing.assert_array_equal(bound, again)


@pytest.mark.parametrize(
    ("q", "v", "upper", "cause"),
    [
        (0.0, 0.0, True, "acceleration"),
        (0.0, 2.0, True, "velocity"),
        (1.0, 0.0, True, "position"),
        (-1.0, 0.0, False, "position"),
        (0.0, -2.0, False, "velocity"),
    ],
)
def test_a_bound_knows_the_quantity_it_comes_from(q: float, v: float, upper: bool, cause: str):
    constraints = [JointPositionLimits(lower=-1.0, upper=1.0), JointVelocityLimits(2.0), JointAccelerationLimits(100.0)]
    intervals = JointIntervals(constraints, ARM, dt=1e-3)
    bound = bounds(intervals, "acceleration", np.full(ARM.nj, q), np.full(ARM.nj, v))[upper][3]
    assert intervals.cause(3, bound, upper=upper) == cause
