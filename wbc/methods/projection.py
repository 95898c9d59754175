"""The point of a polyhedron that is nearest to another, on any solver, to the last digit.

The problem is put in the form in which every solver does best: the distance from the origin, H = 1, no equations, rows
of unit length, numbers about one, no limits that are out of reach; what the solver leaves is polished away. A solver
that ends without an answer is asked once more in mirrored axes, and once in a unit in which its tolerance is coarser.
"""

from __future__ import annotations

import numpy as np

from wbc.errors import SolverFailed
from wbc.methods.polish import polished
from wbc.methods.shared import factors
from wbc.qp.problem import QP
from wbc.qp.solver import Solver
from wbc.qp.solvers import by_name
from wbc.types import Mat, Status, Vec

#: Rows shorter than this, beside what they were, do not depend on what is left.
ROUNDING = 1e-12
#: The certificate of an answer that cannot be polished.
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
    n = len(free)
    same = QP(np.eye(n), np.zeros(n), C=rows, cl=low, cu=high)
    chosen, mirror, status = by_name(solver), np.eye(n) - 2.0 / max(n, 1), Status.FAILED
    for unit, turn in ((1.0, np.eye(n)), (1.0, mirror), (0.01, np.eye(n))):
        answer = chosen.solve(QP(np.eye(n), np.zeros(n), C=rows @ turn, cl=unit * low, cu=unit * high))
        x, z = turn @ answer.x / unit, answer.z / unit
        exact = polished(same, x, z)
        if exact is not None or (answer.certificate.within(ACCURATE) and unit == 1.0):
            return start + size * ((x if exact is None else exact[0]) @ free)
        status = Status.INACCURATE if answer.status.ok else answer.status
    raise SolverFailed(chosen.name, status)
