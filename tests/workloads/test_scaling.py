"""What grows along each axis grows, and nothing else; every size can be solved."""

from __future__ import annotations

import numpy as np
import pytest

from tasks.workloads.chains import chain, many_legs
from tasks.workloads.scaling import AXES
from wbc.control.controller import Controller
from wbc.plugins import registered
from wbc.report.scaling import Axis, Problem

ENDS = [(name, size) for name, axis in AXES.items() for size in (axis.sizes[0], axis.sizes[-2], axis.sizes[-1])]


def ticked(problem: Problem, count: int = 15) -> Controller:
    controller = Controller(problem.robot, problem.stack, level=problem.level)
    for moment in problem.states(count):
        controller.tick(*moment)
    return controller


def test_the_axes_are_registered():
    assert set(AXES) <= set(registered(Axis))


@pytest.mark.parametrize(("name", "size"), ENDS)
def test_every_size_is_solved_and_is_what_it_says(name: str, size: int):
    problem = AXES[name].problem(size)
    controller = ticked(problem)
    assert controller.status.ok, controller.explain()
    counted = {
        "joints": problem.robot.nj, "joints, velocity level": problem.robot.nj, "tasks": len(problem.stack.tasks) - 1,
        "contacts": len(problem.stack.contacts), "active rows": size,
    }  # fmt: skip
    assert counted[name] == size
    if name == "active rows":
        assert size <= controller.active_count <= size + 5, "the weak joints are at their limits, hardly any other is"


@pytest.mark.parametrize("limits", [10, 30])
def test_limits_that_go_on_holding_are_guessed_although_forces_of_a_long_chain_lose_digits(limits: int):
    counts = ticked(AXES["active rows"].problem(limits)).counts
    assert counts.fallback <= 2 and counts.first >= 10, counts


def test_robots_of_one_size_are_one_robot_and_have_the_rank_they_need():
    assert chain(14) is chain(14) and chain(14).nj == 14
    legs, rng = many_legs(8), np.random.default_rng(1)
    state = legs.state()
    state.update(0.0, legs.random_configuration(rng), np.zeros(legs.nv))
    feet = np.vstack([state.frame(f"foot{i}").jacobian()[:3] for i in range(8)])
    assert np.linalg.matrix_rank(feet) == 24


def test_states_are_the_same_each_time_and_move_as_they_say():
    problem = AXES["contacts"].problem(2)
    once, again = list(problem.states(5)), list(problem.states(5))
    for (_, q, v), (_, q_again, v_again) in zip(once, again, strict=True):
        assert np.array_equal(q, q_again) and np.array_equal(v, v_again)
    (t0, q0, v0), (t1, q1, v1) = once[:2]
    mean = 0.5 * (v0 + v1)[6:]
    np.testing.assert_allclose(problem.robot.difference(q0, q1)[6:] / (t1 - t0), mean, atol=1e-6)
