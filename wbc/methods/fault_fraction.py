"""How much of each commanded torque is missing: l in [0, 1] with diag(τ) l ≈ r, r the momentum residual.

    minimise ½ (diag(τ) l − r)ᵀ Q (diag(τ) l − r)   subject to   0 ≤ l ≤ 1.

l = 0: sound, l = 1: the actuator is dead, between: it has lost effectiveness. With diagonal Q each joint stands for
itself and l_i = r_i / τ_i, cut to [0, 1]. A joint whose command is zero cannot show a loss: it is not identifiable.

De Luca, Mattone: An adapt-and-detect actuator FDI scheme for robot manipulators, IEEE ICRA 2004.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from wbc import checks
from wbc.errors import NoClosedForm
from wbc.methods.least_distance import nearest
from wbc.methods.method import Method
from wbc.methods.shared import inverse_root, metric
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.tolerances import SAME
from wbc.types import Mat, Vec


@final
@dataclass(frozen=True, eq=False)
class Fraction:
    """fraction (n,) in [0, 1], NaN where ``identifiable`` (n,) says that it cannot be known."""

    fraction: Vec
    identifiable: NDArray[np.bool_]


@final
@dataclass(frozen=True, eq=False, init=False)
class FaultFraction(Method):
    """One instant of n actuators.

    Args:
        tau: commanded torques (n,) [N m, N].
        residual: missing torques (n,) as :class:`MomentumResidual` estimates them.
        weight: Q; a positive number, positive (n,), symmetric positive definite (n, n), or None for the identity.

    Raises:
        InvalidInput: shapes, NaN, a weight that is not positive definite.

    Example:
        >>> from wbc.methods import FaultFraction
        >>> print(FaultFraction([5.0, -2.0, 0.0], [5.1, -0.5, 0.1]).closed_form().fraction)
        [1.   0.25  nan]
    """

    tau: Vec
    residual: Vec
    weight: Mat

    def __init__(self, tau: Any, residual: Any, *, weight: Any = None) -> None:
        tau = checks.array("tau", tau, (None,))
        self._set(
            tau=tau, residual=checks.array("residual", residual, (len(tau),)),
            weight=metric("weight", 1.0 if weight is None else weight, len(tau)),
        )  # fmt: skip

    @property
    def identifiable(self) -> NDArray[np.bool_]:
        """Joints (n,) whose command is not zero."""
        largest = np.abs(np.concatenate([self.tau, self.residual])).max(initial=0.0)
        return np.asarray(np.abs(self.tau) > SAME * largest)

    def closed_form(self) -> Fraction:
        """r_i / τ_i cut to [0, 1].

        Raises:
            NoClosedForm: the weight is not diagonal.
        """
        if np.count_nonzero(self.weight - np.diag(self.weight.diagonal())):
            raise NoClosedForm("a weight that is not diagonal couples the joints; use solve")
        known = self.identifiable
        ratio = np.divide(self.residual, self.tau, out=np.full(len(self.tau), np.nan), where=known)
        return Fraction(np.clip(ratio, 0.0, 1.0), known)

    def _wanted(self) -> Vec:
        """diag(τ) l of the identifiable joints that is best without bounds: r, and what Q couples to it."""
        known = self.identifiable
        Q, coupled = self.weight[np.ix_(known, known)], self.weight[np.ix_(known, ~known)]
        return np.asarray(self.residual[known] + np.linalg.solve(Q, coupled @ self.residual[~known]))

    def qp(self) -> QP:
        """l of the identifiable joints: H = diag(τ) Q diag(τ), g = −diag(τ) Q r, bounds 0 and 1."""
        known = self.identifiable
        tau = self.tau[known]
        H = tau[:, None] * self.weight[np.ix_(known, known)] * tau
        return QP(
            0.5 * (H + H.T), -tau * (self.weight[known] @ self.residual), lb=np.zeros(len(tau)), ub=np.ones(len(tau)),
            rows=[Row("fraction", f"joint {i}") for i in known.nonzero()[0]],
        )  # fmt: skip

    def solve(self, solver: str | Solver = "pdas") -> Fraction:
        """The fractions on any solver.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        known = self.identifiable
        fraction, tau = np.full(len(known), np.nan), self.tau[known]
        if known.any():
            root = inverse_root(self.weight[np.ix_(known, known)]) / tau[:, None]
            found = nearest(self.qp(), self._wanted() / tau, root, solver)
            assert found is not None  # zero is a fraction
            fraction[known] = np.clip(found.x, 0.0, 1.0)  # of rounding
        return Fraction(fraction, known)

    def difference(self, result: Fraction, reference: Fraction) -> Mapping[str, float]:
        """Fractions as they are, and the misfit |diag(τ) l − r|²_Q relative to that of l = 0."""
        known = self.identifiable
        if (result.identifiable != known).any() or (reference.identifiable != known).any():
            return {"identifiable": np.inf}
        rest = [np.where(known, self.tau * f.fraction, 0.0) - self.residual for f in (result, reference)]
        misfit = [float(r @ self.weight @ r) for r in rest]
        none = float(self.residual @ self.weight @ self.residual) or 1.0
        apart = (rest[0] - rest[1])[known]
        size = float(np.linalg.norm(np.concatenate([self.tau[known], self.residual]))) or 1.0
        return {"torque": float(np.linalg.norm(apart)) / size, "misfit": abs(misfit[0] - misfit[1]) / none}
