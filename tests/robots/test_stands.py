"""Robots that stand through their own bytes, are pushed, and are held when the run ends or its script is killed."""

from __future__ import annotations

import numpy as np
import pytest

from tests.robots.examples import needs_examples

pytest.importorskip("mujoco")
pytestmark = [pytest.mark.physics, needs_examples]

from tests.robots.real_time import ran  # noqa: E402 - needs the physics engine
from tests.robots.stands import ROBOTS, killed, stood  # noqa: E402

SEEDS = 10
RUNS = [
    pytest.param(name, seed, marks=pytest.mark.deep if seed or name == "g1" else pytest.mark.slow)
    for name in ROBOTS
    for seed in range(SEEDS)
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), RUNS)
def test_a_robot_stands_through_its_bytes_and_is_held(name: str, seed: int):
    one = stood(name, seed)
    assert one.ok, one
    assert one.largest > 2e-3, "nobody pushed"


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), RUNS)
def test_a_robot_whose_script_is_killed_is_held(name: str, seed: int):
    one = killed(name, seed)
    assert one.ok, one


@pytest.mark.deep
def test_a_loop_in_real_time_misses_no_state():
    run, periods = ran(2.0)
    assert run.meta["ended"] == "complete" and run.rows == 2000 and (run["status"] == 0).all()
    assert np.median(periods) == pytest.approx(1e-3, rel=0.05)
