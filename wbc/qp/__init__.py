"""Quadratic programs: stated with named rows, solved on any back end, certified by ourselves."""

from __future__ import annotations

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.qp.certificate import Certificate, certificate
from wbc.qp.problem import QP, Objective, Row, Shape
from wbc.qp.solver import Session, Solution, Solver

__all__ = ["QP", "Certificate", "Objective", "Row", "Session", "Shape", "Solution", "Solver", "certificate", "solve"]


@tells_arguments
def solve(qp: QP, solver: str | Solver = "pdas") -> Solution:
    """Solve one QP. For a sequence of problems open a session instead: it starts warm.

    Args:
        qp: the problem.
        solver: a name of :func:`wbc.qp.solvers.names`, or a :class:`Solver` with its settings.

    Raises:
        UnknownSolver: no solver has this name.
        SolverMissing: its package is not installed.
        InvalidInput: ``qp`` is no QP.
        InvalidProblem: the data changed since ``qp`` was made and is no longer a problem.

    Example:
        >>> from wbc.qp import QP, solve
        >>> answer = solve(QP([[1.0]], [-3.0], ub=[2.0]))
        >>> print(answer.status, answer.x, answer.z_box)
        solved [2.] [1.]
    """
    from wbc.qp.solvers import by_name

    return by_name(solver).solve(checks.instance("qp", qp, QP, "a wbc.QP"))
