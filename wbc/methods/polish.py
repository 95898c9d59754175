"""An answer to the last digit: the rows that a solver found to push, held exactly.

Solvers stop at their own tolerance, 1e-9 or 1e-6 in the units they see. Which rows push is known long before that, and
with those rows as equations E x = e the point nearest to the origin is one linear system, x = E# e. It is taken only
where it meets all conditions of optimality to rounding, so it is the optimum whoever guessed the rows.

Where more rows meet than there are directions, multipliers are not unique, and those of a solver need not show which
rows explain its x: x = −Fᵀ z with z ≥ 0. Non-negative least squares over the rows that x lies on does, with rows that
are independent of each other (Lawson, Hanson: Solving Least Squares Problems, 1974, chapter 23).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import nnls

from wbc.qp.problem import QP
from wbc.types import Index, Vec

#: Violations beside numbers of about one, and multipliers of a wrong sign beside the largest, that are rounding.
EXACT = 1e-11
#: The part of a row of unit length that the others do not have, from which it counts as a row of its own.
INDEPENDENT = 1e-7
#: How near to x a row is that x may lie on, in sizes of x.
NEAR = (1e-8, 1e-6, 1e-4)
TRIES = 16


def polished(qp: QP, x: Vec, z: Vec) -> tuple[Vec, Vec, Vec] | None:
    """x, y and z of  minimise ½ |x|²  subject to  A x = b,  cl ≤ C x ≤ cu  from an approximation, exact to rounding.

    ``None`` where the rows that push in the approximation, and a few exchanges, do not lead there. Rows of A are
    independent and numbers about one.
    """
    if not (np.isfinite(x).all() and np.isfinite(z).all()):
        return None
    for side, push in _guesses(qp, x, z):
        found = _exchanged(qp, side, push)
        if found is not None:
            return found
    return None


def _guesses(qp: QP, x: Vec, z: Vec) -> Iterator[tuple[Vec, Vec]]:
    """Sides (−1, 0, 1) that rows push on and how much: by the multipliers, then by what explains x."""
    values = qp.C @ x
    yield np.where(z > qp.cu - values, 1.0, np.where(-z > values - qp.cl, -1.0, 0.0)), z
    size = max(1.0, float(np.linalg.norm(x)))
    for near in NEAR:
        above, below = (qp.cu - values <= near * size).nonzero()[0], (values - qp.cl <= near * size).nonzero()[0]
        rows = np.vstack([qp.A, -qp.A, qp.C[above], -qp.C[below]])
        if not len(rows):
            continue
        try:
            push = nnls(rows.T, -x)[0][2 * qp.n_eq :]
        except RuntimeError:
            continue
        side, force = np.zeros(len(z)), np.zeros(len(z))
        np.add.at(force, np.concatenate([above, below]), push)
        side[above[push[: len(above)] > 0.0]] = 1.0
        side[below[push[len(above) :] > 0.0]] = -1.0
        yield side, force


def _exchanged(qp: QP, side: Vec, z: Vec) -> tuple[Vec, Vec, Vec] | None:
    """The answer with rows held on these sides, and after exchanges of rows that violate or pull."""
    for attempt in range(TRIES):
        held = _independent(qp, side.nonzero()[0], z)
        side = np.where(np.isin(np.arange(len(side)), held), side, 0.0)
        E = np.concatenate([qp.A, qp.C[held]])
        e = np.concatenate([qp.b, np.where(side[held] > 0.0, qp.cu[held], qp.cl[held])])
        if not np.isfinite(e).all():
            return None
        inverse = np.linalg.pinv(E, rcond=1e-10)
        x = inverse @ e
        x += inverse @ (e - E @ x)
        push = -(inverse.T @ x)
        values, force = qp.C @ x, np.zeros(len(side))
        force[held] = push[qp.n_eq :]
        over, under = values - qp.cu, qp.cl - values
        pulls = np.where(qp.cl < qp.cu, -side * force, 0.0) / max(np.abs(force).max(initial=0.0), EXACT)
        violates = np.where(side == 0.0, np.maximum(over, under), 0.0) / max(1.0, float(np.linalg.norm(x)))
        wrong = np.maximum(pulls, violates)
        if wrong.max(initial=0.0) <= EXACT:
            return x, push[: qp.n_eq], force
        # All that are wrong at once, which may go in circles; then the worst alone.
        change = wrong > (EXACT if attempt < TRIES // 2 else 0.999 * wrong.max())
        enters = change & (side == 0.0)
        side = np.where(enters, np.where(over > under, 1.0, -1.0), np.where(change, 0.0, side))
        z = np.where(enters, np.inf, force)
    return None


def _independent(qp: QP, rows: Index, z: Vec) -> Index:
    """Those of the rows of C that are independent of A and of each other, what pushes more before what pushes less.

    Where more rows meet than there are directions, their multipliers are not unique and some would have wrong signs.
    """
    basis, kept = list(np.linalg.qr(qp.A.T)[0].T), []
    for row in rows[np.argsort(-np.abs(z[rows]), kind="stable")]:
        beside = qp.C[row].copy()
        for _ in range(2):  # once is not orthogonal enough
            for direction in basis:
                beside -= (direction @ beside) * direction
        length = float(np.linalg.norm(beside))
        if length > INDEPENDENT:
            basis.append(beside / length)
            kept.append(row)
    return np.array(sorted(kept), dtype=np.intp)
