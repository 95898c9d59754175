"""Proofs that a QP has no answer: multipliers that contradict its rows, or a direction of endless descent.

A verdict needs the proof and its check. Two searches, in units that balance the columns, propose multipliers: least
squares of what the rows miss, and nonnegative least squares of the multipliers themselves. The check is
plain arithmetic on the problem's data:

* **infeasible** (Farkas 1902): multipliers s of all rows and bounds R, positive for an upper side and negative for a
  lower one. Every point of the problem has s·R x ≤ β = Σ s·(the side pushed on). With Rᵀs = 0 the left side is 0,
  so β < 0 is a contradiction. All bounds may be missed by what counts as met, which moves β by Σ |sᵢ| tolerance; and
  Rᵀs is zero but for rounding, which moves it by |Rᵀs|·|x|. β must be below −(both), with |x| up to 1e8 times its size.
* **unbounded**: a point that meets the rows, and a direction d that keeps meeting them, with H d = 0 and g·d < 0.
  H d is zero but for rounding of the products in H, which may hide curvature: the cost must fall with all of that, too,
  at every point up to 1e8 away.
"""

from __future__ import annotations

import numpy as np

from wbc.qp.certificate import FLAT
from wbc.qp.conflict import least_violation
from wbc.qp.nonnegative import nonnegative
from wbc.qp.problem import QP
from wbc.types import Mat, Vec

#: How far away a point may be for a proof to hold for it too, beside the size of the bounds.
_FAR = 1e8
_EPS = float(np.finfo(np.float64).eps)
#: Rounding beside the terms of a sum: what is zero of Rᵀs, H d and R d.
_ZERO = 1e-11
#: The slope along a direction, beside the terms it is the sum of, from which the cost falls.
_FALLS = 1e-7
#: A singular value of rows below this share of the largest is rounding.
_RANK = 1e-12
#: How often the columns are scaled, and by how much at most.
_BALANCING, _UNITS = 4, 1e12


def contradiction(qp: QP, tolerance: float) -> Vec | None:
    """Multipliers of [rows, bounds] (m + n,) that prove that no point meets all to within ``tolerance``, or None.

    Example:
        >>> import wbc
        >>> from wbc.qp.proof import contradiction
        >>> qp = wbc.QP([[1.0]], [0.0], C=[[2.0]], cl=[3.0], ub=[1.0])
        >>> contradiction(qp, 1e-6).round(6)
        array([-0.5,  1. ])
    """
    rows, lower, upper, length = _unit_rows(qp, _column_units(qp))
    for search in (_of_least_violation, _of_unit_slope):
        s = search(rows, lower, upper)
        largest = float(np.abs(s).max(initial=0.0))
        if not 0.0 < largest < np.inf:
            continue
        used = np.abs(s) > 1e-9 * largest
        s[~used] = 0.0
        exact = s.copy()
        exact[used] = _without_row_space(rows[used], s[used])
        for found in (s, exact):
            push = found / length
            with np.errstate(all="ignore"):
                push /= np.abs(push).max()
            if contradicts(qp, push, tolerance):
                return push
    return None


def _of_least_violation(rows: Mat, lower: Vec, upper: Vec) -> Vec:
    """What the rows miss (m,) where the sum of its squares is least."""
    return least_violation(rows, lower, upper)[1]


def _of_unit_slope(rows: Mat, lower: Vec, upper: Vec) -> Vec:
    """Multipliers s (m,) with Rᵀs = 0 and β = −1, β in units of the largest side, or the nearest to that.

    Its steps are sets of rows, not points: it needs no point far away where rows all but depend on each other.
    """
    above, below = np.flatnonzero(np.isfinite(upper)), np.flatnonzero(np.isfinite(lower))
    sides = np.concatenate([upper[above], -lower[below]])
    columns = np.vstack([rows[above], -rows[below]]).T
    columns = np.vstack([columns, sides / (float(np.abs(sides).max(initial=0.0)) or 1.0)])
    length = np.linalg.norm(columns, axis=0)
    length[length == 0.0] = 1.0
    wanted = np.zeros(len(columns))
    wanted[-1] = -1.0
    z = nonnegative(columns / length, wanted) / length
    s = np.zeros(len(rows))
    s[above] += z[: len(above)]
    s[below] -= z[len(above) :]
    return s


def _without_row_space(rows: Mat, s: Vec) -> Vec:
    """The part of s (m,) with Rᵀs = 0; rows R (m, n).

    Directions in which R is rounding are left as they are: dividing by them would move s by more than they are worth.
    """
    U, size, _ = np.linalg.svd(rows)
    null: Mat = U[:, int((size > _RANK * size.max(initial=0.0)).sum()) :]
    part: Vec = null @ (null.T @ s)
    return part


def contradicts(qp: QP, s: Vec, tolerance: float) -> bool:
    """Whether the multipliers s (m + n,) prove that no point meets all rows to within ``tolerance``."""
    m = len(qp.lower)
    lower, upper = np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub])
    # What is left of a variable that has a bound against it is taken by this bound.
    left = s[:m] @ qp.matrix + s[m:]
    takes = np.isfinite(np.where(left < 0.0, qp.ub, qp.lb))
    s = s.copy()
    s[m:][takes] -= left[takes]
    used = s != 0.0
    side = np.where(s > 0.0, upper, lower)[used]
    if not used.any() or not np.isfinite(side).all():
        return False
    size = float(np.abs(side).max(initial=0.0)) + 1.0
    terms = np.abs(s[:m]) @ np.abs(qp.matrix) + np.abs(s[m:])
    left = np.abs(s[:m] @ qp.matrix + s[m:])
    if (left > _ZERO * terms).any():
        return False
    beta = float(s[used] @ side)
    room = float(np.abs(s).sum()) * tolerance + 1e-14 * float(np.abs(s[used]) @ np.abs(side))
    return beta < -(room + float(left[~takes].sum()) * _FAR * size)


def descent(qp: QP, tolerance: float) -> Vec | None:
    """A direction d (n,) along which the cost falls for ever from a point that meets all rows, or None.

    Example:
        >>> import wbc
        >>> from wbc.qp.proof import descent
        >>> descent(wbc.QP([[0.0]], [2.0], ub=[5.0]), 1e-6)
        array([-1.])
    """
    diagonal = qp.H.diagonal()
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, axes = np.linalg.eigh(qp.H * np.multiply.outer(unit, unit))
    flat: Mat = axes[:, values <= qp.n * FLAT] * unit[:, None]
    rows, lower, upper, length = _unit_rows(qp)
    size = float(np.linalg.norm(qp.g @ flat))
    if not size > 0.0:
        return None
    # The part of −g in the cone of directions is what is left of it beside the rows' pushes (Moreau 1962).
    along = rows @ flat
    reach = np.linalg.norm(along, axis=1)
    matter = reach > _ZERO * np.linalg.norm(rows, axis=1)
    along, reach = along[matter], reach[matter]
    along /= reach[:, None]
    has_upper, has_lower = np.isfinite(upper[matter]), np.isfinite(lower[matter])
    columns = np.concatenate([along[has_upper], -along[has_lower]]).T
    slope = -(qp.g @ flat) / size
    if columns.shape[1]:
        slope = slope - columns @ nonnegative(columns, slope)
    direction = flat @ slope
    part = np.abs(direction / unit)
    direction[part <= _ZERO * part.max()] = 0.0
    if not direction.any():
        return None
    direction /= np.abs(direction).max()
    met, _ = least_violation(rows, lower, upper)
    violation = np.maximum(rows @ met - upper, lower - rows @ met) * length
    return direction if violation.max(initial=0.0) <= tolerance and falls(qp, direction) else None


def falls(qp: QP, d: Vec) -> bool:
    """Whether the cost falls for ever along d (n,) and every row and bound that holds keeps to hold."""
    along, terms = np.concatenate([qp.matrix @ d, d]), np.concatenate([np.abs(qp.matrix) @ np.abs(d), np.abs(d)])
    lower, upper = np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub])
    zero = _ZERO * terms
    keeps = (np.isinf(upper) | (along <= zero)) & (np.isinf(lower) | (along >= -zero))
    entries = np.abs(qp.H) @ np.abs(d)
    bent = np.abs(qp.H @ d) > _ZERO * entries
    hidden = _FAR * _EPS * float(np.abs(d) @ entries)
    return bool(keeps.all() and not bent.any() and qp.g @ d < -_FALLS * float(np.abs(qp.g) @ np.abs(d)) - hidden)


def _column_units(qp: QP) -> Vec:
    """Units of the variables (n,) in which the largest entry of each column, of rows with largest entry 1, is about 1.

    Columns of very different sizes make rows that are independent look parallel. Which problems have a point does not
    depend on the units; the check uses the problem's own.
    """
    bounded = np.isfinite(qp.lb) | np.isfinite(qp.ub)
    entries = np.abs(np.concatenate([qp.matrix, np.eye(qp.n)[bounded]]))
    units = np.ones(qp.n)
    for _ in range(_BALANCING):
        scaled = entries * units
        largest = scaled.max(axis=1, initial=0.0)
        largest[largest == 0.0] = 1.0
        column = np.sqrt((scaled / largest[:, None]).max(axis=0, initial=0.0))
        column[column == 0.0] = 1.0
        units = np.clip(units / column, 1.0 / _UNITS, _UNITS)
    return units


def _unit_rows(qp: QP, units: Vec | float = 1.0) -> tuple[Mat, Vec, Vec, Vec]:
    """Rows and bounds for variables in these units, with all rows of length 1, and the lengths they had."""
    rows = np.concatenate([qp.matrix, np.eye(qp.n)]) * units
    length = np.linalg.norm(rows, axis=1)
    length[length == 0.0] = 1.0
    lower, upper = np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub])
    return rows / length[:, None], lower / length, upper / length, length
