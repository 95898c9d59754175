"""Pace: a motion that is too fast for the forces there are becomes slower where it has to, and goes the same way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import wbc
from tests.motion.test_retarget import retargeted
from tests.motion.test_witness import possible
from wbc.models.along import velocities
from wbc.motion import Motion, made
from wbc.motion.repair import moments, possible_pace


@pytest.mark.parametrize("seed", range(4))
def test_moments_are_nowhere_faster_than_the_pace_asked(seed: int):
    rng = np.random.default_rng(seed)
    pace = np.where(rng.uniform(size=200) < 0.05, rng.uniform(0.3, 1.0, 200), 1.0)
    when = moments(pace, 60.0)
    assert when[0] == 0.0 and when[-1] == pytest.approx(199.0)
    steps = np.diff(when)
    assert (steps > 0.0).all() and np.abs(np.diff(steps)).max() < 0.06  # no jump in speed
    least = [pace[int(a) : int(b) + 2].min() for a, b in pairwise(when)]
    assert (steps <= np.array(least) + 1e-2).all()
    assert len(moments(np.ones(50), 60.0)) == 50


@pytest.mark.slow
def test_the_pace_found_is_the_fastest_possible_one():
    found = retargeted("squat")
    robot, contacts = found.robot, list(found.contacts.values())
    fast = Motion(3.0 * found.rate, found.motion.positions)
    hurried = wbc.retarget(fast, robot, acceleration=None)
    assert hurried.certified < 1.0
    pace = possible_pace(hurried)
    v, a, _ = velocities(robot, hurried.q, hurried.rate)
    slower = np.flatnonzero((pace > 0.7) & (pace < 1.0))
    assert len(slower) > 3
    for k in slower:
        # The oracle, a linear program, agrees on both sides; a hundredth of the limits is left to either.
        r = pace[k]
        assert possible(robot, contacts, hurried.q[k], r * v[k], r**2 * a[k], 1.01)
        r = min(1.06 * pace[k], 1.0)
        assert not possible(robot, contacts, hurried.q[k], r * v[k], r**2 * a[k], 0.99)


@pytest.mark.slow
def test_a_squat_faster_than_its_fall_is_slowed_down():
    squat = made("squat")
    found = wbc.retarget(
        Motion(3.0 * squat.rate, squat.positions), retargeted("squat").robot, acceleration=None, repair=True
    )
    before = found.before
    assert before is not None and before.certified < 1.0 == found.certified
    assert found.added == pytest.approx((len(found.q) - len(before.q)) / found.rate) and 0.0 < found.added < 3.0
    # The robot comes as low as before, and is as near to the person as before, at the person's own moments.
    assert found.q[:, 2].min() == pytest.approx(before.q[:, 2].min(), abs=0.01)
    assert found.motion.frames == len(found.q) == len(found.targets.positions["pelvis"])
    far, near = found.distances(), before.distances()
    assert max(np.median(far[part]) - np.median(near[part]) for part in far) < 0.005


def test_a_motion_at_other_moments_goes_the_same_way():
    found = retargeted("turn")
    slow = found.at(np.linspace(0.0, len(found.q) - 1.0, 2 * len(found.q) - 1))
    np.testing.assert_allclose(slow.q[::2], found.q, atol=1e-9)
    assert np.abs(np.diff(slow.q, axis=0)).max() < 0.1  # quaternions of one rotation do not change their sign
    np.testing.assert_allclose(slow.motion.positions["left_toe"][::2], found.motion.positions["left_toe"], atol=1e-9)
    assert (slow.holds["left_foot"][::2] == found.holds["left_foot"]).all()
    limits = found.robot.limits
    assert (slow.q[:, 7:] >= limits.q_min).all() and (slow.q[:, 7:] <= limits.q_max).all()


def test_a_fault_that_no_pace_mends_changes_no_timing():
    from dataclasses import replace

    from wbc.motion import Fault, Verdict

    found = retargeted("squat")
    slips = replace(found, verdicts=(Verdict((Fault("slip", "left_sole", 9.0),)),) * len(found.q))
    assert (possible_pace(slips) == 1.0).all()
    assert found.added == 0.0
