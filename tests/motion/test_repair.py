"""Repair: more frames are certified than before, what holds still holds, and the motion stays near what it was."""

from __future__ import annotations

import numpy as np
import pytest

import wbc
from tests.motion.test_retarget import soles
from wbc.motion import Witness, made
from wbc.motion.body import spans
from wbc.motion.witness import velocities


@pytest.mark.slow
def test_a_walk_that_slides_a_little_is_repaired():
    found = wbc.retarget(made("walk", seed=1), wbc.load("humanoid", base="floating"), repair=True)
    before = found.before
    assert before is not None and before.certified < 1.0 == found.certified
    # A witness of its own says the same.
    verdicts = Witness(found.robot, found.contacts).judge(found.q, found.rate, found.holds)
    assert all(verdict.certified for verdict in verdicts)
    for part in ("left_foot", "right_foot"):
        poses = soles(found, part)
        for start, stop in spans(found.holds[part]):
            assert np.ptp(poses[start:stop], axis=0).max() < 1e-3
    _, _, steps = velocities(found.robot, found.q, found.rate)
    limits, joints = found.robot.limits, found.q[:, 7:]
    assert (np.abs(steps[:, 6:]) * found.rate <= limits.v_max + 1e-3).all()
    assert (joints >= limits.q_min - 1e-6).all() and (joints <= limits.q_max + 1e-6).all()
    moved = np.abs(found.q - before.q).max(axis=1)
    assert 0.0 < moved.max() < 0.1
    assert (moved == 0.0).mean() > 0.3  # frames far from the fault are as they were


def test_what_is_certified_is_left_alone():
    motion, robot = made("squat"), wbc.load("humanoid", base="floating")
    found = wbc.retarget(motion, robot, repair=True)
    assert found.before is None and found.certified == 1.0
