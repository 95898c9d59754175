"""The shortest point of a polyhedron, from any solver, to the last digit.

    minimise ½ |x|²  subject to  A x = b,  cl ≤ C x ≤ cu        rows of about unit length, right sides of about one

A solver is asked for just that, and what it leaves is polished away (:mod:`wbc.methods.polish`). Rows that meet at
acute angles, more rows in one point than there are directions, or an answer that is much longer than what the origin
violates, are too much for some. The same solver is then asked the same in other words, x = start + T v / zoom:

* T makes the columns of C unit length, which opens acute angles, or mirrors the axes;
* limits give way by less than what counts as met, so that one point is not an empty set by rounding;
* from the best answer so far and with a zoom, what it leaves is smaller by as much; the cost is then
  ½ vᵀ TᵀT v / zoom + startᵀ T v.

Answers are compared by their certificate in the words of the first question, and the best is kept.

Weber, Sager, Gleixner: Solving quadratic programs to high precision using scaled iterative refinement, Mathematical
Programming Computation 11, 2019.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from wbc.methods.polish import polished
from wbc.qp.certificate import Certificate, certificate
from wbc.qp.problem import QP
from wbc.qp.solver import Solution, Solver
from wbc.types import Mat, Status, Vec

Axes = Literal["same", "columns", "mirrored"]

#: The residual, beside the length of the answer, from which it is asked for no more.
ACCURATE = 1e-10
#: A polished answer counts as the solver's where it is this near to what the solver had, beside its length.
CLOSE = 1e-1
#: Limits farther away than this, in the units of a question, are none.
FAR = 1e6
#: Rows and columns shorter than this are left as they are.
SHORT = 1e-8
AXES: tuple[Axes, ...] = ("same", "columns")


class Words(NamedTuple):
    """How a question is put: the zoom, the axes, and by how much limits give way."""

    zoom: float
    axes: Axes
    give: float = 0.0


OTHER_WORDS = (
    Words(1.0, "columns"),
    Words(1.0, "mirrored"),
    Words(1.0, "columns", 0.5 * ACCURATE),
    *(Words(zoom, axes) for zoom in (1e1, 1e2, 1e3, 1e4, 1e5) for axes in AXES),
)


def least_norm(qp: QP, solver: Solver, *, feasible: bool = False) -> Solution:
    """The shortest x of the polyhedron, its multipliers and their certificate; INFEASIBLE where there is none.

    Not solved, with the best there is, where the solver does not get there in any words. ``feasible``: there is a
    point, whatever the solver says.
    """
    best = _polished(qp, solver.solve(qp))
    for words in OTHER_WORDS:
        if residual(best) <= ACCURATE or (best.status is Status.INFEASIBLE and not feasible):
            break
        again = _polished(qp, asked(qp, solver, best.x, words))
        if residual(again) < residual(best):
            best = again
        elif again.status is Status.INFEASIBLE and words.zoom == 1.0 and not feasible:
            best = again
    return best


def residual(answer: Solution) -> float:
    """The largest residual of the certificate, beside the length of x; inf where there is no answer."""
    if not np.isfinite(answer.x).all():
        return np.inf
    size, proof = max(1.0, float(np.linalg.norm(answer.x))), answer.certificate
    return max(proof.primal / size, proof.dual / size, proof.gap / size**2)


def asked(qp: QP, solver: Solver, start: Vec, words: Words) -> Solution:
    """The answer to the question in other words, in those of the first."""
    zoom, axes, way = words
    start = start if np.isfinite(start).all() else np.zeros(qp.n)
    T = _turned(qp.C, axes)
    rows = qp.matrix @ T
    length = _lengths(rows)
    at = qp.matrix @ start
    limited = qp.lower < qp.upper
    give = np.where(limited, way, 0.0)
    low, high = (qp.lower - at - give) * zoom / length, (qp.upper - at + give) * zoom / length
    low[limited & (low < -FAR)], high[limited & (high > FAR)] = -np.inf, np.inf
    m, H, g = qp.n_eq, T.T @ T / zoom, start @ T
    unit, rows = max(float(np.abs(H).max()), float(np.abs(g).max())), rows / length[:, None]
    found = solver.solve(QP(H / unit, g / unit, A=rows[:m], b=low[:m], C=rows[m:], cl=low[m:], cu=high[m:]))
    if not np.isfinite(found.x).all():
        return replace(found, x=np.full(qp.n, np.nan))
    x, force = start + T @ found.x / zoom, np.concatenate([found.y, found.z]) * unit / length
    return replace(found, x=x, y=force[:m], z=force[m:], certificate=_proof(qp, x, force[:m], force[m:]))


def _turned(C: Mat, axes: Axes) -> Mat:
    """x = T v."""
    n = C.shape[1]
    if axes == "columns":
        return np.diag(1.0 / _lengths(C.T))
    return np.eye(n) - (2.0 / n if axes == "mirrored" else 0.0)


def _polished(qp: QP, answer: Solution) -> Solution:
    """The same with the rows that push held exactly, where the certificate says that this is better."""
    exact = polished(qp, answer.x, answer.z)
    if exact is None or np.linalg.norm(exact[0] - answer.x) > CLOSE * max(1.0, float(np.linalg.norm(exact[0]))):
        return _judged(answer)
    x, y, z = exact
    better = replace(answer, x=x, y=y, z=z, certificate=_proof(qp, x, y, z))
    return _judged(better if residual(better) < residual(answer) else answer)


def _judged(answer: Solution) -> Solution:
    """Solved where the certificate says so."""
    if answer.certificate.ok:
        return replace(answer, status=Status.SOLVED)
    return replace(answer, status=Status.INACCURATE) if answer.status.ok else answer


def _proof(qp: QP, x: Vec, y: Vec, z: Vec) -> Certificate:
    return certificate(qp, x, y, z, np.zeros(qp.n))


def _lengths(rows: Vec) -> Vec:
    length: Vec = np.linalg.norm(rows, axis=1)
    return np.where(length > SHORT, length, 1.0)
