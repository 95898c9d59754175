"""The arm keeps away from what its task leads through; without the limit it does not."""

from __future__ import annotations

import numpy as np
import pytest

import wbc
from tasks.scenarios.collision_dodge import EVERY, FAR, PERIOD, clearance, obstacles, path
from tests.scenarios.runs import failed, run
from wbc.models.collision import Distances
from wbc.models.geometry import Cylinder
from wbc.report import run_report


def test_fifty_ticks_are_certified_and_have_a_report():
    result = run("collision-dodge", plant="integrator", duration=0.05)
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


@pytest.mark.parametrize("seed", range(5))
def test_the_clearance_is_the_smallest_distance_of_all_pairs_at_every_time(seed: int):
    """Along random motions, against a reading that has a row for every pair."""
    rng, arm, around = np.random.default_rng(seed), wbc.load("arm"), obstacles()
    t = 4e-3 * np.arange(400)
    slow, phase = rng.uniform(0.1, 1.0, arm.nv), rng.uniform(0.0, 2.0 * np.pi, arm.nv)
    q = arm.q0 + 0.6 * np.sin(2.0 * np.pi * slow * t[:, None] + phase)
    found = clearance(wbc.Run({"t": t, "plant.q": q}, {}), arm, around)
    state, all_of_them = arm.state(drifts=False), Distances(arm, obstacles=around, count=1000, reach=FAR)
    assert np.array_equal(found.times, t[::EVERY])
    for k, row in enumerate(range(0, len(t), EVERY)):
        state.update(float(t[row]), q[row], np.zeros(arm.nv))
        all_of_them.read(state)
        nearest = int(np.argmin(all_of_them.distance))
        assert found.distances[k] == all_of_them.distance[nearest]
        if found.distances[k] < FAR:
            assert found.pairs[k] == all_of_them.pairs[all_of_them.which[nearest]]


@pytest.mark.deep
@pytest.mark.physics
def test_in_physics_the_whole_way_there_and_back_is_clear_only_with_the_limit():
    result = run("collision-dodge", plant="mujoco", duration=8.0)
    assert not failed(result)
    assert result.figures["min_distance_m"] > 0.0 > result.figures["without_m"]
    assert result.figures["tool_error_at_the_end_m"] < 2e-3
    assert result.figures["largest_torque_step_Nm"] < 10.0
