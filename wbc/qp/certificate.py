"""The certificate of optimality, recomputed from the data: no solver's word is taken.

With the Lagrangian's sign convention of :mod:`wbc.types`,

    primal  largest violation of a row or a bound, in that row's own unit
    dual    ‖H x + g + Aᵀy + Cᵀz + z_box‖∞, and any multiplier that pushes on a side that is not there
    gap     Σ |multiplier × distance to the bound it pushes on|

An answer is *certified* (``ok``) when primal ≤ tol, dual ≤ tol (1 + ‖g‖∞) and
gap ≤ tol (1 + |cost|), with tol = 1e-6 unless asked otherwise.
"""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from wbc.qp.problem import QP, moderate
from wbc.types import Vec

TOLERANCE = 1e-6


@final
class Certificate(NamedTuple):
    """Primal residual [unit of the worst row], dual residual and complementarity gap [unit of the cost].

    ``worst_row`` is the index in ``qp.rows`` of the row that is violated most, −1 when none is.
    """

    primal: float
    dual: float
    gap: float
    scale_dual: float = 1.0
    scale_gap: float = 1.0
    worst_row: int = -1

    def within(self, tolerance: float) -> bool:
        """Whether all three residuals are small enough; NaN never is."""
        return (
            self.primal <= tolerance
            and self.dual <= tolerance * self.scale_dual
            and self.gap <= tolerance * self.scale_gap
        )

    @property
    def ok(self) -> bool:
        """Certified at the library's tolerance, 1e-6."""
        return self.within(TOLERANCE)

    def __str__(self) -> str:
        word = "certified" if self.ok else "not certified"
        return f"{word}: primal {self.primal:.1e}, dual {self.dual:.1e}, gap {self.gap:.1e}"


def certificate(qp: QP, x: Vec, y: Vec, z: Vec, z_box: Vec) -> Certificate:
    """Residuals of the KKT conditions at (x, y, z, z_box).

    Shapes: x (n,), y (n_eq,), z (n_in,), z_box (n,). An answer that is not finite has infinite residuals.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.qp.certificate import certificate
        >>> qp = wbc.QP([[1.0]], [0.0], lb=[2.0])
        >>> certificate(qp, np.array([2.0]), np.zeros(0), np.zeros(0), np.array([-2.0])).ok
        True
    """
    everything = np.concatenate([x, y, z, z_box])
    if not moderate(everything):
        return Certificate(np.inf, np.inf, np.inf)
    forces = everything[len(x) : len(everything) - len(x)]
    curvature = qp.H.dot(x)
    stationarity = curvature + qp.g
    stationarity += forces.dot(qp.matrix)
    stationarity += z_box
    primal, worst, stray, gap = _side(qp.matrix.dot(x), qp.lower, qp.upper, forces)
    primal_box, worst_box, stray_box, gap_box = _side(x, qp.lb, qp.ub, z_box)
    if primal_box > primal:
        primal, worst = primal_box, worst_box + len(forces)
    return Certificate(
        primal,
        max(_largest(stationarity), stray, stray_box),
        gap + gap_box,
        1.0 + _largest(qp.g),
        1.0 + abs(float(0.5 * x.dot(curvature) + qp.g.dot(x))),
        worst if primal > 0.0 else -1,
    )


def _side(values: Vec, lower: Vec, upper: Vec, forces: Vec) -> tuple[float, int, float, float]:
    """Largest violation and its index, largest multiplier that has no bound to push on, gap."""
    if not len(values):
        return 0.0, -1, 0.0, 0.0
    over, under = values - upper, lower - values
    violation = np.maximum(over, under)
    worst = int(violation.argmax())
    primal = max(float(violation[worst]), 0.0)
    pushing = forces.nonzero()[0]
    if not len(pushing):
        return primal, worst, 0.0, 0.0
    force = forces[pushing]
    slack = np.where(force > 0.0, over[pushing], under[pushing])
    products = np.abs(force * slack)
    gap = float(products.sum())
    if gap < np.inf:
        return primal, worst, 0.0, gap
    missing = np.isinf(slack)
    return primal, worst, _largest(force[missing]), float(products[~missing].sum())


def _largest(values: Vec) -> float:
    if not len(values):
        return 0.0
    magnitude = np.abs(values)
    return float(magnitude[magnitude.argmax()])
