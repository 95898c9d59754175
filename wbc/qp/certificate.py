"""The certificate of optimality, recomputed from the data: no solver's word is taken.

With the Lagrangian's sign convention of :mod:`wbc.types`,

    primal  largest violation of a row or a bound, in that row's own unit
    dual    ‖H x + g + Aᵀy + Cᵀz + z_box‖∞, and any multiplier of the wrong sign
    gap     Σ |multiplier × distance to the bound it pushes on|

An answer is *certified* (``ok``) when primal ≤ tol, dual ≤ tol (1 + ‖g‖∞) and
gap ≤ tol (1 + |cost|), with tol = 1e-6 unless asked otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.qp.problem import QP
from wbc.types import Vec

TOLERANCE = 1e-6


@final
@dataclass(frozen=True, slots=True)
class Certificate:
    """Primal residual [unit of the worst row], dual residual and complementarity gap [unit of the cost]."""

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

    Shapes: x (n,), y (n_eq,), z (n_in,), z_box (n,). A non-finite answer has infinite residuals.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.qp.certificate import certificate
        >>> qp = wbc.QP([[1.0]], [0.0], lb=[2.0])
        >>> certificate(qp, np.array([2.0]), np.zeros(0), np.zeros(0), np.array([-2.0])).ok
        True
    """
    multipliers = np.concatenate([y, z, z_box])
    if not (np.isfinite(x).all() and np.isfinite(multipliers).all()):
        return Certificate(np.inf, np.inf, np.inf)
    values = np.concatenate([qp.matrix @ x, x])
    lower = np.concatenate([qp.lower, qp.lb])
    upper = np.concatenate([qp.upper, qp.ub])
    violation = np.maximum(np.maximum(values - upper, lower - values), 0.0)
    worst = int(violation.argmax()) if violation.size else -1
    stationarity = qp.H @ x + qp.g + qp.A.T @ y + qp.C.T @ z + z_box
    # A multiplier with no bound on its side pushes on nothing: that is a dual residual.
    pushed = np.where(multipliers > 0, upper, lower)
    missing = ~np.isfinite(pushed) & (multipliers != 0)
    dual = max(_largest(stationarity), _largest(multipliers[missing]))
    slack = np.where(missing | (multipliers == 0), 0.0, np.abs(np.where(np.isfinite(pushed), pushed, 0.0) - values))
    return Certificate(
        primal=float(violation[worst]) if worst >= 0 else 0.0,
        dual=dual,
        gap=float(np.abs(multipliers * slack).sum()),
        scale_dual=1.0 + _largest(qp.g),
        scale_gap=1.0 + abs(qp.cost(x)),
        worst_row=worst,
    )


def _largest(values: Vec) -> float:
    return float(np.abs(values).max()) if values.size else 0.0
