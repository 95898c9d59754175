"""The core on problems with ties, zeros, duplicates and contradictions, against solvers that share no code with it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from wbc.qp.problem import Row
from wbc.qp.rows import RowProblem
from wbc.qp.rows.core import CoreSolver
from wbc.qp.solvers import by_name
from wbc.types import Status

ROOT = Path(__file__).parents[3]


def drawn_problem(seed: int) -> RowProblem:
    """Integers, ties, rows of zeros, rows given twice, scaled rows, crossed tasks; feasible or not."""
    rng = np.random.default_rng(seed)
    n_u, n_y = int(rng.choice([0, 0, 2])), int(rng.integers(1, 9))
    n_range, n_soft, n_equal = int(rng.integers(0, 9)), int(rng.integers(0, 9)), int(rng.integers(0, 3))
    m, n = n_u + n_range + n_soft + n_equal, n_u + n_y
    p = RowProblem(
        n_u, n_y, n_range=n_range, n_soft=n_soft, n_equal=n_equal,
        rows=[Row(f"row {i}") for i in range(m)] + [Row(f"x{i}") for i in range(n)], regularisation=1e-9,
    )  # fmt: skip
    p.G[:m] = rng.integers(-2, 3, size=(m, n + 1))
    for row in range(n_u, m):
        kind = rng.integers(6)
        if kind == 0:
            p.G[row] = 0.0
        elif kind == 1 and row > n_u:
            p.G[row] = p.G[row - 1]
        elif kind == 2:
            p.G[row] *= 10.0 ** rng.integers(-4, 5)
    p.G[p.equal, n] *= rng.integers(0, 2)
    if n_u:
        root = rng.normal(size=(n_u, n_u))
        p.G[:n_u, :n_u] = root @ root.T + np.eye(n_u)
    p.metric[:] = 10.0 ** rng.integers(-2, 3, n_y)
    p.weights[:] = 10.0 ** rng.integers(-2, 3, n_soft)
    p.centre[:] = rng.integers(-3, 4, n_y)
    lower, upper = p.range_bounds()
    for low, high in ((lower, upper), (p.lb[n_u:], p.ub[n_u:])):
        low[:] = rng.integers(-3, 2, len(low))
        high[:] = low + rng.integers(0, 4, len(low))
        low[rng.random(len(low)) < 0.4] = -np.inf
        high[rng.random(len(low)) < 0.4] = np.inf
    return p


def judge(seed: int) -> Status:
    """Solve twice, from nothing and from an arbitrary guess, and compare both answers with other solvers'."""
    p = drawn_problem(seed)
    solver = CoreSolver(p)
    status = solver.solve()
    qp = p.empty_qp()
    p.write_qp(qp)
    if status is Status.INFEASIBLE:
        # The least by which all rows and bounds must be relaxed together, by the simplex method.
        rows = np.concatenate([qp.matrix, -qp.matrix, np.eye(qp.n), -np.eye(qp.n)])
        right = np.concatenate([qp.upper, -qp.lower, qp.ub, -qp.lb])
        known = np.isfinite(right)
        found = linprog(
            np.r_[np.zeros(qp.n), 1.0], A_ub=np.c_[rows, -np.ones(len(rows))][known], b_ub=right[known],
            bounds=[(None, None)] * qp.n + [(0, None)], method="highs",
        )  # fmt: skip
        assert found.status == 0 and found.fun > 1e-9, (seed, found.fun)
        return status
    if not status.ok:
        return status
    x, cost = p.x * p.scale, 0.0
    assert solver.certificate.ok
    cost = 0.5 * x @ qp.H @ x + qp.g @ x
    other = by_name("clarabel").solve(qp)
    if other.status.ok:
        least = 0.5 * other.x @ qp.H @ other.x + qp.g @ other.x
        terms = 0.5 * np.abs(x) @ np.abs(qp.H) @ np.abs(x) + np.abs(qp.g) @ np.abs(x)
        assert cost <= least + 1e-6 * (1.0 + terms), (seed, cost - least)
    once = p.x.copy()
    rng = np.random.default_rng(seed)
    items = np.flatnonzero(rng.random(p.n_y) < 0.5) + p.n_u
    solver.guess(items, rng.choice([-1.0, 1.0], len(items)))
    assert solver.solve() is Status.SOLVED, seed
    np.testing.assert_allclose(p.x, once, rtol=0, atol=1e-7 * (1.0 + np.abs(once).max()))
    return status


@given(st.integers(0, 10**9))
def test_answers_are_those_of_other_solvers_and_infeasible_is_true(seed: int) -> None:
    judge(seed)


def test_next_to_no_problem_is_left_undecided() -> None:
    found = [judge(seed) for seed in range(300)]
    assert found.count(Status.SOLVED) > 100 and found.count(Status.INFEASIBLE) > 30
    undecided = len(found) - found.count(Status.SOLVED) - found.count(Status.INFEASIBLE)
    assert undecided <= 3, undecided


def test_crossed_bounds_are_a_failure_and_the_next_problem_is_solved() -> None:
    p = drawn_problem(3)
    solver = CoreSolver(p)
    before = solver.solve()
    low, high = p.lb[p.n_u], p.ub[p.n_u]
    p.lb[p.n_u], p.ub[p.n_u] = 2.0, 1.0
    assert not solver.solve().ok
    p.lb[p.n_u], p.ub[p.n_u] = low, high
    assert before is Status.SOLVED and solver.solve() is before


@pytest.mark.parametrize("weight", [1e7, 1e9, 1e11])
def test_weights_that_are_raised_after_the_form_was_chosen_are_certified(weight: float) -> None:
    """Rows of the same weight, two of them contradicting each other, far above the metric."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        p = RowProblem(0, 6, n_range=0, n_soft=4, n_equal=0, rows=[Row(f"{i}") for i in range(10)], regularisation=1e-9)
        p.G[:] = rng.normal(size=p.G.shape)
        p.G[p.soft.stop - 1, :6] = 2.0 * p.G[p.soft.stop - 2, :6]
        solver = CoreSolver(p)
        p.weights[:] = weight
        assert solver.form == "rows" and solver.solve() is Status.SOLVED, seed


@pytest.mark.slow
def test_kernels_run_as_python_with_the_same_answers_and_stay_within_their_memory() -> None:
    """There an index beyond an array raises; `make kernels` tries more, with machine code that looks too."""
    code = """
from tests.families.hierarchies import FAMILIES, cases
from tests.qp.rows.test_core import judge
for seed in range(12):
    judge(seed)
assert not [case for case in cases(2 * len(FAMILIES), 1, ["pdas"]) if case.wrong]
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, check=False, env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
