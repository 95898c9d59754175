"""The certificate of a row problem: every bound holds, whatever the answer is, and no number in it is assumed."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tests.qp.rows.test_row_solvers import row_problem
from wbc.qp.certificate import Certificate
from wbc.qp.relax import relaxed
from wbc.qp.rows.compiled.search import prepare
from wbc.qp.rows.compiled.verify import certify
from wbc.qp.rows.compiled.work import SOLVED
from wbc.qp.rows.core import CoreSolver
from wbc.qp.rows.problem import RowProblem
from wbc.types import Status, Vec


def move_to(p: RowProblem, y: Vec) -> None:
    """Write y, the u that the base's rows give, and all rows."""
    n_u = p.n_u
    p.x[n_u:] = y
    if n_u:
        p.x[:n_u] = -np.linalg.solve(p.G[:n_u, :n_u], p.G[:n_u, n_u : p.n] @ y + p.G[:n_u, p.n])
    p.value[p.first_row : p.first_row + p.n_rows] = p.G[: p.n_rows] @ p.x1


def certified(core: CoreSolver, push: Vec) -> Certificate:
    """The certificate of the loop for what stands in the problem's memory, with these pushes of its rows."""
    prepare(core.address)  # weights, and rows without the base
    core.push[:] = push
    certify(core.address)
    core.concluded(SOLVED)
    return core.certificate


def free_problem(seed: int, decades: float) -> RowProblem:
    """Tasks without limits or equalities, weights over some decades: the optimum is one linear system."""
    p = row_problem(seed, n_range=0, n_equal=0, weights=(10.0**-decades, 10.0**decades))
    p.lb[:], p.ub[:] = -np.inf, np.inf
    p.regularisation = 0.0
    return p


def optimum(p: RowProblem) -> Vec:
    """y of the minimum, from the rows."""
    n_u = p.n_u
    rows = p.G[p.soft]
    if n_u:
        rows = rows[:, n_u:] - rows[:, :n_u] @ np.linalg.solve(p.G[:n_u, :n_u], p.G[:n_u, n_u:])
    root = np.sqrt(np.concatenate([p.weights, p.unit * p.metric]))
    F = root[:, None] * np.concatenate([rows[:, :-1], np.eye(p.n_y)])
    f = root * np.concatenate([-rows[:, -1], p.centre])
    y: Vec = np.linalg.lstsq(F, f, rcond=None)[0]
    return y


@given(seed=st.integers(0, 10**6), decades=st.sampled_from([0.1, 3.0, 6.0]), size=st.sampled_from([1e-6, 1e-2, 1.0]))
def test_no_task_is_farther_from_its_optimum_than_its_bound(seed: int, decades: float, size: float) -> None:
    p, rng = free_problem(seed, decades), np.random.default_rng(seed)
    best = optimum(p)
    move_to(p, best)
    rows, y = p.value[p.first_row :].copy(), best.copy()
    move_to(p, best + size * rng.normal(size=p.n_y))
    push = np.zeros(p.n_rows)
    push[p.soft] = p.weights / p.unit * p.value[p.first_row + p.soft.start : p.first_row + p.soft.stop]
    push[p.soft] *= rng.uniform(0.5, 1.5)  # any split of the gradient is true
    found = certified(CoreSolver(p), push)
    for i in range(p.n_soft):
        row = p.soft.start + i
        off = abs(p.value[p.first_row + row] - rows[row])
        assert off <= found.bounds[p.rows[row].owner] * (1.0 + 1e-6) + 1e-9
    for j in range(p.n_y):
        off = abs(p.x[p.n_u + j] - y[j]) * p.scale[p.n_u + j]
        assert off <= found.bounds[p.rows[p.n_rows + p.n_u + j].owner] * (1.0 + 1e-6) + 1e-9


def test_an_optimum_is_certified_and_a_worse_point_is_not() -> None:
    p = free_problem(3, 3.0)
    core = CoreSolver(p)
    assert core.solve() is Status.SOLVED and core.certificate.distance < 1e-8
    worst = int(p.weights.argmin())
    move_to(p, p.x[p.n_u :] + 1e-2)
    assert not certified(core, core.push.copy()).ok, worst


@pytest.mark.parametrize("room", [1e-7, 1e-3])
def test_the_gap_is_the_push_times_the_room_and_a_push_on_a_distant_bound_counts_for_nothing(room: float) -> None:
    p = row_problem(5, tight=0.3)
    p.lb[:], p.ub[:] = -np.inf, np.inf
    core = CoreSolver(p)
    assert core.solve() is Status.SOLVED
    pushing = int(np.abs(core.push[p.range]).argmax())
    force = core.push[p.range][pushing]
    assert abs(force) > 0.1
    lower, upper = p.range_bounds()
    bound = upper if force > 0 else lower
    bound[pushing] += np.sign(force) * room
    before = core.certificate.gap
    found = certified(core, core.push.copy())
    if room > 1e-6:
        assert found.distance > 1e-3 and not found.ok
    else:
        assert found.gap - before == pytest.approx(p.unit * abs(force) * room, rel=1e-3, abs=0.0)


@given(seed=st.integers(0, 10**6), tight=st.sampled_from([1.0, 0.05]))
def test_violations_count_in_their_own_unit(seed: int, tight: float) -> None:
    p = row_problem(seed, tight=tight)
    core = CoreSolver(p)
    assert core.solve() is Status.SOLVED and core.certificate.primal <= 1e-7
    unknown = p.n_u + int(np.random.default_rng(seed).integers(p.n_y))
    p.ub[unknown] = p.x[unknown] - 1e-3 / p.scale[unknown]
    assert certified(core, core.push.copy()).primal == pytest.approx(1e-3, rel=1e-6)


def test_the_verdict_in_the_loop_is_that_of_the_numbers_it_reports() -> None:
    """Each number rejects by itself: a limit that is missed, a slope that is left, a task far from its optimum."""
    alone: Counter[str] = Counter()
    for seed in range(300):
        rng = np.random.default_rng(seed)
        p = row_problem(seed, tight=0.3) if seed % 3 == 0 else free_problem(seed, 0.1)
        if seed % 3 == 2:  # a heavy cost: a slope moves the answer by next to nothing
            p.metric *= 10.0 ** rng.uniform(3.0, 6.0)
            p.centre[:] = 0.0
        elif seed % 3 == 1:  # a light one: a small slope moves it far
            p.unit *= 1e-5
            p.weights *= 1e-5
        core = CoreSolver(p)
        assert core.solve() is Status.SOLVED
        size = 10.0 ** rng.uniform(-9.0, -2.0)
        if seed % 3 == 0:
            unknown = p.n_u + int(rng.integers(p.n_y))
            p.ub[unknown] = p.x[unknown] - size / p.scale[unknown]
        else:
            move_to(p, p.x[p.n_u :] + size * rng.normal(size=p.n_y))
        found = certified(core, core.push.copy())
        assert bool(certify(core.address)) == found.ok, (seed, found)
        faults = {"primal": found.primal > 1e-6, "dual": found.dual > 1e-6 * found.scale_dual,
                  "distance": found.distance > 1e-4, "none": found.ok}  # fmt: skip
        if sum(faults.values()) == 1:
            alone.update(name for name, is_so in faults.items() if is_so)
    assert min(alone[name] for name in ("primal", "dual", "distance", "none")) >= 5, alone


def test_a_relaxed_problem_keeps_its_linear_cost() -> None:
    qp = wbc.QP([[1.0, 0.0], [0.0, 1.0]], [0.0, -2.0], A=[[1.0, 0.0]], b=[3.0], ub=[1.0, 9.0])
    assert wbc.solve(relaxed(qp, [0], share=1e-4)).x[:2] == pytest.approx([1.0, 2.0], abs=1e-3)


@given(seed=st.integers(0, 10**6), share=st.sampled_from([0.3, 1.0]))
def test_a_task_without_weight_takes_no_part_of_what_is_left_of_the_gradient(seed: int, share: float) -> None:
    """Rows without weight that the answer meets would else explain any distance from the optimum."""
    p, rng = free_problem(seed, 1.0), np.random.default_rng(seed)
    p.weights[rng.random(p.n_soft) < share] = 0.0
    best = optimum(p)
    move_to(p, best + rng.normal(size=p.n_y))
    p.G[p.soft, p.n] -= np.where(p.weights == 0.0, p.value[p.first_row :][p.soft], 0.0)
    move_to(p, p.x[p.n_u :].copy())
    push = np.zeros(p.n_rows)
    push[p.soft] = p.weights / p.unit * p.value[p.first_row :][p.soft]
    found = certified(CoreSolver(p), push)
    for j in range(p.n_y):
        off = abs(p.x[p.n_u + j] - best[j]) * p.scale[p.n_u + j]
        assert off <= found.bounds[p.rows[p.n_rows + p.n_u + j].owner] * (1.0 + 1e-6) + 1e-9
