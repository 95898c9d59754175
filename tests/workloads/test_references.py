"""References: the rates and accelerations a controller is told are the derivatives of what it is told to follow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.workloads.references import ramp, step, sway, times

moments = st.floats(0.01, 3.0)


def test_the_ramp_starts_and_ends_at_rest():
    value, rate, acceleration = ramp(np.array([-1.0, 0.0, 1.0, 5.0]))
    assert value.tolist() == [0.0, 0.0, 1.0, 1.0]
    assert not rate.any() and not acceleration.any()


@given(moments)
def test_rates_and_accelerations_are_derivatives(t: float):
    h = 1e-5
    around = np.array([t - h, t, t + h])
    motion = sway(around, [0.1, 0.2, 0.05], [0.5, 2.0, 1.0], [0.0, 0.3, -1.5])
    before, now, after = motion.position
    assert motion.rate[1] == pytest.approx((after - before) / (2 * h), abs=1e-6)
    assert motion.acceleration[1] == pytest.approx((after - 2 * now + before) / h**2, abs=2e-4)


def test_a_moved_motion_has_the_same_derivatives():
    motion = sway(times(50, 0.01), [0.1, 0.1, 0.1], [1.0, 1.0, 1.0])
    moved = motion.moved(np.array([1.0, 2.0, 3.0]))
    assert moved.position - motion.position == pytest.approx(np.tile([1.0, 2.0, 3.0], (50, 1)))
    assert moved.rate is motion.rate and moved.acceleration is motion.acceleration


def test_a_step_is_there_from_its_time_on():
    offset = step(times(5, 0.5), 1.0, [0.0, 0.15, 0.0])
    assert offset[:, 1].tolist() == [0.0, 0.0, 0.15, 0.15, 0.15]
    assert not offset[:, [0, 2]].any()


def test_a_track_of_a_motion_gives_position_rate_and_acceleration():
    motion = sway(times(10, 0.01), [0.1, 0.1, 0.1], [1.0, 1.0, 1.0])
    position, rate, acceleration = motion.track(0.01)(0.07)
    assert (position == motion.position[7]).all() and (rate == motion.rate[7]).all()
    assert (acceleration == motion.acceleration[7]).all()
