"""Repair: more frames are certified, what holds still holds, the motion stays near, and slows where it has to."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import wbc
from tests.motion.artefacts import inject
from tests.motion.test_retarget import retargeted, soles
from tests.motion.test_witness import possible
from wbc.models.along import velocities
from wbc.motion import Fault, Motion, Retargeted, Verdict, Witness, made
from wbc.motion.repair import _pieces, moments, possible_pace, repaired
from wbc.report.measure import spans


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
    assert 0.0 <= found.added < 0.5
    far, near = found.distances(), before.distances()
    assert all(far[part].max() < near[part].max() + 0.02 for part in far)


@pytest.mark.slow
def test_a_body_beside_its_feet_moves_back_over_them_without_other_timing(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("wbc.motion.repair.possible_pace", lambda found: np.ones(len(found.q)))
    clean = retargeted("squat")
    artefact = inject("centre of pressure", clean, np.random.default_rng(1))
    assert artefact is not None
    witness = Witness(clean.robot, clean.contacts)
    leaning = replace(clean, q=artefact.q, verdicts=tuple(witness.judge(artefact.q, clean.rate, clean.holds)))
    found = repaired(leaning, witness, lambda done, word: None)
    assert leaning.certified < 0.7 and found.certified > 0.95 and found.added == 0.0
    moved = np.abs(found.q - leaning.q).max(axis=1)
    assert 0.0 < moved.max() < 0.3
    assert (moved == 0.0).mean() > 0.1  # frames far from the fault are as they were


@pytest.mark.parametrize("shifted", [False, True])
@pytest.mark.parametrize(("start", "stop"), [(0, 1), (7, 607), (0, 601), (3, 4000)])
def test_long_windows_come_in_pieces_that_meet(start: int, stop: int, shifted: bool):
    pieces = list(_pieces(start, stop, shifted=shifted))
    assert [a for a, _ in pieces] == [start, *(b for _, b in pieces[:-1])] and pieces[-1][1] == stop
    assert all(0 < b - a <= 601 for a, b in pieces)
    others = {b for _, b in _pieces(start, stop, shifted=not shifted)} - {stop}
    assert not others & {b for _, b in pieces[:-1]}  # frames at an edge move in the other turn


def test_what_is_certified_is_left_alone():
    motion, robot = made("squat"), wbc.load("humanoid", base="floating")
    found = wbc.retarget(motion, robot, repair=True)
    assert found.before is None and found.certified == 1.0


# ---- pace
@cache
def slowed() -> Retargeted:
    """A squat three times as fast, repaired."""
    squat, robot = made("squat"), wbc.load("humanoid", base="floating")
    return wbc.retarget(Motion(3.0 * squat.rate, squat.positions), robot, acceleration=None, repair=True)


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
    hurried = slowed().before
    assert hurried is not None and hurried.certified < 1.0
    robot, contacts = hurried.robot, list(hurried.contacts.values())
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
    found = slowed()
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
    found = retargeted("squat")
    slips = replace(found, verdicts=(Verdict((Fault("slip", "left_sole", 9.0),)),) * len(found.q))
    assert (possible_pace(slips) == 1.0).all()
    assert found.added == 0.0
