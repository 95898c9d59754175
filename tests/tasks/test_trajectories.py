"""A reference is consistent with itself: its rate and acceleration are the derivatives of its value."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.trajectories import Sinusoid
from wbc.errors import InvalidInput


@given(t=st.floats(0.0, 5.0), ramp=st.floats(0.1, 2.0), frequency=st.floats(0.1, 2.0))
def test_rate_and_acceleration_are_derivatives_of_the_value(t: float, ramp: float, frequency: float) -> None:
    motion = Sinusoid([1.0, 2.0], amplitude=[0.1, -0.2], frequency=frequency, phase=[0.0, 1.0], ramp=ramp)
    h = 1e-5
    (before, rate_before, _), (_, rate, acceleration), (after, rate_after, _) = motion(t - h), motion(t), motion(t + h)
    if abs(t - ramp) > 2 * h and t > 2 * h:
        np.testing.assert_allclose((after - before) / (2 * h), rate, atol=1e-5)
        np.testing.assert_allclose((rate_after - rate_before) / (2 * h), acceleration, atol=1e-3)


def test_it_starts_at_its_center_and_at_rest() -> None:
    value, rate, acceleration = Sinusoid([3.0], amplitude=1.0, frequency=1.0, phase=0.7)(0.0)
    assert (value[0], rate[0], acceleration[0]) == (3.0, 0.0, 0.0)


def test_a_ramp_of_zero_starts_in_full_motion() -> None:
    value, _, _ = Sinusoid([0.0], amplitude=1.0, frequency=1.0, phase=np.pi / 2, ramp=0.0)(0.0)
    assert value[0] == 1.0


def test_what_makes_no_sense_is_refused_by_name() -> None:
    with pytest.raises(InvalidInput, match="amplitude"):
        Sinusoid([0.0, 0.0], amplitude=[np.nan, 1.0], frequency=1.0)
    with pytest.raises(InvalidInput, match="ramp"):
        Sinusoid([0.0], amplitude=1.0, frequency=1.0, ramp=-1.0)
