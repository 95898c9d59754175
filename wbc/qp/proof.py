"""Proofs that a QP has no answer: multipliers that contradict its rows, or a direction of endless descent.

A verdict needs the proof and its check. The core proposes both, in units that balance the columns and in the problem's
own: multipliers where its finite method finds no point of all rows, and as direction the point nearest to −g of the
cone of directions that rows leave open. That point can be short beside −g, and meets the rows only to the rounding of
−g; the point of the cone that is nearest to it meets them to its own. The check is plain arithmetic on the problem's
data:

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

from wbc.qp.answer import Answer
from wbc.qp.certificate import FLAT
from wbc.qp.problem import QP, Shape, moderate
from wbc.qp.relax import relaxed
from wbc.tolerances import CANCELS, NEAR, NOISE, ROUNDING, SAME, SHARP
from wbc.types import Mat, Status, Vec

#: How far away a point may be for a proof to hold for it too, beside the size of the bounds: rounding is felt beyond.
_FAR = 1.0 / SHARP
_EPS = float(np.finfo(np.float64).eps)
#: The slope along a direction, beside the terms it is the sum of, from which the cost falls.
_FALLS = NEAR
#: How often the columns are scaled, and by how much at most.
_BALANCING, _UNITS = 4, 1e5


def contradiction(qp: QP, tolerance: float) -> Vec | None:
    """Multipliers of [rows, bounds] (m + n,) that prove that no point meets all to within ``tolerance``, or None.

    Example:
        >>> import wbc
        >>> from wbc.qp.proof import contradiction
        >>> qp = wbc.QP([[1.0]], [0.0], C=[[2.0]], cl=[3.0], ub=[1.0])
        >>> contradiction(qp, 1e-6).round(6)
        array([-0.5,  1. ])
    """
    length = np.append(np.linalg.norm(qp.matrix, axis=1), np.ones(qp.n))
    length[length == 0.0] = 1.0
    for multipliers in (_of_nearest, _of_least):
        for units in (_column_units(qp), np.ones(qp.n)):
            push = multipliers(qp, units)
            if not push.any():
                continue
            pull = np.abs(push) * length
            push[pull <= SAME * pull.max()] = 0.0
            with np.errstate(all="ignore"):
                push /= np.abs(push).max()
            if contradicts(qp, push, tolerance):
                return push
    return None


def _of_nearest(qp: QP, units: Vec) -> Vec:
    """Multipliers (m + n,) by which the search for the nearest point ends; zero where it finds one."""
    answer = _nearest(qp, units)
    return np.concatenate([answer.y, answer.z, answer.z_box]) * (answer.status is Status.INFEASIBLE)


def _of_least(qp: QP, units: Vec) -> Vec:
    """Multipliers (m + n,) at the point within the bounds that misses the rows least: by how much it misses each.

    Where rows are nearly dependent the nearest point is far beyond all bounds on the way; this one never is.
    """
    answer = _projected(relaxed(_smallest(qp, units), range(len(qp.lower)), share=CANCELS))
    return np.concatenate([answer.y, answer.z, answer.z_box[: qp.n]])


def _nearest(qp: QP, units: Vec) -> Answer:
    """The point of all rows that is nearest to zero in these units (n,), or the multipliers that contradict."""
    return _projected(_smallest(qp, units))


def _smallest(qp: QP, units: Vec) -> QP:
    """The rows of a problem, with ½ ‖x‖² in these units (n,) for a cost."""
    smallest = qp.copy()
    smallest.H[:], smallest.g[:] = np.diag(units**-2.0), 0.0
    return smallest


def _projected(qp: QP) -> Answer:
    """What the core makes of a QP with a curved cost: a step, and another that refines it."""
    from wbc.qp.rows.dense import DenseSteps  # compiled code: loaded where a problem is to be solved

    steps = DenseSteps(qp.shape)
    steps.read(qp)
    answer = steps.step(qp, np.zeros(qp.n))
    return steps.step(qp, answer.x) if answer.status.ok else answer


def contradicts(qp: QP, s: Vec, tolerance: float) -> bool:
    """Whether the multipliers s (m + n,) prove that no point meets all rows to within ``tolerance``."""
    m = len(qp.lower)
    lower, upper = qp.sides
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
    # An entry that is nothing beside its row, in units in which columns are alike, is rounding.
    units = _column_units(qp)
    hidden = NOISE * (np.abs(s[:m]) @ (np.abs(qp.matrix) * units).max(axis=1, initial=0.0)) / units
    if (left > CANCELS * terms + hidden).any():
        return False
    beta = float(s[used] @ side)
    room = float(np.abs(s).sum()) * tolerance + NOISE * float(np.abs(s[used]) @ np.abs(side))
    return beta < -(room + float(left[~takes].sum()) * _FAR * size)


def descent(qp: QP, tolerance: float) -> Vec | None:
    """A direction d (n,) along which the cost falls for ever from a point that meets all rows, or None.

    Example:
        >>> import wbc
        >>> from wbc.qp.proof import descent
        >>> descent(wbc.QP([[0.0]], [2.0], ub=[5.0]), 1e-6)
        array([-1.])
    """
    for units in (_column_units(qp), np.ones(qp.n)):
        direction = _steepest(qp, units)
        if direction.any() and moderate(direction):
            direction /= np.abs(direction).max()
            if falls(qp, direction):
                return direction if _has_point(qp, tolerance) else None
    return None


def _steepest(qp: QP, units: Vec) -> Vec:
    """The direction (n,) of those that rows leave open that is nearest to −g in these units (n,); zero without one."""
    diagonal = qp.H.diagonal()
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, units**-2.0))
    values, axes = np.linalg.eigh(qp.H * np.multiply.outer(unit, unit))
    flat: Mat = axes[:, values <= qp.n * FLAT] * unit[:, None]
    rows = np.concatenate([qp.matrix, np.eye(qp.n)])
    along = rows @ flat
    reach = np.linalg.norm(along, axis=1)
    matter = reach > CANCELS * np.linalg.norm(rows, axis=1)
    cone = QP.empty(Shape(flat.shape[1], 0, int(matter.sum())))
    cone.H[:] = np.eye(flat.shape[1])
    cone.matrix[:] = along[matter] / reach[matter, None]
    cone.sides[:, : len(cone.matrix)] = np.where(np.isfinite(qp.sides[:, matter]), 0.0, [[-np.inf], [np.inf]])
    towards = -(qp.g @ flat)
    for zero in (0.0, ROUNDING):
        size = float(np.linalg.norm(towards))
        if not size > zero:
            return np.zeros(qp.n)
        cone.g[:] = -towards / size
        towards = _projected(cone).x
    direction: Vec = flat @ towards
    part = np.abs(direction / unit)
    direction[part <= CANCELS * part.max()] = 0.0
    return direction


def _has_point(qp: QP, tolerance: float) -> bool:
    """Whether the point that is nearest to zero meets all rows to within ``tolerance``."""
    x = _nearest(qp, _column_units(qp)).x
    values = np.concatenate([qp.matrix @ x, x])
    return bool(np.maximum(values - qp.sides[1], qp.sides[0] - values).max() <= tolerance)


def falls(qp: QP, d: Vec) -> bool:
    """Whether the cost falls for ever along d (n,) and every row and bound that holds keeps to hold."""
    along, terms = np.concatenate([qp.matrix @ d, d]), np.concatenate([np.abs(qp.matrix) @ np.abs(d), np.abs(d)])
    lower, upper = qp.sides
    zero = CANCELS * terms
    keeps = (np.isinf(upper) | (along <= zero)) & (np.isinf(lower) | (along >= -zero))
    entries = np.abs(qp.H) @ np.abs(d)
    bent = np.abs(qp.H @ d) > CANCELS * entries
    hidden = _FAR * _EPS * float(np.abs(d) @ entries)
    return bool(keeps.all() and not bent.any() and qp.g @ d < -_FALLS * float(np.abs(qp.g) @ np.abs(d)) - hidden)


def _column_units(qp: QP) -> Vec:
    """Units of the variables (n,) in which the largest entry of each column, of rows with largest entry 1, is about 1.

    Columns of very different sizes make rows that are independent look parallel. Which problems have a point, and which
    directions rows leave open, does not depend on the units; the check uses the problem's own. Bounds do not count: a
    row with one entry is the same in all units.
    """
    entries = np.abs(qp.matrix)
    units = np.ones(qp.n)
    for _ in range(_BALANCING):
        scaled = entries * units
        largest = scaled.max(axis=1, initial=0.0)
        largest[largest == 0.0] = 1.0
        column = np.sqrt((scaled / largest[:, None]).max(axis=0, initial=0.0))
        column[column == 0.0] = 1.0
        units = np.clip(units / column, 1.0 / _UNITS, _UNITS)
    return units
