"""Velocity bounds of joints inside their limits, and how they join those of joints outside."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import JointPositionLimits, JointVelocityLimits
from wbc.stack.interval import JointIntervals

DT = 1e-3
ARM = wbc.load("arm")
CONSTRAINTS = [JointPositionLimits(), JointVelocityLimits()]


def bounds(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    lower, upper = np.empty(ARM.nj), np.empty(ARM.nj)
    JointIntervals(CONSTRAINTS, ARM, DT).write(1, q, np.zeros(ARM.nj), lower, upper)
    return lower, upper


@given(st.integers(0, 10**6))
def test_inside_a_joint_may_reach_its_limit_in_one_tick_within_its_speed(seed: int):
    limits = ARM.limits
    rng = np.random.default_rng(seed)
    near = np.where(rng.random(ARM.nj) < 0.5, limits.q_min, limits.q_max)
    q = np.clip(near + rng.uniform(-1, 1, ARM.nj) * rng.choice([1e-4, 1.0]), limits.q_min, limits.q_max)
    lower, upper = bounds(q)
    np.testing.assert_allclose(upper, np.minimum((limits.q_max - q) / DT, limits.v_max), atol=1e-9)
    np.testing.assert_allclose(lower, np.maximum((limits.q_min - q) / DT, -limits.v_max), atol=1e-9)


@given(st.integers(0, ARM.nj - 1))
def test_one_joint_outside_changes_nothing_for_the_others(out: int):
    inside = 0.5 * (ARM.limits.q_min + ARM.limits.q_max)
    outside = inside.copy()
    outside[out] = ARM.limits.q_max[out] + 1e-4
    others = np.arange(ARM.nj) != out
    for before, after in zip(bounds(inside), bounds(outside), strict=True):
        np.testing.assert_array_equal(before[others], after[others])
    assert bounds(outside)[1][out] < 0.0


def test_a_position_that_is_no_number_gives_bounds_that_are_none():
    q = ARM.q0.copy()
    q[0] = np.nan
    lower, upper = bounds(q)
    assert np.isnan(lower[0]) and np.isnan(upper[0])
