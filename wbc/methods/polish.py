"""An answer to the last digit: the rows that a solver found to push, held exactly.

Solvers stop at their own tolerance, 1e-9 or 1e-6 in the units they see. Which rows push is known long before that, and
with those rows as equations E x = e the point nearest to the origin is one linear system, x = E# e. It is taken only
where it meets all conditions of optimality to rounding, so it is the optimum whoever guessed the rows.
"""

from __future__ import annotations

import numpy as np

from wbc.qp.problem import QP
from wbc.types import Vec

#: Violations beside numbers of about one, and multipliers of a wrong sign beside the largest, that are rounding.
EXACT = 1e-11
TRIES = 8


def polished(qp: QP, x: Vec, z: Vec) -> tuple[Vec, Vec, Vec] | None:
    """x, y and z of  minimise ½ |x|²  subject to  A x = b,  cl ≤ C x ≤ cu  from an approximation, exact to rounding.

    ``None`` where the rows that push in the approximation, and a few exchanges, do not lead there. Rows of A are
    independent and numbers about one.
    """
    if not (np.isfinite(x).all() and np.isfinite(z).all()):
        return None
    values = qp.C @ x
    side = np.where(z > qp.cu - values, 1.0, np.where(-z > values - qp.cl, -1.0, 0.0))
    for _ in range(TRIES):
        held = side.nonzero()[0]
        E = np.concatenate([qp.A, qp.C[held]])
        e = np.concatenate([qp.b, np.where(side > 0.0, qp.cu, qp.cl)[held]])
        if not np.isfinite(e).all():
            return None
        inverse = np.linalg.pinv(E, rcond=1e-10)
        x = inverse @ e
        x += inverse @ (e - E @ x)
        push = -(inverse.T @ x)
        values, force = qp.C @ x, np.zeros(len(side))
        force[held] = push[qp.n_eq :]
        over, under = values - qp.cu, qp.cl - values
        wrong = (side * force < -EXACT * np.abs(force).max(initial=0.0)) & (qp.cl < qp.cu)
        enters = (np.maximum(over, under) > EXACT) & (side == 0.0)
        if np.abs(E @ x - e).max(initial=0.0) > EXACT:
            if not len(held):
                return None
            side[held[np.abs(z[held]).argmin()]] = 0.0  # they cannot all hold: the one that pushes least does not
            continue
        if not (wrong.any() or enters.any()):
            return x, push[: qp.n_eq], force
        side = np.where(wrong, 0.0, np.where(enters, np.where(over > under, 1.0, -1.0), side))
    return None
