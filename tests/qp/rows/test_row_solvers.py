"""A row problem has one answer, whichever way it is solved; the certificate of the standard form says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.qp.problem import Row
from wbc.qp.rows import RowProblem, solution_of
from wbc.qp.rows.core import CoreSolver, fits_rows
from wbc.qp.rows.standard import StandardSolver
from wbc.qp.solvers import by_name
from wbc.types import Status


def row_problem(seed: int, *, n_u: int = 3, n_y: int = 12, n_range: int = 8, n_soft: int = 4, n_equal: int = 3,
                tight: float = 1.0, weights: tuple[float, float] = (1e-2, 1e2)) -> RowProblem:  # fmt: skip
    """A feasible random problem: bounds and ranges hold at a random point, more tightly the smaller ``tight``."""
    rng = np.random.default_rng(seed)
    n, m = n_u + n_y, n_u + n_range + n_soft + n_equal
    p = RowProblem(
        n_u, n_y, n_range=n_range, n_soft=n_soft, n_equal=n_equal,
        rows=[Row(f"row {i}") for i in range(m)] + [Row(f"x{i}") for i in range(n)], regularisation=1e-9,
    )  # fmt: skip
    p.G[:m] = rng.normal(size=(m, n + 1))
    if n_u:
        root = rng.normal(size=(n_u, n_u))
        p.G[:n_u, :n_u] = root @ root.T + np.eye(n_u)
    p.scale[n_u + n_y // 2 :] = rng.uniform(0.5, 2.0)
    p.metric[:] = rng.uniform(0.5, 2.0, n_y)
    p.weights[:] = np.exp(rng.uniform(*np.log(weights), n_soft))
    p.centre[:] = rng.normal(size=n_y)
    p.unit = 0.1
    # A point that satisfies everything: u from the base rows, the equalities shifted to hold there.
    y = rng.normal(size=n_y)
    u = -np.linalg.solve(p.G[:n_u, :n_u], p.G[:n_u, n_u:n] @ y + p.G[:n_u, n]) if n_u else np.zeros(0)
    x = np.concatenate([u, y])
    p.G[p.equal, n] = -p.G[p.equal, :n] @ x
    lower, upper = p.range_bounds()
    at = p.G[p.range] @ np.r_[x, 1.0]
    lower[:] = np.where(rng.random(n_range) < 0.3, -np.inf, at - tight * rng.random(n_range))
    upper[:] = np.where(rng.random(n_range) < 0.3, np.inf, at + tight * rng.random(n_range))
    p.lb[n_u:] = np.where(rng.random(n_y) < 0.4, -np.inf, y - tight * rng.random(n_y))
    p.ub[n_u:] = np.where(rng.random(n_y) < 0.4, np.inf, y + tight * rng.random(n_y))
    return p


@given(
    seed=st.integers(0, 10**6), tight=st.sampled_from([10.0, 1.0, 0.1, 0.01]), n_u=st.sampled_from([0, 3]),
    n_soft=st.sampled_from([4, 30]),
)  # fmt: skip
def test_the_core_gives_the_certified_answer_of_the_standard_form(
    seed: int, tight: float, n_u: int, n_soft: int
) -> None:
    p = row_problem(seed, tight=tight, n_u=n_u, n_soft=n_soft)
    core = CoreSolver(p)
    assert core.solve() is Status.SOLVED
    qp = p.empty_qp()
    p.write_qp(qp)
    mine = solution_of(core, qp, Status.SOLVED)
    assert mine.certificate.within(1e-7), mine.certificate
    assert core.certificate.primal <= 1e-8
    other = by_name("daqp").solve(qp)
    np.testing.assert_allclose(mine.x, other.x, atol=1e-6 * (1 + np.abs(other.x).max()))


@pytest.mark.parametrize("n_u", [0, 3])
@pytest.mark.parametrize("uniform", [False, True])
def test_the_same_problem_twice_is_answered_by_the_first_guess_and_the_same_bits(n_u: int, uniform: bool) -> None:
    p = row_problem(5, tight=0.05, n_u=n_u)
    if uniform:  # and no unknown at a bound: then nothing is scaled
        p.metric[:], p.lb[:], p.ub[:] = 1.0, -np.inf, np.inf
    solver = CoreSolver(p)
    solver.solve()
    assert solver.active_count > 0
    solver.solve()
    once = p.x.copy()
    before = solver.counts.first
    solver.solve()
    assert solver.counts.first == before + 1
    assert solver.iterations == 1
    np.testing.assert_array_equal(once, p.x)


def unloaded_feet(seed: int) -> RowProblem:
    """Feet some of which are not pressed: all four sides of their pyramid meet in its apex, one more than needed."""
    rng = np.random.default_rng(seed)
    feet, n_soft = int(rng.integers(2, 5)), 6
    n, n_range = 3 * feet, 4 * feet
    rows = [Row(f"row {i}") for i in range(n_range + n_soft)] + [Row(f"x{i}") for i in range(n)]
    p = RowProblem(0, n, n_range=n_range, n_soft=n_soft, n_equal=0, rows=rows, regularisation=1e-9)
    friction = rng.uniform(0.2, 1.0)
    sides = np.array([[1.0, 0.0, -friction], [-1.0, 0.0, -friction], [0.0, 1.0, -friction], [0.0, -1.0, -friction]])
    for i in range(feet):
        p.G[4 * i : 4 * i + 4, 3 * i : 3 * i + 3] = sides @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    p.range_bounds()[0][:], p.range_bounds()[1][:] = -np.inf, 0.0
    p.G[p.soft, :n], p.G[p.soft, n] = rng.normal(size=(n_soft, n)), 30.0 * rng.normal(size=n_soft)
    p.weights[:], p.metric[:] = 1.0, 10.0 ** -rng.uniform(2.0, 6.0)
    return p


def test_a_right_guess_is_not_given_up_for_rounding_of_a_row_that_others_imply() -> None:
    kept = 0
    for seed in range(300):
        p = unloaded_feet(seed)
        solver, rng = CoreSolver(p), np.random.default_rng(seed)
        solver.solve()
        for _ in range(5):
            guess = solver.working_set()[0].tolist()
            p.G[p.soft, p.n] *= 1.0 + 1e-3 * rng.normal()
            assert solver.solve() is Status.SOLVED
            if solver.working_set()[0].tolist() == guess:
                kept += 1
                assert solver.work == (1, 0), seed
    assert kept > 1000


def bounds_only(seed: int) -> RowProblem:
    return row_problem(seed, n_u=0, n_range=0, n_equal=0, tight=0.1)


def test_unknowns_whose_bounds_are_one_may_be_pulled_either_way_and_are_guessed() -> None:
    p = bounds_only(2)
    p.lb[:4] = p.ub[:4] = p.centre[:4] + 5.0 * np.array([1.0, -1.0, 1.0, -1.0])
    core = CoreSolver(p)
    core.solve()
    core.guess(np.arange(12), np.ones(12))
    p.lb[4:] = p.ub[4:] = p.centre[4:] + 3.0
    assert core.solve() is Status.SOLVED
    assert core.counts.first == 1
    np.testing.assert_array_equal(p.x, p.lb)
    qp = p.empty_qp()
    p.write_qp(qp)
    assert solution_of(core, qp, Status.SOLVED).certificate.within(1e-8)


@pytest.mark.parametrize("what", ["rows", "centre", "lb", "ub"])
def test_nan_in_a_box_problem_is_a_failure_and_never_an_answer(what: str) -> None:
    for weight in (1e-2, 1e2):
        p = bounds_only(6)
        core = CoreSolver(p)
        assert core.solve() is Status.SOLVED
        {"rows": p.G[0], "centre": p.centre, "lb": p.lb, "ub": p.ub}[what][2] = np.nan
        p.weights[:] = weight
        assert not core.solve().ok


@pytest.mark.parametrize("make", [CoreSolver, lambda p: StandardSolver(p, by_name("daqp"))], ids=["core", "standard"])
@pytest.mark.parametrize("what", ["contradiction", "not a number", "crossed bounds"])
def test_of_a_problem_without_an_answer_nothing_is_proved_whatever_was_before(make: Any, what: str) -> None:
    p = row_problem(3)
    solver = make(p)
    assert solver.solve() is Status.SOLVED and solver.certificate.ok
    if what == "crossed bounds":
        p.lb[p.n_u], p.ub[p.n_u] = 2.0, 1.0
    else:
        p.G[p.equal.start] = p.G[p.equal.start + 1]
        p.G[p.equal.start, -1] += 1.0 if what == "contradiction" else np.nan
    assert not solver.solve().ok and not solver.certificate.ok


@pytest.mark.parametrize("unit", [1e-3, 0.1, 1.0, 10.0, 1e3])
@pytest.mark.parametrize("kind", ["range", "equal"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_row_against_a_bound_is_infeasible_in_any_unit_and_from_either_side(
    side: float, kind: str, unit: float
) -> None:
    """One step inside, there is an answer."""
    names = [Row("row"), Row("task"), Row("x0"), Row("x1")]
    n_range, n_equal = int(kind == "range"), int(kind == "equal")
    p = RowProblem(0, 2, n_range=n_range, n_soft=1, n_equal=n_equal, rows=names, regularisation=1e-6)
    p.weights[:], p.metric[:] = 1.0, 1.0
    p.G[p.soft] = [[1.0, 1.0, 0.0]]
    (p.ub if side > 0.0 else p.lb)[0] = side
    solver = CoreSolver(p)
    for far, status in ((0.5, Status.SOLVED), (2.0, Status.INFEASIBLE), (0.5, Status.SOLVED)):
        if n_range:
            p.G[p.range] = [[unit, 0.0, 0.0]]
            p.range_bounds()[0 if side > 0.0 else 1][:] = side * unit * far
        else:
            p.G[p.equal] = [[unit, 0.0, -side * unit * far]]
        assert solver.solve() is status


def test_nan_in_a_row_is_a_failure_and_never_an_answer() -> None:
    for row in ("soft", "equal", "range"):
        p = row_problem(6)
        p.G[getattr(p, row).start, 4] = np.nan
        assert not CoreSolver(p).solve().ok
        assert not StandardSolver(p, by_name("daqp")).solve().ok


def test_a_soft_row_of_weight_zero_counts_for_nothing() -> None:
    p = row_problem(7, tight=10.0)
    p.weights[0] = 0.0
    CoreSolver(p).solve()
    with_row = p.x.copy()
    p.G[p.soft.start] = 0.0
    CoreSolver(p).solve()
    np.testing.assert_allclose(with_row, p.x, atol=1e-7)


def test_the_form_in_the_unknowns_is_taken_where_the_cost_is_only_regularisation() -> None:
    p = row_problem(8)
    assert CoreSolver(p).form == "rows"
    p.scale[:] = 1.0
    p.metric[0] = 1e-9
    assert not fits_rows(p)


@pytest.mark.parametrize(("n_y", "n_soft", "fits"), [(12, 4, True), (12, 40, True), (12, 200, False), (120, 110, True)])
def test_the_row_form_is_chosen_for_few_rows_or_few_products(n_y: int, n_soft: int, fits: bool) -> None:
    assert fits_rows(row_problem(0, n_y=n_y, n_soft=n_soft)) is fits
