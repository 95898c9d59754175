"""Least violation: what gives way, and by how much, where rows contradict each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from wbc.qp.problem import QP, Row

#: Violations below this, in the row's unit, are rounding.
_SHOWN = 1e-6
_REGULARISATION = 1e-10


class Violation(NamedTuple):
    """A row, or a bound of a variable, and by how much it gives way: positive beyond its upper side."""

    row: Row
    amount: float


def least_violation(qp: QP, *, keep: Callable[[Row], bool] = lambda row: False) -> list[Violation]:
    """The rows that give way at the point which breaks the laws least, the largest first; empty if none needs to.

    minimise ½ ‖s‖² + ½ ε ‖x‖²  subject to  lower ≤ [A; C; I] x − s ≤ upper, each s in its row's own unit; rows for
    which ``keep`` is true hold exactly. A compromise that tells where a conflict is, not a smallest set of rows.

    Example:
        >>> import wbc
        >>> from wbc.qp.relax import least_violation
        >>> qp = wbc.QP([[1.0]], [0.0], C=[[1.0], [1.0]], cl=[1.0, -9.0], cu=[9.0, -1.0])
        >>> [(str(v.row), round(v.amount, 3)) for v in least_violation(qp)]
        [('C[0]', -1.0), ('C[1]', 1.0)]
    """
    from wbc.qp.solvers import by_name

    n = qp.n
    matrix = np.vstack([qp.matrix, np.eye(n)])
    lower, upper = np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub])
    limited = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
    rows = [qp.rows[i] for i in limited]
    gives = np.array([not keep(row) for row in rows], dtype=np.float64)
    m = len(limited)
    H = np.diag(np.concatenate([np.full(n, _REGULARISATION), np.ones(m)]))
    C = np.hstack([matrix[limited], -np.diag(gives)])
    solution = by_name("daqp").solve(QP(H, np.zeros(n + m), C=C, cl=lower[limited], cu=upper[limited]))
    slack = solution.x[n:] * gives
    shown = np.flatnonzero(np.abs(slack) > _SHOWN)
    return [Violation(rows[i], float(slack[i])) for i in shown[np.argsort(-np.abs(slack[shown]))]]
