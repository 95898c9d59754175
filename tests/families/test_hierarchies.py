"""Each week other hierarchies of every family: no wrong answer on any solver for control, and none that raises."""

from __future__ import annotations

import pytest

import wbc
from tests.families.hierarchies import FAMILIES, cases, far_scaled, judge, problem, scaled
from tests.seeds import SEED
from wbc.qp.solver import Solver
from wbc.qp.solvers import Osqp, Piqp
from wbc.types import Status


@pytest.mark.parametrize("solver", ["pdas", "daqp", "piqp", "osqp", "clarabel"])
def test_no_answer_to_a_random_hierarchy_is_wrong(solver: str) -> None:
    found = list(cases(12 * len(FAMILIES), SEED, [solver]))
    assert not [case for case in found if case.wrong]
    assert sum(case.status != "SOLVED" for case in found) <= 0.05 * len(found)


@pytest.mark.parametrize("solver", [Osqp(max_iter=1), Piqp(max_iter=1)], ids=["osqp", "piqp"])
def test_a_solver_that_names_wrong_rows_leaves_an_honest_status(solver: Solver) -> None:
    for index in range(60):
        for family in (scaled, far_scaled):
            p = problem(family, 21, index)
            assert judge(p, wbc.lexicographic(p.levels, lb=p.lb, ub=p.ub, solver=solver)) == ""


def test_a_hierarchy_of_which_no_level_was_decided_has_failed() -> None:
    """Rows seven decades apart, of which only the default solver finds those that push."""
    p = problem(far_scaled, 21, 541)
    for solver in ("daqp", "piqp", "osqp", "clarabel"):
        answer = wbc.lexicographic(p.levels, lb=p.lb, ub=p.ub, solver=solver)
        assert judge(p, answer) == ""
        assert answer.status is Status.SOLVED or not answer.certificate.ok
