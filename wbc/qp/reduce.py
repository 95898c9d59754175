"""Presolve: another problem with the same answer, and the way back."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from wbc.qp.problem import QP, Shape
from wbc.qp.refine import Point, refined
from wbc.qp.solver import Answer
from wbc.types import Status, Vec

#: Curvature that makes a problem strictly convex, beside the largest there is, and how often its centre moves.
_PROX, _STEPS = 1e-4, 12
#: By how much the rows give, of unit length: rows that meet in one point leave it no room, and the refinement takes it.
_ROOM = 1e-7
#: Equations of unit length that are independent of the others by less than this depend on them.
_DEPENDENT = 1e-10


@final
class Equilibrated:
    """The same problem in units of its own: unit diagonal of H, rows of unit length.

    With x = D x̃, a cost in units of s and rows in units of 1/R,

        H̃ = D H D / s,   g̃ = D g / s,   C̃ = R C D,   and back:   z = s R z̃,   z_box = s D⁻¹ z̃_box.

    Some solvers take a row for zero, or a pivot for singular, because its unit makes it small.

    Example:
        >>> from wbc.qp import QP
        >>> print(Equilibrated(QP([[1e6]], [2e6], A=[[1e-4]], b=[1e-4])).qp.matrix)
        [[1.]]
    """

    def __init__(self, qp: QP) -> None:
        curvature = qp.H.diagonal()
        self.variables = 1.0 / np.sqrt(np.where(curvature > 0.0, curvature, 1.0))
        rows = qp.matrix * self.variables
        length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
        self.rows = 1.0 / np.where(length > 0.0, length, 1.0)
        g = qp.g * self.variables
        self.cost = float(np.abs(g).max(initial=0.0)) or 1.0
        self.n_eq = qp.n_eq
        self.qp = QP.empty(qp.shape, qp.rows)
        self.qp.H[:] = qp.H * np.outer(self.variables, self.variables) / self.cost
        self.qp.g[:] = g / self.cost
        self.qp.matrix[:] = rows * self.rows[:, None]
        self.qp.lower[:], self.qp.upper[:] = qp.lower * self.rows, qp.upper * self.rows
        self.qp.lb[:], self.qp.ub[:] = qp.lb / self.variables, qp.ub / self.variables

    def undo(self, answer: Answer) -> Answer:
        """The answer to the original problem."""
        force: Vec = self.cost * self.rows
        return Answer(
            answer.status,
            self.variables * answer.x,
            force[: self.n_eq] * answer.y,
            force[self.n_eq :] * answer.z,
            self.cost / self.variables * answer.z_box,
            answer.iterations,
            answer.build_time,
        )


def proximal(qp: QP, solve: Callable[[Shape], Callable[[QP], Answer]], tolerance: float) -> Answer | None:
    """The answer of a solver that needs a strictly convex problem and no equations; None where it finds none.

    The equations are eliminated, x = at + Z w, what is left is equilibrated, and ½ ε |w − c|² is added to the cost with
    c the answer before (proximal point method, Rockafellar 1976). Each answer is refined in the problem's own terms.
    """
    rows = np.concatenate([qp.matrix, np.eye(qp.n)])
    lower, upper = np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub])
    equal = lower == upper
    length = np.linalg.norm(rows[equal], axis=1)
    length[length == 0.0] = 1.0
    Q, R, order = qr((rows[equal] / length[:, None]).T, pivoting=True)
    rank = int((np.abs(R.diagonal()) > _DEPENDENT).sum())
    at = Q[:, :rank] @ solve_triangular(R[:rank, :rank], (upper[equal] / length)[order[:rank]], trans=1)
    Z, rest = Q[:, rank:], rows[~equal]
    if not Z.shape[1]:
        return _in_full(qp, at, np.zeros(len(rest)), ~equal, tolerance)
    shift = rest @ at
    H = Z.T @ qp.H @ Z
    free = QP.empty(Shape(Z.shape[1], 0, len(rest)))
    free.H[:], free.g[:], free.matrix[:] = 0.5 * (H + H.T), Z.T @ (qp.H @ at + qp.g), rest @ Z
    free.lower[:], free.upper[:] = lower[~equal] - shift, upper[~equal] - shift
    scaled = Equilibrated(free)
    scaled.qp.lower[:] -= _ROOM
    scaled.qp.upper[:] += _ROOM
    curvature, slope = scaled.qp.H.copy(), scaled.qp.g.copy()
    epsilon = _PROX * (float(curvature.diagonal().max()) or 1.0)
    scaled.qp.H[:] += epsilon * np.eye(len(curvature))
    centre, ask, best = np.zeros(len(slope)), solve(free.shape), None
    for _ in range(_STEPS):
        scaled.qp.g[:] = slope - epsilon * centre
        found = ask(scaled.qp)
        if not found.status.ok:
            break
        answer = scaled.undo(found)
        best = _in_full(qp, at + Z @ answer.x, answer.z, ~equal, tolerance)
        if best.certificate(qp, tolerance).within(tolerance):
            break
        centre = found.x
    return best


def _in_full(qp: QP, x: Vec, z: Vec, of: NDArray[np.bool_], tolerance: float) -> Answer:
    """The answer with these multipliers of the rows and bounds ``of``, refined where that is better."""
    force, m = np.zeros(len(of)), len(qp.lower)
    force[of] = z
    answer = Answer(Status.SOLVED, x, force[: qp.n_eq], force[qp.n_eq : m], force[m:])
    point = refined(qp, Point(x, answer.y, answer.z, answer.z_box))
    if point is None:
        return answer
    better = Answer(Status.SOLVED, *point)
    return better if better.certificate(qp, tolerance).level < answer.certificate(qp, tolerance).level else answer
