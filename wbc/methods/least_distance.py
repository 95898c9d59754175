"""Least distance: how the methods of this package hand their QPs to a solver, in units of their own.

Every cost here is a squared distance, ½ |x − centre|² in the metric H = (R Rᵀ)⁻¹, R = ``root`` (n, n). With

    x = centre + size · R u,      H → I,      rows of unit length, equality rows orthonormal,

all numbers a solver sees are about one, whatever the units, and it needs nothing but a strictly convex cost: an
accuracy of 1e-9 means nine digits, also of a solver that stops at absolute residuals. Interior-point and splitting
methods stop beside the answer; the rows they found active are solved once more as equations, and the certificate says
whether that is better. Where it says that neither will do, the equality rows are eliminated and what is left is posed
again in its own size, which also shows how far rows that nearly agree are from each other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from wbc.qp.certificate import certificate
from wbc.methods.polish import polished
from wbc.qp.problem import QP
from wbc.qp.solver import Solution, Solver
from wbc.qp.solvers import by_name
from wbc.types import Mat, Status, Vec

#: A row whose part that is independent of the others is smaller than this (of its length) depends on them.
DEPENDENT = 1e-11
#: Rows that depend on others contradict them where their right sides differ by more than this (of their size).
CONSISTENT = 1e-9
#: The certificate at which no second look is needed, in the units of the normal form.
ACCURATE = 1e-10


@final
@dataclass(frozen=True)
class Nearest:
    """Answer of :func:`nearest` in the units of the problem: x (n,), multipliers y, z, z_box; NaN without one.

    ``size`` is the distance from the centre in the metric that x must at least have, up to a factor of √n.
    """

    status: Status
    x: Vec
    y: Vec
    z: Vec
    z_box: Vec
    size: float


@final
class EqualityRows:
    """Independent equations E u = e that say the same as the rows given, which may depend on each other.

    E = Vᵀ of the singular value decomposition of the rows at unit length: orthonormal. ``consistent`` says whether
    the rows that were dropped agree with those that are kept, to rounding of numbers of this ``magnitude``.
    """

    def __init__(self, rows: Mat, right: Vec, magnitude: Vec) -> None:
        self._length = _lengths(rows)
        left, values, basis = np.linalg.svd(rows / self._length[:, None])
        rank = int((values > DEPENDENT * values.max(initial=0.0)).sum())
        right = right / self._length
        beside = left[:, rank:].T @ right
        self.consistent = bool(np.linalg.norm(beside) <= CONSISTENT * np.linalg.norm(magnitude / self._length))
        self.matrix: Mat = basis[:rank]
        self.free: Mat = basis[rank:]
        self._from_rows: Mat = left[:, :rank] / values[:rank]
        self.right: Vec = right @ self._from_rows

    def multipliers(self, y: Vec) -> Vec:
        """Multipliers of the rows given: those of least norm that push like ``y``."""
        result: Vec = (self._from_rows @ y) / self._length
        return result


def nearest(qp: QP, centre: Vec, root: Mat, solver: str | Solver = "pdas") -> Nearest:
    """The point of {A x = b, cl ≤ C x ≤ cu, lb ≤ x ≤ ub} that is nearest to ``centre``: minimise ½ |root⁻¹(x − centre)|².

    That is the cost of ``qp``, whose H = (root rootᵀ)⁻¹ and g = −H centre are not looked at: the root is often known
    exactly where H has lost half of its digits.
    """
    bounded = (np.isfinite(qp.lb) | np.isfinite(qp.ub)).nonzero()[0]
    reach = np.abs(qp.A) @ np.abs(centre)
    equal = EqualityRows(qp.A @ root, qp.b - qp.A @ centre, np.maximum(np.abs(qp.b), reach))
    rows = np.concatenate([qp.C @ root, root[bounded]])
    length = _lengths(rows)
    start = np.concatenate([qp.C @ centre, centre[bounded]])
    low = (np.concatenate([qp.cl, qp.lb[bounded]]) - start) / length
    high = (np.concatenate([qp.cu, qp.ub[bounded]]) - start) / length
    form = _NormalForm(equal.matrix, equal.right, rows / length[:, None], low, high)
    size = form.size
    if not equal.consistent:
        return _none(qp, Status.INFEASIBLE, size)
    answer = form.solve(by_name(solver), equal.free)
    if not answer.status.ok:
        return _none(qp, answer.status, size)
    force = answer.z / length
    z_box = np.zeros(qp.n)
    z_box[bounded] = force[len(qp.cu) :]
    return Nearest(
        Status.SOLVED, centre + root @ answer.x, equal.multipliers(answer.y), force[: len(qp.cu)], z_box, size
    )


@final
@dataclass(frozen=True)
class _NormalForm:
    """minimise ½ |u|²  subject to  E u = e,  low ≤ F u ≤ high;  E orthonormal, rows of F of unit length."""

    E: Mat
    e: Vec
    F: Mat
    low: Vec
    high: Vec

    @property
    def size(self) -> float:
        """How far from the origin u must at least be, up to √n: largest violation there; 1 where it is zero."""
        outside = float(np.maximum(self.low, -self.high).max(initial=0.0))
        return max(float(np.linalg.norm(self.e)), outside) or 1.0

    def solve(self, solver: Solver, free: Mat) -> Solution:
        """The answer, at a second look where the first does not satisfy. ``free``: basis of {u: E u = 0} by rows."""
        first = self._attempt(solver)
        if first.status.ok and first.certificate.within(ACCURATE):
            return first
        start = self.e @ self.E
        rows = self.F @ free.T
        length = _lengths(rows)
        at = self.F @ start
        none = np.zeros((0, len(free)))
        again = _NormalForm(
            none, np.zeros(0), rows / length[:, None], (self.low - at) / length, (self.high - at) / length
        )
        second = again._attempt(solver) if len(free) else again._without_variables()
        if not second.status.ok:
            return second
        u, z = start + second.x @ free, second.z / length
        return replace(second, x=u, y=-self.E @ (u + z @ self.F), z=z)

    def _attempt(self, solver: Solver) -> Solution:
        size = self.size
        qp = QP(
            np.eye(self.F.shape[1]), np.zeros(self.F.shape[1]), A=self.E, b=self.e / size,
            C=self.F, cl=self.low / size, cu=self.high / size,
        )  # fmt: skip
        answer = solver.solve(qp)
        if not answer.status.ok:
            return answer
        answer = _polished(qp, answer)
        return replace(answer, x=size * answer.x, y=size * answer.y, z=size * answer.z)

    def _without_variables(self) -> Solution:
        raise AssertionError


def _polished(qp: QP, answer: Solution) -> Solution:
    """The rows that push, solved as equations, where the certificate says that this is better."""
    if answer.certificate.within(1e-13):
        return answer
    values = qp.C @ answer.x
    room = np.where(answer.z > 0.0, qp.cu - values, values - qp.cl)
    active = np.abs(answer.z) > np.abs(room)
    rows = np.concatenate([qp.A, qp.C[active]])
    right = np.concatenate([qp.b, np.where(answer.z > 0.0, qp.cu, qp.cl)[active]])
    inverse = np.linalg.pinv(rows, rcond=DEPENDENT)
    x = inverse @ right
    force = -x @ inverse
    z = np.zeros(len(qp.cu))
    z[active] = force[qp.n_eq :]
    y = force[: qp.n_eq]
    proof = certificate(qp, x, y, z, answer.z_box * 0)
    old = answer.certificate
    if max(proof.primal, proof.dual, proof.gap) < max(old.primal, old.dual, old.gap):
        return replace(answer, x=x, y=y, z=z, certificate=proof)
    return answer


def _lengths(rows: Mat) -> Vec:
    """Lengths of the rows (m,), 1 for rows of zeros."""
    length: Vec = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    return np.where(length > 0.0, length, 1.0)


def _none(qp: QP, status: Status, size: float) -> Nearest:
    n, n_eq, n_in = qp.shape
    return Nearest(status, *(np.full(shape, np.nan) for shape in (n, n_eq, n_in, n)), size)
