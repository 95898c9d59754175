"""The certificate of a level: how far each of its tasks can be from the least that the levels above leave.

In coordinates ỹ = √D y, with W the rows of the level times the roots of their weights and r what is left of them, the
level is the least of ½ ‖W ỹ + …‖² among all points that meet the constraints and keep every row above at its value. Let
N be an orthonormal basis of what keeps the rows above, made anew from the rows themselves, and push the rows that are
at a bound with λ, of the right sign. What is left of the gradient there splits as in :mod:`wbc.qp.certificate`,

    Nᵀ (Wᵀ W r + Rᵀ λ) = (W N)ᵀ ρ + s ,      ‖W (r − r*)‖ ≤ ‖ρ‖ + √( ‖s‖ ‖N Nᵀ (ỹ − ỹ*)‖ )

for any optimum ỹ*. A level has no curvature along s; there the distance to the nearest optimum is taken to be no larger
than the distance of the answer from the reference. The last level has the curvature D: s is measured as it is. A row
that pushed in a level above is held on both sides.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from typing import final

import numpy as np

from wbc.qp.certificate import Certificate
from wbc.qp.lexicographic.rest import Rest, complement
from wbc.qp.lexicographic.stages import StagedProblem
from wbc.qp.nonnegative import nonnegative
from wbc.types import Mat, Vec

#: Unit columns that reach no further than this out of the span of others depend on them.
_DEPENDENT = 1e-8
#: What each product of the gradient loses, as a share of the whole.
_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)
#: A row this near to its bound is at it.
_MET = 1e-7


@final
class Above:
    """The gradients (n_y, m) of the rows of stages that were decided in this tick one by one."""

    def __init__(self, staged: StagedProblem) -> None:
        self.staged, self.columns = staged, list[Mat]()

    def add(self, columns: Mat) -> None:
        """One stage more; its gradients are copied."""
        self.columns.append(columns.copy())


def met(staged: StagedProblem, k: int, residual: Vec) -> Certificate:
    """The certificate of a stage with next to no residual: no stage has less than none."""
    return _found(staged, k, np.abs(residual), float(np.abs(residual).max(initial=0.0)))


def certified(above: Above, k: int, own: Mat, weigh: Vec, *, rest: Rest, primal: float) -> Certificate:
    """The certificate of stage k, solved last in ``rest``; ``own`` (n_y, m) are the gradients of its rows."""
    staged = above.staged
    p, root, last = staged.problem, rest.root, k == len(staged.stages) - 1
    residual = staged.residual(k)
    left = (own @ (weigh * weigh * residual)) * root
    away = (p.x[p.n_u :] - p.centre) / root
    if last:
        left = left + away
    columns = np.hstack([rest.firm, rest.gradients(rest.kept), *(part * root[:, None] for part in above.columns)])
    length = np.sqrt(np.vecdot(columns.T, columns.T))
    basis, _ = complement(columns[:, length > 0.0] / length[length > 0.0], None, _DEPENDENT)
    left = basis.T @ left
    items = np.concatenate([np.arange(p.item(p.range.start), p.item(p.range.stop)), np.arange(p.n_u, p.n)])
    at_upper, at_lower = (p.upper - p.value)[items] <= _MET, (p.value - p.lower)[items] <= _MET
    upper, lower = np.flatnonzero(at_upper), np.flatnonzero(at_lower)
    if len(left):
        left = left + _pushed(basis.T @ np.hstack([rest.gradients(upper), -rest.gradients(lower)]), left)
    mine = basis.T @ (own * root[:, None] * weigh)
    size = float(np.linalg.norm(own * root[:, None] * weigh))
    rho, slope = 0.0, float(np.linalg.norm(left))
    if mine.size:
        U, reach, _ = np.linalg.svd(mine, full_matrices=False)
        moved = reach > _DEPENDENT * size
        along = U.T[moved] @ left
        rho = float(np.linalg.norm(along / reach[moved]))
        slope = float(np.linalg.norm(left - along @ U.T[moved]))
    slope = max(slope - _ROUNDING * len(root) * size * float(np.linalg.norm(weigh * residual)), 0.0)
    far = 1.0 if last else 1.0 + float(np.linalg.norm(basis.T @ away))
    off = rho + (slope if last else sqrt(slope * far))
    with np.errstate(divide="ignore"):
        reach = np.where(weigh > 0.0, off / weigh, 0.0)
    return _found(staged, k, reach, max(primal, 0.0))


def _pushed(gradients: Mat, left: Vec) -> Vec:
    """What rows at a bound can take of a gradient by pushing."""
    length = np.sqrt(np.vecdot(gradients.T, gradients.T))
    columns = gradients[:, length > 0.0] / length[length > 0.0]
    if not columns.size:
        return np.zeros(len(left))
    found: Vec = columns @ nonnegative(columns, -left)
    return found


def _found(staged: StagedProblem, k: int, reach: Vec, primal: float) -> Certificate:
    rows = staged.rows[k]
    asked = np.abs(staged.problem.G[rows, staged.problem.n])
    bounds: Mapping[str, float] = {
        name: float(reach[place].max(initial=0.0)) for name, place in staged.parts[k].items()
    }
    return Certificate(primal, 0.0, 0.0, distance=float((reach / (1.0 + asked)).max(initial=0.0)), bounds=bounds)
