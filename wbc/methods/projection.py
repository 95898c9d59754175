"""The point of a polyhedron that is nearest to another, on any solver, to the last digit.

The problem is put in the form in which every solver does best: the distance from the origin, H = 1, no equations, rows
of unit length, numbers about one, no limits that are out of reach (:mod:`wbc.methods.least_norm`).
"""

from __future__ import annotations

import numpy as np

from wbc.errors import SolverFailed
from wbc.methods.least_norm import least_norm, residual
from wbc.methods.shared import factors
from wbc.qp.problem import QP
from wbc.qp.solver import Solver
from wbc.qp.solvers import by_name
from wbc.types import Mat, Status, Vec

#: Rows shorter than this, beside what they were, do not depend on what is left.
ROUNDING = 1e-12
#: The residual of an answer, beside its length, that is not one.
ACCURATE = 1e-9


def projection(
    point: Vec, equal: tuple[Mat, Vec], limited: tuple[Mat, Vec, Vec], feasible: Vec, solver: str | Solver
) -> Vec:
    """The x (n,) nearest to ``point`` with A x = b and cl ≤ C x ≤ cu; no row of C is zero.

    ``equal`` is (A, b), ``limited`` (C, cl, cu), and ``feasible`` some x that meets them: the nearest is no further.

    Raises:
        UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
        SolverFailed: the solver ended without an answer.
    """
    (A, b), (C, cl, cu) = equal, limited
    found = factors(A)
    start, free = point + found.inverse(b - A @ point), found.null  # x = start + freeᵀ u, |x − point|² = ... + |u|²
    rows, at = C @ free.T, C @ start
    length = np.linalg.norm(rows, axis=1)
    turns = length > ROUNDING
    rows, length = rows[turns] / length[turns, None], length[turns]
    low, high = (cl - at)[turns] / length, (cu - at)[turns] / length
    size = float(np.maximum(low, -high).max(initial=0.0))
    if size == 0.0:
        return start
    reach = (1.0 + 1e-6) * float(np.linalg.norm(feasible - start)) + 1e-6 * size
    low, high = np.where(low < -reach, -np.inf, low / size), np.where(high > reach, np.inf, high / size)
    chosen, n = by_name(solver), len(free)
    answer = least_norm(QP(np.eye(n), np.zeros(n), C=rows, cl=low, cu=high), chosen, feasible=True)
    if residual(answer) > ACCURATE:
        raise SolverFailed(chosen.name, Status.INACCURATE if answer.status.ok else answer.status)
    return start + size * (answer.x @ free)
