"""Compiled row solvers are the reference again: the same answers, working sets, multipliers and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("numba", reason="extra fast is not installed")

from tests.qp.rows.test_row_solvers import row_problem
from wbc.qp.rows import RowProblem, RowSolver, open_rows, solution_of
from wbc.qp.rows.box import BoxSolver
from wbc.qp.rows.compiled.box import CompiledBoxSolver
from wbc.qp.rows.compiled.dual import CompiledDualSolver
from wbc.qp.rows.dual import DualSolver
from wbc.qp.solvers.pdas import Pdas
from wbc.types import Status


def settled(solver: RowSolver) -> Status:
    """Twice: an answer of DAQP is a guess, and the second answer is the solver's own."""
    solver.solve()
    return solver.solve()


def same(p: RowProblem, reference: RowSolver, compiled: RowSolver) -> None:
    """Both solve ``p`` with the same working set; answers agree to 1e-9, multipliers to 1e-7 of their size."""
    assert settled(reference) is Status.SOLVED
    held = set(zip(*map(np.ndarray.tolist, reference.working_set()), strict=True))
    values, multipliers = p.value[: p.first_row + p.n_rows].copy(), reference.multipliers()
    compiled.solve()
    right = compiled.counts.first
    assert compiled.solve() is Status.SOLVED
    assert compiled.counts.first == right + 1, "the compiled tick answers itself, it does not hand on"
    assert set(zip(*map(np.ndarray.tolist, compiled.working_set()), strict=True)) == held
    scale = 1.0 + np.abs(values).max()
    np.testing.assert_allclose(p.value[: p.first_row + p.n_rows], values, rtol=0, atol=1e-9 * scale)
    for mine, theirs in zip(compiled.multipliers(), multipliers, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-7 * (1.0 + np.abs(theirs).max(initial=0.0)))
    qp = p.empty_qp()
    p.write_qp(qp)
    assert solution_of(compiled, qp, Status.SOLVED).certificate.ok


TIGHT = st.sampled_from([10.0, 1.0, 0.1, 0.01])


@given(seed=st.integers(0, 10**6), tight=TIGHT, n_u=st.sampled_from([0, 3]))
def test_the_compiled_dual_form_is_the_dual_form(seed: int, tight: float, n_u: int) -> None:
    p = row_problem(seed, tight=tight, n_u=n_u)
    same(p, DualSolver(p), CompiledDualSolver(p))


@given(seed=st.integers(0, 10**6), tight=TIGHT, n_soft=st.sampled_from([0, 4, 20]))
def test_compiled_bounds_are_the_bounds(seed: int, tight: float, n_soft: int) -> None:
    p = row_problem(seed, n_u=0, n_range=0, n_law=0, n_soft=n_soft, tight=tight)
    same(p, BoxSolver(p), CompiledBoxSolver(p))


@given(seed=st.integers(0, 10**6), width=st.sampled_from([0.0, 1.0, 100.0]))
def test_bounds_that_move_are_followed(seed: int, width: float) -> None:
    p = row_problem(seed, tight=0.1)
    compiled = CompiledDualSolver(p)
    assert compiled.solve() is Status.SOLVED
    p.lb[p.n_u :] -= width
    p.ub[p.n_u :] += width
    p.centre += 0.01
    same(p, DualSolver(p), compiled)


@given(seed=st.integers(0, 10**6))
def test_weights_are_read_again_when_they_changed(seed: int) -> None:
    p = row_problem(seed, tight=0.3)
    compiled = CompiledDualSolver(p)
    compiled.solve()
    p.weights *= np.linspace(0.0, 3.0, p.n_soft)
    p.unit, p.version = 2.0 * p.unit, p.version + 1
    same(p, DualSolver(p), compiled)


def test_a_law_given_twice_goes_to_the_reference_and_is_met() -> None:
    p = row_problem(4)
    p.G[p.law.start] = p.G[p.law.start + 1]
    compiled = CompiledDualSolver(p)
    assert compiled.solve() is Status.SOLVED
    assert np.abs(p.G[p.law] @ p.x1).max() < 1e-7


@given(seed=st.integers(0, 10**6))
def test_a_range_row_given_twice_is_held_once(seed: int) -> None:
    p = row_problem(seed, tight=0.01)
    first, second = p.range.start, p.range.start + 1
    p.G[second] = p.G[first]
    for bounds in (p.lower, p.upper):
        bounds[p.item(second)] = bounds[p.item(first)]
    compiled = CompiledDualSolver(p)
    assert settled(compiled) is Status.SOLVED
    qp = p.empty_qp()
    p.write_qp(qp)
    assert solution_of(compiled, qp, Status.SOLVED).certificate.ok


@pytest.mark.parametrize("row", ["base", "soft", "law", "range"])
def test_nan_in_a_row_is_a_failure_and_never_an_answer(row: str) -> None:
    p = row_problem(6)
    p.G[getattr(p, row).start, 4] = np.nan
    assert not CompiledDualSolver(p).solve().ok


@pytest.mark.parametrize("what", ["rows", "centre", "bounds"])
def test_nan_in_a_box_problem_is_a_failure_and_never_an_answer(what: str) -> None:
    p = row_problem(6, n_u=0, n_range=0, n_law=0)
    {"rows": p.G[0], "centre": p.centre, "bounds": p.lb}[what][2] = np.nan
    assert not CompiledBoxSolver(p).solve().ok


def test_contradicting_laws_are_infeasible_and_the_next_good_problem_is_solved() -> None:
    p = row_problem(3)
    good = p.G.copy()
    solver = CompiledDualSolver(p)
    p.G[p.law.start] = p.G[p.law.start + 1]
    p.G[p.law.start, -1] += 1.0
    assert solver.solve() is Status.INFEASIBLE
    p.G[:] = good
    assert solver.solve() is Status.SOLVED


def test_a_guess_that_is_right_is_the_first_one() -> None:
    p = row_problem(5, tight=0.05)
    reference, compiled = DualSolver(p), CompiledDualSolver(p)
    settled(reference)
    compiled.guess(*reference.working_set())
    compiled.solve()
    assert (compiled.counts.first, compiled.counts.repaired, compiled.counts.fallback) == (1, 0, 0)
    compiled.reset()
    assert compiled.active_count == 0


def test_the_setting_says_who_is_asked() -> None:
    p, bounds = row_problem(1), row_problem(1, n_u=0, n_range=0, n_law=0)
    assert open_rows(p, Pdas(compiled=True)).form == "dual, compiled"
    assert open_rows(bounds, Pdas(compiled=True)).form == "box, compiled"
    assert open_rows(p, Pdas()).form == "dual"
