"""Robots of makers keep what the verdict of their scenario demands, whole in physics."""

from __future__ import annotations

import pytest

from tests.robots.examples import needs_examples
from tests.scenarios.runs import failed, run

pytestmark = [needs_examples, pytest.mark.physics]
#: What is run in every run of the tests, what only when asked, and the figures that a run comes to.
STANDS, STEPS, TROTS = {"stood_s": 10.0}, {"steps": 10}, {"steps": 22}
OFTEN = (("humanoid-stand", "robot=talos", STANDS), ("quadruped-stand", "robot=go2", STANDS))
SELDOM = (
    ("humanoid-stand", "robot=g1", STANDS),
    ("humanoid-stand", "robot=talos push=120", STANDS), ("humanoid-step", "robot=talos", STEPS),
    ("humanoid-step", "robot=g1", STEPS), ("quadruped-trot-in-place", "robot=go2", TROTS),
    ("arm-payload", "", {}), ("arm-actuator-loss", "", {}), ("arm-collision", "", {}), ("dual-arm", "robot=g1", {}),
    ("humanoid-joint-loss", "", {}), ("humanoid-joint-loss", "noise=true masses=0.1 variants=false", {}),
    ("humanoid-joint-loss", "robot=talos", {}), ("quadruped-joint-loss", "", {}), ("quadruped-actuator-weak", "", {}),
    *(("position-drives", f"robot={name}", {}) for name in ("panda", "go2", "g1", "talos", "humanoid")),
)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "settings", "figures"),
    [
        *(pytest.param(*row, marks=pytest.mark.slow) for row in OFTEN),
        *(pytest.param(*row, marks=pytest.mark.deep) for row in SELDOM),
    ],
)
def test_a_real_robot_keeps_what_the_verdict_demands(name: str, settings: str, figures: dict[str, float]) -> None:
    result = run(name, *settings.split())
    assert not failed(result)
    assert {name: result.figures[name] for name in figures} == pytest.approx(figures)
