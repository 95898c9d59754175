"""The arm keeps away from what its task leads through; without the limit it does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tasks.scenarios import SCENARIOS
from tasks.scenarios.collision_dodge import PERIOD, obstacles, path
from wbc.errors import InvalidInput
from wbc.models.geometry import Cylinder
from wbc.report import run_report
from wbc.sim.scenario import ScenarioResult, Settings


def run(duration: float, *settings: str, plant: str = "integrator") -> ScenarioResult:
    scenario = SCENARIOS["collision-dodge"]
    chosen = scenario.choose(plant=plant, hierarchy=None, duration=duration)
    return scenario.run(scenario.parse(settings), Settings(**chosen))


def failed(result: ScenarioResult) -> list[Any]:
    return [check for check in result.verdict if not check.ok]


def test_fifty_ticks_are_certified_and_have_a_report():
    result = run(0.05)
    assert not failed(result) and result.run.rows == 50
    assert {obstacle.name for obstacle in result.obstacles} == {"post", "ball"}
    where = result.verdict[0].place
    assert where.plot == "distance" and " and " in where.part and where.at is not None and 0.0 <= where.at < 0.05
    assert "Distances" in [section.title for section in run_report(result).sections]


@pytest.mark.parametrize("t", np.linspace(0.05, 0.95, 7) * PERIOD)
def test_the_rates_of_the_path_are_those_of_its_places(t: float):
    h = 1e-4
    (before, *_), (at, rate, second), (after, *_) = (path(t + shift) for shift in (-h, 0.0, h))
    np.testing.assert_allclose(rate, (after - before) / (2.0 * h), atol=1e-7)
    np.testing.assert_allclose(second, (after - 2.0 * at + before) / h**2, atol=1e-5)


def test_the_post_stands_in_the_way_and_the_ball_swings_across_it():
    post, ball = obstacles()
    way = np.array([path(t)[0] for t in np.linspace(0.0, PERIOD, 200)])
    shape, at = post.shape, post.at(0.0).translation
    assert isinstance(shape, Cylinder)
    inside = np.linalg.norm((way - at)[:, :2], axis=1) < shape.radius
    assert (inside & (np.abs((way - at)[:, 2]) < 0.5 * shape.length)).any()
    swings = np.array([ball.at(t).translation for t in np.linspace(0.0, PERIOD, 200)])
    assert np.ptp(swings[:, 1]) > 0.3 and np.abs(np.diff(swings, axis=0)).max() < 0.05


@pytest.mark.deep
@pytest.mark.physics
def test_in_physics_the_whole_way_there_and_back_is_clear_only_with_the_limit():
    result = run(8.0, plant="mujoco")
    assert not failed(result)
    assert result.figures["min_distance_m"] > 0.0 > result.figures["without_m"]
    assert result.figures["tool_error_at_the_end_m"] < 2e-3
    assert result.figures["largest_torque_step_Nm"] < 10.0


@pytest.mark.parametrize("settings", ["margin=0", "margin=0.5", "margin=-1"])
def test_a_margin_that_makes_no_sense_is_refused(settings: str):
    with pytest.raises(InvalidInput, match="margin is"):
        run(0.05, settings)
