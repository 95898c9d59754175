"""What comes into the estimate of a base: samples that are spoilt, late or missing, and settings that make no sense."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.robots.motions import NAMES, POINTS, ROBOT, errors, estimator, standing
from wbc.models.plausible import ImplausibleUnit
from wbc.robots import BaseEstimator
from wbc.sim.spoiling import RUBBISH, spoilt

SOUND = standing(duration=0.2)


def begun() -> BaseEstimator:
    """An estimator at the start of the sound samples."""
    one = estimator()
    one.reset(SOUND.q[0], SOUND.v[0])
    return one


@pytest.mark.parametrize(
    "part, value, said",
    [
        ("joint_q", np.full(12, np.nan), "joint_q"),
        ("joint_v", np.array([np.inf, *np.zeros(11)]), "joint_v"),
        ("gyro_in_imu", np.array([0.0, 36.0, 0.0]), "gyro_in_imu"),
        ("acceleration_in_imu", np.zeros(4), "acceleration_in_imu"),
        ("acceleration_in_imu", "down", "acceleration_in_imu"),
        ("forces", {NAMES[0]: 30.0}, "forces"),
        ("forces", dict.fromkeys(NAMES, np.nan), "forces"),
        ("t", 0.0, "not later"),
        ("t", np.nan, "t is nan"),
    ],
)
def test_a_spoilt_sample_is_named_and_leaves_no_trace(part: str, value: Any, said: str) -> None:
    ends = []
    for spoils in (False, True):
        one = begun()
        for k in range(20):
            q, v = one.update(**SOUND.sample(k))
        if spoils:
            back = one.update(**{**SOUND.sample(20), part: value})
            assert said in one.why and one.why.startswith("sample left out")
            assert np.array_equal(back[0], q) and np.array_equal(back[1], v)
        for k in range(21, 30):
            q, v = one.update(**SOUND.sample(k))
        assert one.why == ""
        ends.append(np.concatenate([q, v]))
    assert np.array_equal(*ends)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_nothing_that_is_not_finite_comes_out(seed: int) -> None:
    rng, one = np.random.default_rng(seed), estimator()
    t = 0.0
    for k in range(30):
        sample = SOUND.sample(k)
        t = float(t + rng.choice([1e-9, 2e-3, 0.1, 10.0, 1e6]))
        sample["t"] = t
        for part in ("joint_q", "joint_v", "gyro_in_imu", "acceleration_in_imu"):
            if rng.uniform() < 0.3:
                sample[part] = spoilt(sample[part], rng)
        if rng.uniform() < 0.2:
            sample["forces"] = dict(zip(NAMES, rng.choice(RUBBISH, 4).tolist(), strict=True))
        q, v = one.update(**sample)
        assert np.isfinite(q).all() and np.isfinite(v).all() and np.isfinite(one.covariance).all()
        assert abs(np.linalg.norm(q[3:7]) - 1.0) < 1e-9


@settings(max_examples=20, deadline=None)
@given(
    start=st.sampled_from([0.0, 1e5]), wild=st.sampled_from([-1e7, -3.0, 0.8, 60.0, 4.3e6, 1e12]), k=st.integers(2, 28),
)  # fmt: skip
def test_one_wild_stamp_costs_its_sample_and_nothing_else(start: float, wild: float, k: int) -> None:
    """Far in the future or the past: as if this sample had been lost. Two that agree are a clock that has jumped."""
    ends = []
    for stamp in (None, start + wild):
        one = begun()
        for i in range(30):
            if i == k and stamp is None:
                continue
            q, v = one.update(**{**SOUND.sample(i), "t": stamp if i == k else start + SOUND.sample(i)["t"]})  # type: ignore[arg-type]
            assert bool(one.why) == (i == k)
        ends.append(np.concatenate([q, v]))
    assert np.array_equal(*ends)
    said = []
    for i in range(30, 33):
        one.update(**{**SOUND.sample(i), "t": start + wild + SOUND.sample(i)["t"]})
        said.append(one.why)
    assert "sample left out: t is" in said[0] and "nothing was heard" in said[1] and not said[2]


@pytest.mark.parametrize("start", [0.0, 1e5, 1.8e9])
def test_samples_at_fifty_hertz_are_no_gaps(start: float) -> None:
    """At any time of day: differences of the times are then up to 0.2 µs longer than the 20 ms of a gap."""
    motion = standing(0.02)
    one = BaseEstimator(ROBOT, POINTS)
    one.reset(motion.q[0], motion.v[0])
    for k in range(1, len(motion.t)):
        q, v = one.update(**{**motion.sample(k), "t": start + float(motion.t[k])})
        assert not one.why
        assert np.abs(errors(q, v, motion.q[k], motion.v[k])).max() < 0.02


def test_after_a_gap_it_begins_to_see_again() -> None:
    motion, one = standing(), estimator(flex=1e-4)
    one.reset(motion.q[0], motion.v[0])
    for k in range(len(motion.t)):
        if not 200 < k < 400:
            q, v = one.update(**motion.sample(k))
            if k == 400:
                assert "nothing was heard for 0.4 s" in one.why
    # By how much the base turned about the vertical meanwhile nobody sees, so its velocity is seen in its own axes.
    assert np.abs(v[:3] - motion.v[-1][:3]).max() < 1e-5
    assert np.abs(errors(q, v, motion.q[-1], motion.v[-1])[3:5]).max() < 1e-5


def test_a_start_with_w_first_is_warned_about() -> None:
    q = np.array(ROBOT.q0)
    q[3:7] = [1.0, 0.0, 0.0, 0.0]
    with pytest.warns(ImplausibleUnit, match="upside down: quaternions are x, y, z, w here"):
        BaseEstimator(ROBOT).reset(q, np.zeros(18))
