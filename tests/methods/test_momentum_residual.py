"""The momentum residual as a specification. What robots that move show: tests/tasks/test_momentum_observer.py."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.errors import InvalidInput
from wbc.methods import MomentumResidual


@given(st.integers(1, 6), st.sampled_from(["exact", "euler", "implicit"]), st.booleans(), st.integers(0, 2**32 - 1))
def test_an_interval_moves_the_residual_by_its_share_of_what_is_missing(n: int, scheme: str, alike: bool, seed: int):
    """r ← r + φ (T (τ − β − Δp/dt) − r): properties 61, 63, 66 and 70, whatever moves."""
    rng = np.random.default_rng(seed)
    gain = rng.uniform(1.0, 50.0, None if alike else n)
    observer = MomentumResidual(gain=gain, dt=1e-2, scheme=scheme)
    p, r = rng.normal(size=n), np.zeros(n)
    observer.reset(p)
    for k in range(8):
        (after, beta, tau), rows = rng.normal(size=(3, n)), rng.normal(size=(n, n)) if k % 2 else np.eye(n)
        dt = rng.uniform(1e-3, 3e-2) if k % 3 else 1e-2
        x = gain * dt
        share = {"exact": 1.0 - np.exp(-x), "euler": x, "implicit": x / (1.0 + x)}[scheme]
        missing = rows @ (tau - beta - (after - p) / dt)
        p, r = after, r + share * (missing - r)
        found = observer.update(p, beta, tau, rows if k % 2 else None, dt=dt if k % 3 else None)
        np.testing.assert_allclose(found, r, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(observer.missing, missing, rtol=1e-12)
        if k == 4:
            observer.restart(n - 1)
            r[n - 1] = 0.0


@given(st.floats(0.1, 100), st.lists(st.floats(1e-4, 0.1), min_size=1, max_size=20), st.floats(-5, 5))
def test_intervals_may_have_lengths_of_their_own(gain: float, lengths: list[float], fault: float):
    """r(t) = (1 − e^(−K t)) τ_f, however the time t is cut into intervals; the momentum changes by −τ_f each second."""
    observer, t = MomentumResidual(gain=gain, dt=1e-3), 0.0
    observer.reset([0.0])
    for dt in lengths:
        t += dt
        observer.update([-fault * t], [0.0], [0.0], dt=dt)
        assert observer.value[0] == pytest.approx(fault * -np.expm1(-gain * t), rel=1e-9, abs=1e-9)
    with pytest.raises(InvalidInput, match="dt is 0"):
        observer.update([0.0], [0.0], [0.0], dt=0.0)
    euler = MomentumResidual(gain=gain, dt=1.0 / gain, scheme="euler")
    euler.reset([0.0])
    with pytest.raises(InvalidInput, match="stable below 2"):
        euler.update([0.0], [0.0], [0.0], dt=2.5 / gain)


def test_after_a_reset_only_what_follows_counts():
    observer = MomentumResidual(gain=10.0, dt=0.01)
    observer.reset([1.0])
    observer.update([1.0], [0.0], [5.0])
    assert observer.value[0] > 0.0
    observer.reset([3.0])
    np.testing.assert_array_equal(observer.update([3.0], [0.0], [0.0]), 0.0)


def test_a_refused_update_leaves_the_residual_as_it_was():
    observer = MomentumResidual(gain=[1.0, 2.0], dt=0.01)
    with pytest.raises(InvalidInput, match=r"p0 must have shape \(2,\)"):
        observer.reset([0.0])
    observer.reset([0.0, 0.0])
    before = observer.update([0.0, 0.0], [0.0, 0.0], [1.0, 1.0])
    with pytest.raises(InvalidInput, match=r"tau\[1\] is nan"):
        observer.update([0.0, 0.0], [0.0, 0.0], [1.0, np.nan])
    with pytest.raises(InvalidInput, match=r"beta must have shape \(2,\), not \(3,\)"):
        observer.update([0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0])
    np.testing.assert_array_equal(observer.value, before)
