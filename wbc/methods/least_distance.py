"""Least distance: how the methods of this package hand their QPs to a solver, in units of their own.

Every cost here is a squared distance, ½ |x − centre|² in the metric H = (R Rᵀ)⁻¹, R = ``root`` (n, n). With

    x = centre + R u,      H → I,      equality rows orthonormal, the others of unit length, u of size one,

all numbers a solver sees are about one, whatever the units, and it needs nothing but a strictly convex cost. Solvers
stop beside the answer, at 1e-9 or at 1e-4. The finite method of :mod:`wbc.methods.farthest` has the last digits, and
with them the multipliers, or multipliers that prove that no point meets all rows. It does not speak for a solver that
is far off: that one has failed.

A task that is out of reach is scaled: the largest scale first, then the least distance. Both come from one strictly
convex problem whose slope along the scale is steep enough (an exact penalty).

Mangasarian: Normal solutions of linear programs, Mathematical Programming Study 22, 1984. Friedlander, Tseng: Exact
regularization of convex programs, SIAM J. Optimization 18(4), 2007.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, final

import numpy as np

from wbc.errors import SolverFailed
from wbc.methods.farthest import shortest
from wbc.qp.problem import QP
from wbc.qp.solver import Solver
from wbc.qp.solvers import by_name
from wbc.tolerances import ROUNDING, SAME, SHARP, TINY
from wbc.types import Mat, Status, Vec

#: A row whose part that is independent of the others is smaller than this (of its length) depends on them.
DEPENDENT = 1e-11
#: An answer of a solver counts as the shortest point where it is this near to it, in sizes of the problem.
CLOSE = 1e-2
#: Limits of a second question are relaxed by this, in sizes of the problem.
GIVE = 1e-10
#: Slopes along the scale that are tried; when one was steep enough, the scale gains no more than this in a step of that
#: length. Steps are long, so that a gain is more than what rounding leaves of the scale, and the last one is short.
SLOPES = (1e1, 1e3, 1e5, 1e7)
LONG, SHORT = 1e5, 1e-3


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


def nearest(
    qp: QP, centre: Vec, root: Mat, solver: str | Solver | None = "pdas", *, terms: Vec | None = None,
    relaxed: bool = False,
) -> Nearest:  # fmt: skip
    """The point of {A x = b, cl ≤ C x ≤ cu, lb ≤ x ≤ ub} nearest to ``centre``: minimise ½ |root⁻¹(x − centre)|².

    ``solver`` ``None``: by the finite method alone. ``terms`` (n_eq,): sizes of the numbers that b is a sum of, where
    they are larger; rows that depend on others contradict them by no less than the rounding of that. ``relaxed``:
    before there is no answer, limits are relaxed a little, so that one point is not an empty set by rounding; a point
    that is then beyond a limit by more than rounding of x is none. A search for the largest scale must not gain by it.

    That is the cost of ``qp``, whose H = (root rootᵀ)⁻¹ and g = −H centre are not looked at: the root is often known
    exactly where H has lost half of its digits.
    """
    matrix = np.concatenate([qp.matrix, np.eye(qp.n)])
    lower, upper = np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub])
    equal = lower == upper
    kept = (np.isfinite(lower) | np.isfinite(upper)) & ~equal
    at, rows = matrix @ centre, matrix @ root
    sums = np.abs(upper)
    sums[: qp.n_eq] = sums[: qp.n_eq] if terms is None else np.maximum(sums[: qp.n_eq], terms)
    magnitude = np.maximum(sums[equal], np.abs(matrix[equal]) @ np.abs(centre))
    equations = _Equations(rows[equal], upper[equal] - at[equal], magnitude)
    length = unit_lengths(rows[kept])
    form = _NormalForm(
        equations.E, equations.e, equations.free,
        rows[kept] / length[:, None], (lower - at)[kept] / length, (upper - at)[kept] / length, equations.condition,
    )  # fmt: skip
    chosen = None if solver is None else by_name(solver)
    answer = form.solve(chosen, relaxed) if equations.consistent else None
    x = centre if answer is None else centre + root @ answer.u
    if relaxed:  # by what is little in the metric, which may be much in x
        beyond = np.maximum(matrix @ x - upper, lower - matrix @ x)
        if (beyond > SHARP * np.linalg.norm(matrix, axis=1) * np.linalg.norm(x)).any():
            answer = None
    if answer is None or not answer.status.ok:
        status = Status.INFEASIBLE if answer is None else answer.status
        x, y, z = (np.full(size, np.nan) for size in (qp.n, qp.n_eq, len(qp.cu)))
        return Nearest(status, x, y, z, x, form.size)
    force = np.zeros(len(matrix))
    force[equal] = equations.multipliers(answer.y)
    force[kept] = answer.z / length
    return Nearest(
        answer.status, x, force[: qp.n_eq], force[qp.n_eq : len(qp.lower)], force[len(qp.lower) :], form.size
    )


def answered(found: Nearest, solver: str | Solver) -> Nearest:
    """``found``, where the solver has an answer or knows that there is none.

    Raises:
        SolverFailed: it ended in another way.
    """
    if found.status.ok or found.status is Status.INFEASIBLE:
        return found
    raise SolverFailed(by_name(solver).name, found.status)


def nearest_at_largest_scale(
    qp: QP,
    direction: Vec,
    centre: Vec,
    root: Mat,
    *,
    size: float,
    solver: str | Solver = "pdas",
    terms: Vec | None = None,
) -> tuple[Nearest, float]:
    """The largest s in [0, 1] with A x = b − (1 − s) direction and all other rows, and :func:`nearest` at that s.

    minimise ½ |root⁻¹(x − centre)|² + ½ size² (s − 1 − slope)² over (x, s): strictly convex, and exact as soon as the
    slope exceeds the multiplier of s ≤ s_max. Whether it does shows in a proximal step from the answer: it stays there.
    Steep slopes are sums of large numbers; a short step from where they end takes away what those leave. The finite
    method takes these steps. The solver is asked at every slope, and has FAILED where it fails at one.
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
    found = nearest(scaled, np.append(centre, 1.0 + SLOPES[0]), wide, solver, terms=terms)
    for slope in SLOPES[1:]:
        if not found.status.ok or found.x[n] >= 1.0 - SAME:
            break
        further = nearest(scaled, found.x + LONG * onwards, wide, None, terms=terms)
        if not further.status.ok or further.x[n] <= found.x[n] + SAME:
            break
        steeper = nearest(scaled, np.append(centre, 1.0 + slope), wide, solver, terms=terms)
        if steeper.status is Status.FAILED:
            found = steeper
            break
        if not steeper.status.ok or steeper.x[n] <= found.x[n] + SAME:
            break  # what the step gained was rounding, and more of it comes with steeper slopes
        exact = nearest(scaled, steeper.x + SHORT * onwards, wide, None, terms=terms)
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
        self._length = unit_lengths(rows)
        left, values, basis = np.linalg.svd(rows / self._length[:, None])
        rank = int((values > DEPENDENT * values.max(initial=0.0)).sum())
        right = right / self._length
        beside = right @ left[:, rank:]
        #: The free directions are known to rounding times this.
        self.condition = float(values[0] / values[rank - 1]) if rank else 1.0
        self.consistent = bool(np.linalg.norm(beside) <= SAME * np.linalg.norm(magnitude / self._length))
        self._from_rows: Mat = left[:, :rank] / values[:rank]
        self.E: Mat = basis[:rank]
        self.e: Vec = right @ self._from_rows
        self.free: Mat = basis[rank:]

    def multipliers(self, y: Vec) -> Vec:
        """Multipliers of the rows given: those of least norm that push like ``y``."""
        result: Vec = (self._from_rows @ y) / self._length
        return result


class _Answer(NamedTuple):
    """u (k,), multipliers y of E and z of F."""

    status: Status
    u: Vec
    y: Vec
    z: Vec


@final
@dataclass(frozen=True)
class _NormalForm:
    """minimise ½ |u|²  subject to  E u = e,  low ≤ F u ≤ high.

    E orthonormal, completed by ``free``; rows of F of length 1. What rows of F are of ``free`` is known to rounding
    times ``condition``.
    """

    E: Mat
    e: Vec
    free: Mat
    F: Mat
    low: Vec
    high: Vec
    condition: float = 1.0

    @property
    def size(self) -> float:
        """How far from the origin u must be, up to √n: the largest violation there, or 1 where that is nothing."""
        outside = max(float(np.linalg.norm(self.e)), float(np.maximum(self.low, -self.high).max(initial=0.0)))
        return outside if outside > TINY else 1.0

    def qp(self, unit: float) -> QP:
        """The problem in u / unit."""
        n = self.F.shape[1]
        return QP(np.eye(n), np.zeros(n), A=self.E, b=self.e / unit, C=self.F, cl=self.low / unit, cu=self.high / unit)

    def solve(self, solver: Solver | None, relaxed: bool) -> _Answer | None:
        """The solver's answer to the last digit; ``None``: it is proven that there is none.

        A solver that is far off is asked once more, without equations, in the size of what is left, and with limits
        that are relaxed a little, so that one point is not an empty set by rounding. Then it FAILED.
        """
        start, rows = self.e @ self.E, self.F @ self.free.T
        length = np.linalg.norm(rows, axis=1)
        settled = length <= min(ROUNDING * self.condition, SHARP)
        rows[settled], length[settled] = 0.0, 1.0
        at, width = self.F @ start, np.where(settled, SAME * self.size, 0.0)
        k = len(self.free)
        rest = _NormalForm(
            np.zeros((0, k)), np.zeros(0), np.eye(k),
            rows / length[:, None], (self.low - at - width) / length, (self.high - at + width) / length,
        )  # fmt: skip
        unit, give = rest.size, GIVE * self.size / length
        loose = replace(rest, low=rest.low - give, high=rest.high + give)
        found = shortest(rest.F, rest.low / unit, rest.high / unit)
        if found is None and relaxed:
            found = shortest(loose.F, loose.low / unit, loose.high / unit)
        if found is None:
            return None
        v, push = unit * found[0], unit * found[1]
        u, z = start + v @ self.free, push / length
        if solver is not None:
            near = CLOSE * (self.size + float(np.linalg.norm(v)))
            if not np.linalg.norm(self.size * solver.solve(self.qp(self.size)).x - u) <= near:
                again = start + unit * solver.solve(loose.qp(unit)).x @ self.free
                if not np.linalg.norm(again - u) <= near:
                    return _Answer(Status.FAILED, u, z, z)
        return _Answer(Status.SOLVED, u, -self.E @ (u + z @ self.F), z)


def unit_lengths(rows: Mat) -> Vec:
    """Lengths of the rows (m,); that of the longest for rows that are zero beside it."""
    length: Vec = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    longest = float(length.max(initial=0.0))
    return np.where(length > ROUNDING * longest, length, longest or 1.0)
