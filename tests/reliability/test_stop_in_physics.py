"""On legs, in physics: from the tick on in which every solver fails the robot comes to rest, and stands."""

from __future__ import annotations

import numpy as np
import pytest

import wbc
from tasks.scenarios import humanoid_stand, quadruped_stand
from tasks.scenarios.standing import standing_plant, standing_stack
from tests.reliability.faults import Saboteur

pytestmark = pytest.mark.physics


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param("quadruped", marks=pytest.mark.deep), "humanoid"])
def test_a_robot_that_sways_stops_and_stands_when_all_solvers_fail(name: str):
    stance = (quadruped_stand if name == "quadruped" else humanoid_stand).STANCES[name]
    robot = stance.robot(name)
    stack, saboteur = standing_stack(robot, stance), Saboteur()
    control = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), solver=saboteur)
    control.mode.second = wbc.Weighted().open(control.plan.problem, saboteur)
    plant = standing_plant(robot, stance, stack.contacts)
    for k in range(1500):
        saboteur.script.fault = "iterations" if k >= 500 else ""
        plant.step(control.tick(plant.t, plant.q, plant.v))
    assert control.fallbacks.counts["damped"] == 990
    assert not plant.fallen
    assert np.abs(plant.v).max() < 0.01
