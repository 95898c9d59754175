"""Least distance: the form in which the methods of this package hand their QPs to a solver.

Every cost here is a squared distance, ½ |x − centre|² in the metric H = (R Rᵀ)⁻¹, R = ``root`` (n, n). With
x = centre + R u the cost is ½ |u|². Equations, made independent, are E u = e with E orthonormal, so that

    u = Eᵀ e + N v,      N orthonormal, E N = 0:      minimise ½ |v|²   subject to   low ≤ F v ≤ high,

rows of F no longer than one, v measured by the size of the answer. All numbers a solver sees are about one, whatever
the units, and it needs nothing but a strictly convex cost. Its answer counts where it is certified
(:mod:`wbc.qp.certificate`); else the solver has failed. Whether there is a point at all says the finite method of
:mod:`wbc.methods.farthest`, which proves it with multipliers, and which also is the closed form of these problems.

Of the points that are farthest along a direction, the nearest is one strictly convex problem, too, whose slope along
the direction is steep enough (an exact penalty). The finite method says how steep that is.

Mangasarian: Normal solutions of linear programs, Mathematical Programming Study 22, 1984. Friedlander, Tseng: Exact
regularization of convex programs, SIAM J. Optimization 18(4), 2007.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.errors import SolverFailed
from wbc.methods.farthest import farthest
from wbc.methods.shared import factors, largest_known, unit_lengths
from wbc.qp.problem import QP
from wbc.qp.solver import Solver
from wbc.qp.solvers import by_name
from wbc.tolerances import NEAR, NOISE, ROUNDING, SAME, SHARP, TINY
from wbc.types import Mat, Vec

#: Numbers of which a share of 1e-8 is no divisor count as zero.
NOTHING = TINY / SHARP


@final
@dataclass(frozen=True)
class Nearest:
    """Answer of :func:`nearest` in the units of the problem: x (n,) and the multipliers y, z, z_box.

    It minimises ½ |root⁻¹(x − centre)|² − ``push`` along · x.
    """

    x: Vec
    y: Vec
    z: Vec
    z_box: Vec
    push: float


def nearest(
    qp: QP, centre: Vec, root: Mat, solver: str | Solver | None = "pdas", *, terms: Vec | None = None,
    along: Vec | None = None,
) -> Nearest | None:  # fmt: skip
    """The point of {A x = b, cl ≤ C x ≤ cu, lb ≤ x ≤ ub} nearest to ``centre``: minimise ½ |root⁻¹(x − centre)|².

    That is the cost of ``qp``, whose H = (root rootᵀ)⁻¹ and g = −H centre are not looked at: the root is often known
    exactly where H has lost half of its digits.

    Args:
        qp: the rows.
        centre: (n,).
        root: (n, n).
        solver: whose answer it is; ``None``: that of the finite method.
        terms: sizes (n_eq,) of the numbers that b is a sum of, where they are larger; rows that depend on others
            contradict them by no less than the rounding of that.
        along: a direction (n,): of the points that are farthest along it, the nearest.

    Returns:
        None where multipliers prove that no point meets all rows.

    Raises:
        SolverFailed: there is a point, and the solver has no certified answer.
    """
    matrix = np.concatenate([qp.matrix, np.eye(qp.n)])
    lower, upper = qp.sides
    equal = lower == upper
    kept = (np.isfinite(lower) | np.isfinite(upper)) & ~equal
    at, rows = matrix @ centre, matrix @ root
    sums = np.abs(upper)
    sums[: qp.n_eq] = sums[: qp.n_eq] if terms is None else np.maximum(sums[: qp.n_eq], terms)
    equations, right = factors(rows[equal], of_unit_length=True), upper[equal] - at[equal]
    if not equations.reaches(right, np.maximum(sums[equal], np.abs(matrix[equal]) @ np.abs(centre))):
        return None
    first, free, length = equations.inverse(right), equations.null, unit_lengths(rows[kept])
    bounded = rows[kept] / length[:, None]
    start, low, high = at[kept] / length + bounded @ first, lower[kept] / length, upper[kept] / length
    # u is measured by how far it is from the origin at least, up to √n; squares of all that is must remain numbers.
    outside = max(np.abs(first).max(initial=0.0), (low - start).max(initial=0.0), (start - high).max(initial=0.0))
    least = TINY**0.5 * float(np.abs(start).max(initial=0.0))
    unit = max(float(outside), least) if outside > NOTHING else 1.0
    first, start, low, high = first / unit, start / unit, low / unit, high / unit
    F = bounded @ free.T
    # What the equations decide nothing moves; the free directions are known to rounding times their condition.
    F[np.linalg.norm(F, axis=1) <= min(ROUNDING * equations.condition, SHARP)] = 0.0
    pull = np.zeros(qp.n) if along is None else root.T @ along
    rate = float(np.linalg.norm(free @ pull))
    if rate <= ROUNDING * np.linalg.norm(pull):  # the equations leave nothing along the direction
        pull, rate = np.zeros(qp.n), 1.0
    pull = pull / rate
    known = float(np.linalg.norm(first) + ((np.abs(matrix[kept]) @ np.abs(centre)) / length).max(initial=0.0) / unit)
    found = farthest(start, F, low, high, free @ pull, terms=known)
    if found is None:
        return None
    u = unit * (first + found.u @ free)
    x, limited = centre + root @ u, matrix[kept].any(axis=0)
    terms_of_x = (np.abs(centre) + np.abs(root) @ np.abs(u))[limited].max(initial=0.0)
    # Limits with a small contradiction in the metric are both violated a little; in x that may be much, beside their
    # own numbers and those that the limited entries of x are sums of, or beside the rounding of all that is summed,
    # where limits and entries are zero.
    beyond, little = np.maximum(matrix @ x - upper, lower - matrix @ x)[kept], np.linalg.norm(matrix[kept], axis=1)
    rounding = min(NOISE * equations.condition, SAME) * unit * length * (known + np.linalg.norm(found.u))
    little = np.maximum(np.maximum(terms_of_x * little, rounding / SHARP), TINY)
    own = largest_known(lower, upper)[kept]
    if (beyond > np.maximum(SHARP * np.maximum(little, own), TINY)).any():
        return None
    push = 2.0 * max(found.push, float(np.linalg.norm(found.u))) if (free @ pull).any() else 0.0
    v, multipliers = found.u, found.multipliers(push)
    if solver is not None and len(v):
        size = float(np.linalg.norm(v)) or 1.0
        # A limit that is met to 1e-8 in the metric is met to 1e-7 in x, however far apart weights are.
        finer = np.where(little > NOTHING, np.maximum(1.0, SHARP / NEAR * (size * unit) * length / little), 1.0)
        # What the finite method takes for met by rounding is met, by the solver too.
        cl, cu = np.minimum(found.lower - start, F @ v), np.maximum(found.upper - start, F @ v)
        # Sides with but rounding between them, or of a row that nothing moves, leave interior points no inside.
        thin = cu - cl <= ROUNDING * (size + np.minimum(np.abs(cl), np.abs(cu)))
        cl, cu = (finer * np.where(thin, 0.5 * (cl + cu), side) / size for side in (cl, cu))
        # No row is longer than the answer: limits beyond are none, and methods of the interior lose their way to them.
        reach = 4.0 * finer * (float(np.linalg.norm(v)) / size)
        cl, cu = np.where(cl < -reach, -np.inf, cl), np.where(cu > reach, np.inf, cu)
        asked = F.any(axis=1) & (np.isfinite(cl) | np.isfinite(cu))
        C = (F * finer[:, None])[asked]
        reduced = QP(np.eye(len(v)), -(push / size) * (free @ pull), C=C, cl=cl[asked], cu=cu[asked])
        answer = by_name(solver).at(SHARP).open(reduced.shape).solve(reduced)
        if not answer.status.ok:
            raise SolverFailed(by_name(solver).name, answer.status)
        v, multipliers = size * answer.x, np.zeros(len(F))
        multipliers[asked] = size * finer[asked] * answer.z
    u, pushed = first + v @ free, np.zeros(len(matrix))
    pushed[kept] = multipliers / length
    pushed[equal] = equations.multipliers(push * pull - u - pushed @ rows)
    m, pushed = len(qp.lower), unit * pushed
    return Nearest(centre + unit * (root @ u), pushed[: qp.n_eq], pushed[qp.n_eq : m], pushed[m:], unit * push / rate)
