"""Saturation of several tasks: each takes nothing from those above, and has the largest scale that they leave."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from wbc.methods import NullSpaceSaturation
from wbc.qp.solvers import usable
from wbc.testing import check_method
from wbc.testing.strategies import jacobians

INF = np.inf


@st.composite
def two_tasks(draw, *, compatible: bool = False):
    """Two tasks of 4 joints, both of full rank; ``compatible``: one motion inside the limits does both."""
    first, second = draw(jacobians(2, 4, deficient=False, condition=10.0, low=0.1)), draw(
        jacobians(1, 4, deficient=False, condition=10.0, low=0.1))  # fmt: skip
    assume(np.linalg.cond(np.vstack([first, second])) < 1e3)
    limit = np.array(draw(st.lists(st.floats(0.1, 10.0), min_size=4, max_size=4)))
    x = limit * np.array(draw(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4)))
    fast = 0.99 if compatible else draw(st.sampled_from([0.5, 3.0]))
    return [(first, fast * first @ x), (second, fast * second @ x)], limit


@given(two_tasks())
def test_a_task_below_takes_nothing_from_one_above(drawn):
    """Property 23."""
    tasks, limit = drawn
    alone = NullSpaceSaturation.prioritised(tasks[:1], lower=-limit, upper=limit).solve()
    both = NullSpaceSaturation.prioritised(tasks, lower=-limit, upper=limit).solve()
    assert both.scales[0] == pytest.approx(alone.scales[0], abs=1e-9)
    J, target = tasks[0]
    residual = J @ both.x - both.scales[0] * target
    assert np.linalg.norm(residual) <= 1e-8 * (np.linalg.norm(target) + 1e-9)


@given(two_tasks(compatible=True))
def test_tasks_that_can_all_be_done_are_the_recursive_null_space_solution(drawn):
    """Property 25, where no limit is active: x2 = x1 + (J2 N1)# (y2 - J2 x1) (Siciliano, Slotine)."""
    tasks, _ = drawn
    (J1, y1), (J2, y2) = tasks
    x = np.linalg.pinv(J1) @ y1
    null = np.eye(4) - np.linalg.pinv(J1) @ J1
    x = x + np.linalg.pinv(J2 @ null, rcond=1e-9) @ (y2 - J2 @ x)
    found = NullSpaceSaturation.prioritised(tasks, lower=-INF, upper=INF).solve()
    assert found.scales == (1.0, 1.0)
    np.testing.assert_allclose(found.x, x, atol=1e-9 * (1.0 + np.linalg.norm(x)))


@given(two_tasks(compatible=True))
def test_the_order_of_tasks_that_can_all_be_done_does_not_matter(drawn):
    """Property 26, first half."""
    tasks, limit = drawn
    answers = [NullSpaceSaturation.prioritised(t, lower=-limit, upper=limit).solve() for t in (tasks, tasks[::-1])]
    for answer in answers:
        assert answer.scales == pytest.approx((1.0, 1.0), abs=1e-9)
    np.testing.assert_allclose(answers[0].x, answers[1].x, atol=1e-7 * (1.0 + limit.max()))


def test_the_order_of_tasks_that_exclude_each_other_matters():
    """Property 26, second half."""
    up, down = ([[1.0, 1.0]], [1.0]), ([[1.0, 1.0]], [-1.0])
    first = NullSpaceSaturation.prioritised([up, down], lower=-1, upper=1).solve()
    second = NullSpaceSaturation.prioritised([down, up], lower=-1, upper=1).solve()
    np.testing.assert_allclose(first.x, -second.x, atol=1e-12)
    assert first.scales == second.scales == (1.0, None)


def test_a_level_that_admits_no_scale_is_dropped_and_the_next_one_kept():
    tasks = [([[1, 0, 0]], [5.0]), ([[1, 0, 0]], [1.0], [3.0]), ([[0, 1, 1]], [1.0])]
    for solver in usable():
        found = NullSpaceSaturation.prioritised(tasks, lower=-1, upper=1).solve(solver)
        assert found.scales[0] == pytest.approx(0.2, abs=1e-8)
        assert found.scales[1] is None and found.scales[2] == pytest.approx(1.0, abs=1e-8)
        np.testing.assert_allclose(found.x, [1.0, 0.5, 0.5], atol=1e-7)


@given(st.integers(0, 10_000), st.booleans())
def test_a_level_that_those_above_meet_already_is_kept_whole(seed: int, at_rest: bool):
    """It asks for combinations of their rows to be what they are, zero among them: a residual is rounding of x."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    m = int(rng.integers(1, n))
    J, x = rng.standard_normal((m, n)) * 10.0 ** rng.uniform(-3, 3, (m, 1)), rng.standard_normal(n)
    if at_rest:
        x -= np.linalg.pinv(J) @ J @ x
    lower, upper = np.full(n, -INF), np.full(n, INF)
    lower[0] = upper[0] = x[0]
    target = np.zeros(m) if at_rest else J @ x
    mixed = rng.integers(-2, 3, (m, m)).astype(float)
    levels = NullSpaceSaturation.prioritised(
        [(J, target), (J, target), (mixed @ J, mixed @ target)], lower=lower, upper=upper
    )
    assert levels.closed_form().scales == pytest.approx((1.0, 1.0, 1.0), abs=1e-9)


def test_several_tasks_agree_on_every_solver():
    tasks = [([[1.0, 0.5, -0.2, 0.1], [0.3, 1.0, 0.7, -0.4]], [2.0, 1.0]), ([[0.0, 0.1, 1.0, 1.0]], [0.5])]
    prioritised = NullSpaceSaturation.prioritised(tasks, lower=-1.1, upper=1.2)
    check_method(prioritised)


def test_the_drift_of_a_level_above_is_kept_too():
    tasks = [([[1, 1, 0]], [1.0], [0.5]), ([[0, 1, 1]], [1.0], [-0.5])]
    found = NullSpaceSaturation.prioritised(tasks, lower=-3, upper=3).solve("daqp")
    assert found.scales == (1.0, 1.0)
    np.testing.assert_allclose([found.x[0] + found.x[1] + 0.5, found.x[1] + found.x[2] - 0.5], [1.0, 1.0], atol=1e-9)


def test_no_level_may_be_kept():
    nothing = NullSpaceSaturation.prioritised([([[1.0]], [1.0], [5.0])], lower=-1, upper=1).solve()
    assert not nothing.feasible and nothing.scales == (None,) and np.isnan(nothing.x).all()


@pytest.mark.parametrize("solver", ["pdas", "daqp"])
def test_a_task_that_the_one_above_has_decided_otherwise_has_no_scale_and_costs_it_nothing(solver: str):
    J = np.eye(2, 3)
    answer = NullSpaceSaturation.prioritised([(J, [1.0, 0.0]), (J, [0.0, 1.0])], lower=[-2.0] * 3, upper=[2.0] * 3)
    found = answer.solve(solver)
    assert found.scales == (1.0, None)
    np.testing.assert_allclose(found.x, [1.0, 0.0, 0.0], atol=1e-12)
