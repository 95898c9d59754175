"""What grows along each axis grows, and nothing else; every size can be solved."""

from __future__ import annotations

import numpy as np
import pytest

from tasks.workloads.chains import chain, many_legs
from tasks.workloads.scaling import AXES
from wbc.control.controller import Controller
from wbc.models.model import RobotModel
from wbc.sim.scenario import Setup, scenarios

ENDS = [(name, size) for name, axis in AXES.items() for size in (axis.sizes[0], axis.sizes[-2], axis.sizes[-1])]


def setup(name: str, size: int) -> Setup:
    scenario = AXES[name]
    return scenario.first_setup(scenario.complete_parameters({"size": size}))


def ticked(setup: Setup, count: int = 15) -> Controller:
    return setup.run(duration=count * setup.plant.dt, recorder=False).controller


def test_the_axes_are_registered():
    assert scenarios("growth") == dict(AXES)


@pytest.mark.parametrize(("name", "size"), ENDS)
def test_every_size_is_solved_and_is_what_it_says(name: str, size: int):
    made = setup(name, size)
    controller = ticked(made)
    assert controller.status.ok, controller.explain()
    counted = {
        "joints": made.plant.model.nj, "joints, velocity level": made.plant.model.nj,
        "tasks": len(made.stack.tasks) - 1, "contacts": len(made.stack.contacts), "active rows": size,
    }  # fmt: skip
    assert counted[name] == size
    if name == "active rows":
        assert size <= controller.active_count <= size + 5, "the weak joints are at their limits, hardly any other is"


@pytest.mark.parametrize("limits", [10, 30])
def test_limits_that_go_on_holding_are_guessed_although_forces_of_a_long_chain_lose_digits(limits: int):
    counts = ticked(setup("active rows", limits)).counts
    assert counts.fallback <= 2 and counts.first >= 10, counts


def test_robots_of_one_size_are_one_robot_and_have_the_rank_they_need():
    assert chain(14) is chain(14) and chain(14).nj == 14
    legs, rng = many_legs(8), np.random.default_rng(1)
    state = legs.state()
    state.update(0.0, legs.random_configuration(rng), np.zeros(legs.nv))
    feet = np.vstack([state.frame(f"foot{i}").jacobian()[:3] for i in range(8)])
    assert np.linalg.matrix_rank(feet) == 24


@pytest.mark.parametrize("robot", [chain(12), many_legs(4)], ids=lambda robot: robot.name)
def test_the_mass_of_a_link_lies_within_its_length(robot: RobotModel):
    model = robot.pinocchio
    lengths = [np.linalg.norm(placement.translation) for placement in list(model.jointPlacements)[2:]]
    for inertia in list(model.inertias)[1:]:
        assert 0.0 < np.linalg.norm(inertia.lever) < max(lengths)


def test_states_are_the_same_whatever_is_commanded_and_move_as_they_say():
    once, again = (setup("contacts", size).run(duration=0.005).run for size in (2, 4))
    assert np.array_equal(once["q"], again["q"]) and np.array_equal(once["v"], again["v"])
    q, v, robot = once["q"], once["v"], many_legs(8)
    mean = 0.5 * (v[0] + v[1])[6:]
    np.testing.assert_allclose(robot.difference(q[0], q[1])[6:] / 1e-3, mean, atol=1e-6)
