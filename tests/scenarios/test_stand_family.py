"""Pushes from all sides and loads in either hand: each is a row, and both sides are treated alike."""

from __future__ import annotations

import pytest

from tasks.scenarios.stand_family import LOAD, PUSH, STANCES
from tests.robots.examples import needs_examples
from tests.scenarios.test_faults import run


@pytest.mark.physics
def test_our_quadruped_is_pushed_from_both_sides_alike() -> None:
    result = run("stand-family", "robot=quadruped", "sides=2", "push=20", duration=1.7)
    forward, backward = result.figures["rows"]
    assert forward["stands"] and backward["stands"] and result.ok
    assert forward["what"] == "push towards 0°" and backward["what"] == "push towards 180°"
    assert 0.5 < forward["most_mm"] / backward["most_mm"] < 2.0
    (section,) = result.sections
    assert section.title == "From all sides"


@pytest.mark.parametrize("name", [*(pytest.param(n, marks=needs_examples) for n in ("talos", "g1", "go2")), "humanoid",
                                  "quadruped"])  # fmt: skip
def test_usual_pushes_and_loads_are_felt_and_are_no_robots_weight(name: str) -> None:
    mass = STANCES[name].robot(name).mass
    assert 0.02 < PUSH[name] / (9.81 * mass) < 0.5
    assert name not in LOAD or 5e-3 < LOAD[name] / mass < 0.1


@pytest.mark.parametrize("name", STANCES)
def test_stances_are_the_same_on_both_sides(name: str) -> None:
    joints = STANCES[name].joints
    for joint, angle in joints.items():
        assert abs(joints[joint.replace("left", "right") if "left" in joint else joint]) == abs(angle)


@pytest.mark.physics
def test_our_humanoid_bears_its_usual_load_in_either_hand() -> None:
    result = run("stand-family", "robot=humanoid", "push=0", duration=1.8)
    assert result.ok
    left, right = result.figures["rows"]
    assert [left["what"], right["what"]] == ["load in left_hand", "load in right_hand"]
    assert left["most_mm"] == pytest.approx(right["most_mm"], rel=0.1)
