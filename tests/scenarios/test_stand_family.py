"""Pushes from all sides and loads in either hand: each is a row, and both sides are treated alike."""

from __future__ import annotations

import pytest

from tests.scenarios.test_faults import run
from wbc.errors import InvalidInput, UnknownRobot


@pytest.mark.physics
def test_our_quadruped_is_pushed_from_both_sides_alike() -> None:
    result = run("stand-family", "robot=quadruped", "sides=2", "push=20", duration=1.7)
    forward, backward = result.figures["rows"]
    assert forward["stands"] and backward["stands"] and result.ok
    assert forward["what"] == "push towards 0°" and backward["what"] == "push towards 180°"
    assert 0.5 < forward["most_mm"] / backward["most_mm"] < 2.0
    (section,) = result.sections
    assert section.title == "From all sides"


@pytest.mark.physics
def test_our_humanoid_bears_its_usual_load_in_either_hand() -> None:
    result = run("stand-family", "robot=humanoid", "push=0", duration=1.8)
    assert result.ok
    left, right = result.figures["rows"]
    assert [left["what"], right["what"]] == ["load in left_hand", "load in right_hand"]
    assert left["most_mm"] == pytest.approx(right["most_mm"], rel=0.1)


def test_parameters_that_make_no_sense_are_refused_before_the_first_tick() -> None:
    with pytest.raises(UnknownRobot, match="talos"):
        run("stand-family", "robot=talo")
    with pytest.raises(InvalidInput, match=r"come at 1\.2 s"):
        run("stand-family", "robot=quadruped", duration=1.2)
    with pytest.raises(InvalidInput, match="nothing"):
        run("stand-family", "robot=quadruped", "push=0")
    with pytest.raises(InvalidInput, match="load"):
        run("stand-family", "robot=humanoid", "load=heavy")
