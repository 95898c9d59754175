"""The page of a retargeted motion, and the command that writes it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.motion.test_retarget import retargeted
from wbc.control.recorder import Run
from wbc.motion import Fault, Retargeted, Verdict
from wbc.report.record import named

pytest.importorskip("matplotlib")


def test_a_page_shows_the_person_beside_the_robot_and_what_is_impossible():
    from wbc.motion.retargeted import page

    found = retargeted("squat")
    verdicts = [Verdict()] * 30 + [Verdict((Fault("slip", "left_sole", 31.0),))] * 12 + [Verdict()] * 198
    report = page(replace(found, verdicts=tuple(verdicts), before=found))
    assert report.ok is False and "slip of left_sole, 31 mm at 0.50 s" in report.summary
    strips = {strip.label: strip.intervals for item in report.items for strip in getattr(item, "strips", ())}
    assert strips["slip, repaired"] == [(0.5, 0.7)] and "left_sole holds, repaired" in strips
    content = report.scene.content
    assert len(report.scene.ghosts) == 1
    json.dumps([content, report.scene.ghosts], allow_nan=False)
    assert any(event.label == "slip" and event.start == 0.5 for event in report.clock.events)


def test_the_bones_of_the_person_join_its_parts():
    from wbc.motion.retargeted import _result

    found: Retargeted = replace(retargeted("squat"), scale=0.5)
    bones = _result(found, with_person=True).obstacles
    assert len(bones) > 14 and not _result(found).obstacles
    for bone in bones:
        one, _, other = bone.name.removesuffix(" of the person").partition(" to ")
        ends = [found.motion.positions[name][60] for name in (one, other)]
        pose = bone.at(1.0)
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-9)
        middle = 0.25 * (ends[0] + ends[1])
        np.testing.assert_allclose((pose.translation - middle)[[0, 2]], 0.0, atol=1e-12)
        along = pose.rotation[:, 2] * np.linalg.norm(ends[1] - ends[0])
        np.testing.assert_allclose(along, ends[1] - ends[0], atol=1e-9)


def test_the_command_writes_page_and_motion_and_says_the_share(wbc, tmp_path):
    answer = wbc("retarget", "squat", "--out", "out")
    assert answer.code == 0 and "100.0 % of 240 frames of squat certified for humanoid" in answer.out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "report.html", "report.md", "figures", "motion.npz", "motion.csv", "run.npz", "meta.json"
    }  # fmt: skip
    run = Run.load(tmp_path / "out")  # `wbc export` draws it, and `wbc index` knows that it passed
    assert named(run).name == "humanoid" and run.rows == 240 and run.meta["judged"]["ok"] is True
    for words in (("nothing.bvh",), ("nothing.npz",), ("nothing.csv",), ("squat", "--mapping", "nothing.toml")):
        answer = wbc("retarget", *words)
        assert answer.code == 2 and answer.err == f"wbc: {words[-1]} cannot be read: there is no such file\n"
    answer = wbc("retarget", "jump")
    assert answer.code == 2 and "there is no motion 'jump'; there are: dance, reach, squat, turn, walk" in answer.err
    assert ".bvh, .npz or .csv file" in answer.err
    answer = wbc("retarget", "squat", "--robot", "arm")
    assert answer.code == 2 and "there is no mapping for 'arm'" in answer.err
