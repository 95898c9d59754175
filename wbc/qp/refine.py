"""Refine: from an answer to the exact optimum of the rows that its multipliers name as active.

Interior-point and splitting methods stop beside the optimum, and a residual that is small in units of the cost leaves a
light task far from its own. With E the active rows, Z a basis of what they leave free and v the answer,

    E dv = e − E v  (least norm),      Zᵀ H Z p = −Zᵀ (H (v + dv) + g),      v ← v + dv + Z p,

in units of the variables that give H a diagonal of one, or less where it is light, with rows of unit length.
Directions that nothing curves keep the value they have. The multipliers solve Eᵀλ = −(H v + g); where a sign comes out
wrong, or rows depend on each other, the nonnegative ones of least error are taken over all rows that v meets.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import qr, solve_triangular

from wbc.qp.nonnegative import nonnegative
from wbc.qp.problem import QP, moderate
from wbc.types import Index, Mat, Vec

#: Rows of unit length that are independent of the others by less than this depend on them.
_DEPENDENT = 1e-10
#: A curvature below this share of the largest is rounding.
_FLAT = 1e-13
#: What moving a variable by its size costs, beside the dearest, below which its unit is its size.
_LIGHT = 1e-6
#: Steps with the same rows: the second takes away what rounding left of the first.
_STEPS = 3
#: Sets of rows that are tried: a method that stops far beside the optimum names one that is nearly right.
_EXCHANGES = 6
#: Distance, beside the size of v, at which a row counts as met.
_MET = 1e-9


class Point(NamedTuple):
    """An answer with its multipliers."""

    x: Vec
    y: Vec
    z: Vec
    z_box: Vec


def refined(qp: QP, point: Point) -> Point | None:
    """The optimum with the active rows of ``point`` held; None where the point or the step is not finite.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.qp.refine import Point, refined
        >>> qp = wbc.QP([[1.0]], [-3.0], ub=[2.0])
        >>> refined(qp, Point(np.array([1.999]), np.zeros(0), np.zeros(0), np.array([1.1])))
        Point(x=array([2.]), y=array([], dtype=float64), z=array([], dtype=float64), z_box=array([1.]))
    """
    if not moderate(np.concatenate(point)):
        return None
    with np.errstate(all="ignore"):
        try:
            found = _Scaled(qp, point).step()
        except (np.linalg.LinAlgError, ValueError, RuntimeError):  # no factor of a matrix that overflowed
            return None
    return found if found is not None and moderate(np.concatenate(found)) else None


class _Scaled:
    """The problem with H of unit diagonal and all rows, bounds included, of unit length."""

    def __init__(self, qp: QP, point: Point) -> None:
        self.qp = qp
        diagonal = qp.H.diagonal()
        size = 1.0 + np.abs(point.x)
        dear = float((diagonal * size * size).max()) or float(np.abs(qp.g).max()) * float(size.max()) or 1.0
        self.unit = 1.0 / np.sqrt(np.maximum(diagonal, _LIGHT * dear / (size * size)))
        self.H, self.g = qp.H * np.multiply.outer(self.unit, self.unit), qp.g * self.unit
        rows = np.concatenate([qp.matrix, np.eye(qp.n)]) * self.unit
        length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
        self.length = np.where(length > 0.0, length, 1.0)
        self.rows = rows / self.length[:, None]
        self.lower = np.concatenate([qp.lower, qp.lb]) / self.length
        self.upper = np.concatenate([qp.upper, qp.ub]) / self.length
        self.equal = self.lower == self.upper
        self.v = point.x / self.unit
        self.force = np.concatenate([point.y, point.z, point.z_box]) * self.length

    def step(self) -> Point:
        """The optimum of the named rows, after exchanging those that turn out wrong, all at once and a few times."""
        room = np.where(self.force > 0.0, self.upper - self.rows @ self.v, self.rows @ self.v - self.lower)
        side = np.where((self.force != 0.0) & (np.abs(self.force) >= room), np.sign(self.force), 0.0)
        side[self.equal] = 1.0
        for _ in range(_EXCHANGES):
            v, force, independent = self._held(side)
            value, near = self.rows @ v, _MET * max(1.0, float(np.abs(v).max(initial=0.0)))
            beyond = np.where(value > self.upper + near, 1.0, np.where(value < self.lower - near, -1.0, 0.0))
            pulls = ~self.equal & (side * force < 0.0)
            following = np.where(pulls, 0.0, np.where(self.equal | (side != 0.0), side, beyond))
            if (following == side).all():
                break
            side = following
        if not independent or pulls.any():
            force = self._pushes(v, self.H @ v + self.g)
        return self._point(v, force)

    def _held(self, side: Vec) -> tuple[Vec, Vec, bool]:
        """v and the multipliers with these rows held, and whether the rows are independent."""
        active = np.flatnonzero(side)
        target = np.where(side[active] > 0.0, self.upper[active], self.lower[active])
        E = self.rows[active]
        Q, R, order = qr(E.T, pivoting=True)
        rank = int((np.abs(R.diagonal()) > _DEPENDENT).sum())
        chosen, R = order[:rank], R[:rank, :rank]
        span, free = Q[:, :rank], Q[:, rank:]
        values, axes = np.linalg.eigh(free.T @ self.H @ free)
        curved = values > _FLAT * max(1.0, float(values.max(initial=0.0)))
        axes, values = free @ axes[:, curved], values[curved]
        v = self.v
        for _ in range(_STEPS):
            v = v + span @ solve_triangular(R, target[chosen] - E[chosen] @ v, trans=1)
            v = v - axes @ ((axes.T @ (self.H @ v + self.g)) / values)
        force = np.zeros(len(self.lower))
        force[active[chosen]] = solve_triangular(R, -span.T @ (self.H @ v + self.g))
        return v, force, rank == len(active)

    def _pushes(self, v: Vec, gradient: Vec) -> Vec:
        """Multipliers of the right sign, over all rows that v meets, that balance the gradient best."""
        value = self.rows @ v
        near = _MET * max(1.0, float(np.abs(v).max(initial=0.0)))
        both: Index = np.flatnonzero(self.equal)
        low: Index = np.flatnonzero(~self.equal & (value - self.lower <= near))
        high: Index = np.flatnonzero(~self.equal & (self.upper - value <= near))
        columns: Mat = np.concatenate([self.rows[both], -self.rows[both], -self.rows[low], self.rows[high]]).T
        force = np.zeros(len(value))
        if columns.shape[1]:
            push = nonnegative(columns, -gradient)
            for rows, sign in ((both, 1.0), (both, -1.0), (low, -1.0), (high, 1.0)):
                force[rows] += sign * push[: len(rows)]
                push = push[len(rows) :]
        return force

    def _point(self, v: Vec, force: Vec) -> Point:
        """Back in the problem's units; the multiplier of a pinned variable takes what is left of its gradient."""
        qp, m = self.qp, len(self.qp.lower)
        x, force = v * self.unit, force / self.length
        pinned = np.flatnonzero(force[m:])
        x[pinned] = np.where(force[m + pinned] > 0.0, qp.ub[pinned], qp.lb[pinned])
        left = qp.H @ x + qp.g + force[:m] @ qp.matrix
        box = np.zeros(qp.n)
        box[pinned] = -left[pinned]
        return Point(x, force[: qp.n_eq], force[qp.n_eq : m], box)
