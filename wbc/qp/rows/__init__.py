"""QPs given by their rows, and the solvers that need no products to be made first."""

from __future__ import annotations

from wbc.qp.answer import Answer, Counts, Solution
from wbc.qp.problem import QP
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.row_task import Outcome, RowTask
from wbc.qp.rows.solver import RowSolver
from wbc.qp.solver import Solver
from wbc.types import Status

__all__ = ["Counts", "Outcome", "RowProblem", "RowSolver", "RowTask", "open_rows", "solution_of"]


def open_rows(problem: RowProblem, solver: Solver) -> RowSolver:
    """The way this problem is solved, decided once.

    The default solver takes rows (:mod:`wbc.qp.rows.core`). Any other solver gets the standard form.
    """
    from wbc.qp.rows.core import CoreSolver
    from wbc.qp.rows.standard import StandardSolver

    if solver.takes_rows:
        return CoreSolver(problem)
    return StandardSolver(problem, solver)


def solution_of(solver: RowSolver, qp: QP, status: Status) -> Solution:
    """The solution of the standard form ``qp``, with the full certificate recomputed from its data."""
    found = Answer(status, solver.answer(), *solver.multipliers()) if status.ok else Answer.none(qp.shape, status)
    proof = found.certificate(qp)
    return Solution(status, found.x, found.y, found.z, found.z_box, proof, solver.iterations, solver=solver.form)
