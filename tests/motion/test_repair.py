"""Repair: more frames are certified than before, what holds still holds, and the motion stays near what it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import wbc
from tests.motion.artefacts import inject
from tests.motion.test_retarget import retargeted, soles
from wbc.models.along import velocities
from wbc.motion import Witness, made
from wbc.motion.repair import _pieces, repaired
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
