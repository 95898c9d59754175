"""Least distance: how the methods of this package hand their QPs to a solver, in units of their own.

Every cost here is a squared distance, ½ |x − centre|² in the metric H = (R Rᵀ)⁻¹, R = ``root`` (n, n). With

    x = centre + R u,      H → I,      equality rows orthonormal, the others of unit length, u of size one,

all numbers a solver sees are about one, whatever the units, and it needs nothing but a strictly convex cost: an
accuracy of 1e-9 means nine digits, also of a solver that stops at absolute residuals. Interior-point and splitting
methods stop beside the answer; the rows they found active are solved once more as equations, and the certificate says
whether that is better. Where neither will do, the equations are eliminated and what is left is posed again in its own
size, which also shows how far from each other rows are that nearly agree. That no point meets all rows is no solver's
word: it is proven (:func:`wbc.qp.conflict.least_violation`), and where there is no proof there is a point.

A task that is out of reach is scaled: the largest scale first, then the least distance. Both come from one strictly
convex problem whose slope along the scale is steep enough (an exact penalty).

Mangasarian: Normal solutions of linear programs, Mathematical Programming Study 22, 1984. Friedlander, Tseng: Exact
regularization of convex programs, SIAM J. Optimization 18(4), 2007.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from wbc.methods.least_norm import least_norm
from wbc.qp.certificate import Certificate
from wbc.qp.conflict import least_violation
from wbc.qp.problem import QP
from wbc.qp.solver import Solution, Solver
from wbc.qp.solvers import by_name
from wbc.types import Mat, Status, Vec

#: A row whose part that is independent of the others is smaller than this (of its length) depends on them.
DEPENDENT = 1e-11
#: Rows that depend on others contradict them where their right sides differ by more than this (of their size).
CONSISTENT = 1e-9
#: The certificate, in the units of the normal form, at which no second look is needed.
ACCURATE = 1e-10
#: Rows of the second look give way by this (of the size of the first), so that rounding does not contradict itself.
ROUNDING = 1e-14
#: A row that the equations leave less freedom than this (of its length) is settled by them.
FIXED = 1e-8
#: Slopes along the scale that are tried; when one was steep enough, the scale gains no more than this in a step of that
#: length. Steps are long, so that a gain is more than what rounding leaves of the scale, and the last one is short.
SLOPES = (1e1, 1e3, 1e5, 1e7)
SETTLED, LONG, SHORT = 1e-9, 1e5, 1e-3


@final
@dataclass(frozen=True)
class Nearest:
    """Answer of :func:`nearest` in the units of the problem: x (n,), multipliers y, z, z_box; NaN without one.

    ``size``: how far from the centre x must at least be, measured in the metric, up to a factor of √n.
    """

    status: Status
    x: Vec
    y: Vec
    z: Vec
    z_box: Vec
    size: float


def nearest(qp: QP, centre: Vec, root: Mat, solver: str | Solver = "pdas") -> Nearest:
    """The point of {A x = b, cl ≤ C x ≤ cu, lb ≤ x ≤ ub} nearest to ``centre``: minimise ½ |root⁻¹(x − centre)|².

    That is the cost of ``qp``, whose H = (root rootᵀ)⁻¹ and g = −H centre are not looked at: the root is often known
    exactly where H has lost half of its digits.
    """
    matrix = np.concatenate([qp.matrix, np.eye(qp.n)])
    lower, upper = np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub])
    equal = lower == upper
    kept = (np.isfinite(lower) | np.isfinite(upper)) & ~equal
    at, rows = matrix @ centre, matrix @ root
    magnitude = np.maximum(np.abs(upper[equal]), np.abs(matrix[equal]) @ np.abs(centre))
    equations = _Equations(rows[equal], upper[equal] - at[equal], magnitude)
    length = _lengths(rows[kept])
    form = _NormalForm(
        equations.E, equations.e, equations.free,
        rows[kept] / length[:, None], (lower - at)[kept] / length, (upper - at)[kept] / length,
    )  # fmt: skip
    answer = form.solve(by_name(solver)) if equations.consistent else None
    if answer is None or not answer.status.ok:
        status = Status.INFEASIBLE if answer is None else answer.status
        x, y, z = (np.full(size, np.nan) for size in (qp.n, qp.n_eq, len(qp.cu)))
        return Nearest(status, x, y, z, x, form.size)
    force = np.zeros(len(matrix))
    force[equal] = equations.multipliers(answer.y)
    force[kept] = answer.z / length
    x = centre + root @ answer.x
    return Nearest(
        answer.status, x, force[: qp.n_eq], force[qp.n_eq : len(qp.lower)], force[len(qp.lower) :], form.size
    )


def nearest_at_largest_scale(
    qp: QP, direction: Vec, centre: Vec, root: Mat, *, size: float, solver: str | Solver = "pdas"
) -> tuple[Nearest, float]:
    """The largest s in [0, 1] with A x = b − (1 − s) direction and all other rows, and :func:`nearest` at that s.

    minimise ½ |root⁻¹(x − centre)|² + ½ size² (s − 1 − slope)² over (x, s): strictly convex, and exact as soon as the
    slope exceeds the multiplier of s ≤ s_max. Whether it does shows in a proximal step from the answer: it stays there.
    Steep slopes are sums of large numbers; a short step from where they end takes away what those leave.
    """
    n, n_eq, _ = qp.shape
    padded = np.zeros((len(qp.matrix), n + 1))
    padded[:, :n] = qp.matrix
    padded[:n_eq, n] = -direction
    scaled = QP(
        np.eye(n + 1), np.zeros(n + 1), A=padded[:n_eq], b=qp.b - direction, C=padded[n_eq:], cl=qp.cl, cu=qp.cu,
        lb=np.append(qp.lb, 0.0), ub=np.append(qp.ub, 1.0),
    )  # fmt: skip
    wide = np.zeros((n + 1, n + 1))
    wide[:n, :n] = root
    wide[n, n] = 1.0 / size
    onwards = np.append(np.zeros(n), 1.0)
    found = nearest(scaled, np.append(centre, 1.0 + SLOPES[0]), wide, solver)
    for slope in SLOPES[1:]:
        if not found.status.ok or found.x[n] >= 1.0 - SETTLED:
            break
        further = nearest(scaled, found.x + LONG * onwards, wide, solver)
        if not further.status.ok or further.x[n] <= found.x[n] + SETTLED:
            break
        steeper = nearest(scaled, np.append(centre, 1.0 + slope), wide, solver)
        if not steeper.status.ok or steeper.x[n] <= found.x[n] + SETTLED:
            break  # what the step gained was rounding, and more of it comes with steeper slopes
        exact = nearest(scaled, steeper.x + SHORT * onwards, wide, solver)
        found = replace(steeper, x=exact.x) if exact.status.ok else steeper
    return replace(found, x=found.x[:n], z_box=found.z_box[:n]), float(np.clip(found.x[n], 0.0, 1.0))


@final
class _Equations:
    """Independent equations E u = e that say the same as the rows given, which may depend on each other.

    E = Vᵀ of the singular value decomposition of the rows at unit length: orthonormal, and ``free`` spans what it
    leaves. ``consistent`` says whether the rows that depend on others agree with them, to the rounding of numbers of
    this ``magnitude``.
    """

    def __init__(self, rows: Mat, right: Vec, magnitude: Vec) -> None:
        self._length = _lengths(rows)
        left, values, basis = np.linalg.svd(rows / self._length[:, None])
        rank = int((values > DEPENDENT * values.max(initial=0.0)).sum())
        right = right / self._length
        beside = right @ left[:, rank:]
        self.consistent = bool(np.linalg.norm(beside) <= CONSISTENT * np.linalg.norm(magnitude / self._length))
        self._from_rows: Mat = left[:, :rank] / values[:rank]
        self.E: Mat = basis[:rank]
        self.e: Vec = right @ self._from_rows
        self.free: Mat = basis[rank:]

    def multipliers(self, y: Vec) -> Vec:
        """Multipliers of the rows given: those of least norm that push like ``y``."""
        result: Vec = (self._from_rows @ y) / self._length
        return result


@final
@dataclass(frozen=True)
class _NormalForm:
    """minimise ½ |u|²  subject to  E u = e,  low ≤ F u ≤ high.

    E orthonormal, completed by ``free``; rows of F of length 1.
    """

    E: Mat
    e: Vec
    free: Mat
    F: Mat
    low: Vec
    high: Vec

    @property
    def size(self) -> float:
        """How far from the origin u must at least be, up to √n: the largest violation there; 1 where there is none."""
        outside = float(np.maximum(self.low, -self.high).max(initial=0.0))
        return max(float(np.linalg.norm(self.e)), outside) or 1.0

    def qp(self, unit: float) -> QP:
        """The problem in u / unit."""
        n = self.F.shape[1]
        return QP(np.eye(n), np.zeros(n), A=self.E, b=self.e / unit, C=self.F, cl=self.low / unit, cu=self.high / unit)

    def solve(self, solver: Solver) -> Solution:
        """The answer of the first look if its certificate is good, or of the second; INFEASIBLE where it is proven."""
        first = self._look(solver)
        if first.status.ok and first.certificate.within(ACCURATE):
            return first
        start, rows = self.e @ self.E, self.F @ self.free.T
        length = np.linalg.norm(rows, axis=1)
        settled = length <= FIXED
        rows[settled], length[settled] = 0.0, 1.0
        at, width = self.F @ start, np.where(settled, CONSISTENT, ROUNDING) * self.size
        low, high = (self.low - at - width) / length, (self.high - at + width) / length
        n = len(self.free)
        rest = _NormalForm(np.zeros((0, n)), np.zeros(0), np.eye(n), rows / length[:, None], low, high)
        if rest.violation > CONSISTENT * self.size:
            return replace(first, status=Status.INFEASIBLE)
        second = rest._at_rest() or rest._look(solver, feasible=True)
        if not second.status.ok:
            return first if first.status.ok else replace(second, status=Status.FAILED)
        u, z = start + second.x @ self.free, second.z / length
        return replace(second, x=u, y=-self.E @ (u + z @ self.F), z=z)

    @property
    def violation(self) -> float:
        """By how much rows must at least give way: more than rounding, and a plane is between them, whoever looks."""
        return float(np.abs(least_violation(self.F, self.low, self.high)[1]).max(initial=0.0))

    def _look(self, solver: Solver, *, feasible: bool = False) -> Solution:
        size = self.size
        answer = least_norm(self.qp(size), solver, feasible=feasible)
        return replace(answer, x=size * answer.x, y=size * answer.y, z=size * answer.z)

    def _at_rest(self) -> Solution | None:
        """u = 0, where no row is against it or there is nothing to move."""
        n, m = len(self.free), len(self.low)
        if n and ((self.low > 0.0).any() or (self.high < 0.0).any()):
            return None
        return Solution(Status.SOLVED, np.zeros(n), np.zeros(0), np.zeros(m), np.zeros(n), Certificate(0.0, 0.0, 0.0))


def _lengths(rows: Mat) -> Vec:
    """Lengths of the rows (m,), 1 for rows of zeros."""
    length: Vec = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    return np.where(length > 0.0, length, 1.0)
