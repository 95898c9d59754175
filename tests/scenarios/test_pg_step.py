"""pg-step: the step of the plane in exact numbers, and the QP never costlier than the step along a path."""

from __future__ import annotations

import pytest

from tasks.scenarios import SCENARIOS
from wbc.report.document import Figure, Plot
from wbc.sim.scenario import ScenarioResult, Settings


def run(*settings: str) -> ScenarioResult:
    scenario = SCENARIOS["pg-step"]
    chosen = scenario.choose(plant=None, hierarchy=None, duration=1.5)
    return scenario.run(scenario.parse(["robot=arm", *settings]), Settings(**chosen))


def test_it_is_good_and_its_numbers_are_those_of_the_plane():
    result = run()
    assert not [check for check in result.verdict if not check.ok]
    assert result.figures["alpha_star_in_plane"] == pytest.approx(1.1, abs=1e-12)
    assert 0.0 < result.figures["share_of_ticks_with_a_full_step"] < 1.0, "limits and gradient must both be felt"


def test_a_task_too_fast_for_the_joints_is_not_called_good():
    result = run("speed=0.05")
    assert "certified ticks" in [check.text for check in result.verdict if not check.ok]


def test_its_sections_show_the_plane_and_the_path():
    result = run()
    plane, path = result.sections
    assert [item.name for section in (plane, path) for item in section.items if isinstance(item, Figure | Plot)] == [
        "pg-plane", "pg-alpha", "pg-climb", "pg-speed",
    ]  # fmt: skip
    assert b"<svg" in plane.items[0].data
