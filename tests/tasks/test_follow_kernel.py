"""The parts of a follower in plain Python: the shortest stop, what a quaternion turns by, and by what it is off."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.compiled import follow
from tests.plain import plain
from wbc.types import Vec

KERNEL: Any = plain(follow)
decades = st.floats(-1.5, 1.5).map(lambda x: 10.0**x)
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


@given(v=st.floats(-5.0, 5.0), share=st.floats(-1.0, 1.0), A=decades, J=decades)
def test_a_stop_keeps_its_limits_is_a_motion_and_ends_at_rest(v: float, share: float, A: float, J: float) -> None:
    """And no stop ends sooner: full jerk all the way but where the acceleration is at its limit."""
    a = share * A
    most = abs(v) / A + 4.0 * A / J + 2.0 * np.sqrt(abs(v) / J)
    times = np.linspace(0.0, most, 4001)
    ways, speeds, accelerations = np.array([KERNEL.stop(v, a, A, J, t) for t in times]).T
    dt, size = times[1], 1.0 + abs(v) + A
    assert (np.abs(accelerations) <= A * (1.0 + 1e-9) + 1e-9).all()
    jerks = np.diff(accelerations) / dt
    assert (np.abs(jerks) <= J * (1.0 + 1e-6) + 1e-9 * size / dt).all()
    for value, rate, second in ((ways, speeds, A), (speeds, accelerations, J)):
        mean = 0.5 * (rate[1:] + rate[:-1])
        np.testing.assert_allclose(np.diff(value), mean * dt, rtol=0, atol=second * dt**2 + 1e-9 * size * dt)
    # A number whose square is no number is as good as zero.
    np.testing.assert_allclose(
        (ways[0], speeds[0], accelerations[0]), (0.0, v, a), rtol=0, atol=np.sqrt(np.finfo(float).tiny)
    )
    assert speeds[-1] == accelerations[-1] == 0.0
    end = KERNEL.stop(v, a, A, J, np.inf)
    assert end[0] == pytest.approx(ways[-1], abs=1e-9 * size * most) and end[1:] == (0.0, 0.0)
    moving = np.flatnonzero((speeds[:-1] != 0.0) | (accelerations[:-1] != 0.0))[:-1]
    idle = np.abs(jerks[moving]) < 0.99 * J
    assert (idle & (np.abs(accelerations[moving]) < A * (1.0 - 1e-6) - J * dt)).sum() <= 3  # where the jerk changes


@given(at=vectors, before=vectors, change=vectors, t=st.floats(0.01, 0.2))
def test_what_turns_at_a_rate_that_changes_steadily_is_integrated_to_the_fourth_order(
    at: Vec, before: Vec, change: Vec, t: float
) -> None:
    R, steps = pinocchio.exp3(2.0 * at), 50
    there = np.concatenate([t * before + 0.5 * t**2 * change, [0.0]])
    KERNEL._turned(pinocchio.Quaternion(R).coeffs(), before, before + t * change, t, there)
    for k in range(steps):
        R = pinocchio.exp3((before + (k + 0.5) / steps * t * change) * t / steps) @ R
    assert np.linalg.norm(there) == pytest.approx(1.0, abs=1e-12)
    found = pinocchio.Quaternion(*there[[3, 0, 1, 2]]).matrix()
    np.testing.assert_allclose(found, R, rtol=0, atol=0.1 * t**5 + t**3 / steps**2)


@given(at=vectors, turn=vectors, signs=st.tuples(*[st.sampled_from([1.0, -1.0])] * 2))
def test_what_is_left_to_turn_is_the_logarithm_whichever_sign_the_quaternions_have(
    at: Vec, turn: Vec, signs: tuple[float, float]
) -> None:
    R, S = pinocchio.exp3(2.0 * at), pinocchio.exp3(1.7 * turn)
    place, sample = (sign * pinocchio.Quaternion(M).coeffs() for sign, M in zip(signs, (R, S @ R), strict=True))
    left = np.zeros(3)
    KERNEL._rotation_left(sample, place, left)
    np.testing.assert_allclose(pinocchio.exp3(left), S, rtol=0, atol=1e-9)
    assert np.linalg.norm(left) <= np.pi + 1e-9
