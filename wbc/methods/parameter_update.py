"""Adaptation of parameters that never leaves a set: gradient law, tangent cone, projection.

A controller with regressor Y adapts its estimate by  dâ/dt = Γ Yᵀ s  (s the reference velocity error). Inside the set

    {a : lower ≤ a ≤ upper,  C a ≤ d}

that is kept; on its boundary the rate is the nearest one that does not leave, in the metric of the gain:

    minimise ½ (x − Γ Yᵀ s)ᵀ Γ⁻¹ (x − Γ Yᵀ s)   subject to   (rows on the boundary) x ≤ 0.

With that metric, and only with it, the projection never makes the Lyapunov function of the closed loop grow faster:
(â − a)ᵀ Γ⁻¹ (x − Γ Yᵀ s) ≤ 0 for every true parameter a in the set. A step of length dt is the nearest point of the
set to â + dt Γ Yᵀ s.

Slotine, Li: On the adaptive control of robot manipulators, International Journal of Robotics Research 6(3), 1987.
Ioannou, Sun: Robust Adaptive Control, 1996, section 8.4 (projection).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NoClosedForm
from wbc.methods.least_distance import NOTHING, nearest
from wbc.methods.method import Method
from wbc.methods.shared import box, metric, root
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.tolerances import ROUNDING, SHARP
from wbc.types import Flags, Mat, Vec


@final
@dataclass(frozen=True, eq=False)
class ParameterRate:
    """a_hat_dot (p,), the rows that hold it back, and whether there is one (always: zero is).

    ``active``: the rows of C by index, then parameters on a bound by len(C) + index; with a box alone, parameters.
    """

    a_hat_dot: Vec
    active: tuple[int, ...]
    feasible: bool


@final
@dataclass(frozen=True, eq=False, init=False)
class ParameterUpdate(Method):
    """One instant of an adaptive law with p parameters and n rows of the regressor.

    Args:
        Y: regressor (n, p) [N m or N per unit of the parameter].
        s: q̇_r − q̇ (n,) [rad/s, m/s].
        gain: Γ; a positive number, positive (p,), or symmetric positive definite (p, p).
        a_hat: estimate (p,), inside the set.
        lower: lower bounds (p,), a number for all, or None.
        upper: upper bounds (p,), a number for all, or None.
        C: rows (k, p) of C a ≤ d.
        d: their right sides (k,).

    Raises:
        InvalidInput: shapes, NaN, a gain that is not positive definite, crossed bounds, C without d, a_hat outside.

    Example:
        >>> from wbc.methods import ParameterUpdate
        >>> update = ParameterUpdate([[1.0, 2.0]], [-3.0], gain=[1.0, 0.5], a_hat=[4.0, 0.0], lower=0.0)
        >>> print(update.closed_form().a_hat_dot, update.closed_form().active, update.step(2.0))
        [-3.  0.] (1,) [0. 0.]
    """

    Y: Mat
    s: Vec
    gain: Mat
    a_hat: Vec
    lower: Vec
    upper: Vec
    C: Mat
    d: Vec

    def __init__(
        self,
        Y: Any,
        s: Any,
        *,
        gain: Any,
        a_hat: Any,
        lower: Any = None,
        upper: Any = None,
        C: Any = None,
        d: Any = None,
    ) -> None:
        a_hat = checks.array("a_hat", a_hat, (None,))
        p = len(a_hat)
        Y = checks.array("Y", Y, (None, p))
        if (C is None) != (d is None):
            raise InvalidInput("C and d come together: one of them is missing")
        C = np.zeros((0, p)) if C is None else checks.array("C", C, (None, p))
        low, high = box(p, lower=-np.inf if lower is None else lower, upper=np.inf if upper is None else upper)
        self._set(
            Y=Y, s=checks.array("s", s, (len(Y),)), gain=metric("gain", gain, p), a_hat=a_hat,
            lower=low, upper=high, C=C, d=np.zeros(0) if d is None else checks.array("d", d, (len(C),)),
        )  # fmt: skip
        self._refuse_outside()

    # ---- the set
    def _lengths(self) -> tuple[Vec, Vec]:
        """Of the rows of C and of the bounds, in the metric Γ; 1 for rows of zeros."""
        rows = np.sqrt(np.einsum("ij,jk,ik->i", self.C, self.gain, self.C))
        return np.where(rows > 0.0, rows, 1.0), np.sqrt(self.gain.diagonal())

    def _margins(self) -> tuple[Vec, Vec, Vec]:
        """Distances of â from the rows of C, the lower and the upper bounds, in the metric Γ⁻¹; inf: no bound."""
        rows, sides = self._lengths()
        return (
            (self.d - self.C @ self.a_hat) / rows, (self.a_hat - self.lower) / sides, (self.upper - self.a_hat) / sides
        )  # fmt: skip

    def _rounding(self) -> float:
        """How far outside the set, in the metric Γ⁻¹, an estimate is by rounding."""
        return max(NOTHING, SHARP * float(np.linalg.norm(np.linalg.solve(root(self.gain), self.a_hat))))

    def _on_boundary(self) -> tuple[Flags, Flags, Flags]:
        """Which rows of C, lower and upper bounds â is on: nearer than a share of the terms of their own sums.

        The size of the whole estimate in the metric Γ⁻¹ does not count: a parameter of little gain is long in it, and
        would hold all others.
        """
        rows, low, high = self._margins()
        lengths, sides = self._lengths()
        terms = np.abs(self.d) + np.abs(self.C) @ np.abs(self.a_hat)
        at_low, at_high = (
            np.isfinite(bound) & (room <= SHARP * np.maximum(np.abs(self.a_hat), np.abs(bound)) / sides)
            for room, bound in ((low, self.lower), (high, self.upper))
        )
        return rows <= SHARP * terms / lengths, at_low, at_high

    def _refuse_outside(self) -> None:
        rows, low, high = self._margins()
        rounding = self._rounding()
        for i in (rows < -rounding).nonzero()[0]:
            raise InvalidInput(f"a_hat is outside the set: C[{i}] a_hat is {self.C[i] @ self.a_hat:g} > {self.d[i]:g}")
        for i in (np.minimum(low, high) < -rounding).nonzero()[0]:
            bound = f"< {self.lower[i]:g}" if low[i] < 0.0 else f"> {self.upper[i]:g}"
            raise InvalidInput(f"a_hat[{i}] is {self.a_hat[i]:g} {bound}: outside the set")

    @property
    def _free_rate(self) -> Vec:
        """Γ Yᵀ s."""
        return np.asarray(self.gain @ (self.Y.T @ self.s))

    def _has_formula(self) -> bool:
        coupled = bool(np.count_nonzero(self.gain - np.diag(self.gain.diagonal())))
        return not len(self.C) and not (coupled and np.isfinite([self.lower, self.upper]).any())

    # ---- closed form
    def closed_form(self) -> ParameterRate:
        """Γ Yᵀ s; in a box, zero for a parameter on a bound that it would leave.

        Raises:
            NoClosedForm: rows C, or a box with a gain that is not diagonal.
        """
        if not self._has_formula():
            raise NoClosedForm("rows C, or a box with a gain that is not diagonal, have no closed form; use solve")
        _, low, high = self._on_boundary()
        rate = self._free_rate
        held = (low & (rate < 0.0)) | (high & (rate > 0.0))
        return ParameterRate(np.where(held, 0.0, rate), tuple(int(i) for i in held.nonzero()[0]), True)

    # ---- QP
    def qp(self) -> QP:
        """The rate x (p): H = Γ⁻¹, g = −Yᵀ s; C x ≤ 0 for rows on the boundary, x ≥ 0 or ≤ 0 for such bounds."""
        rows, low, high = self._on_boundary()
        inverse = np.linalg.inv(self.gain)
        return QP(
            0.5 * (inverse + inverse.T), -self.Y.T @ self.s,
            C=self.C, cu=np.where(rows, 0.0, np.inf), lb=np.where(low, 0.0, -np.inf), ub=np.where(high, 0.0, np.inf),
            rows=[
                *(Row("set", f"row {i}") for i in range(len(self.C))),
                *(Row("bounds", f"parameter {i}") for i in range(len(self.a_hat))),
            ],
        )  # fmt: skip

    def solve(self, solver: str | Solver = "pdas") -> ParameterRate:
        """The nearest rate that does not leave the set.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        found = nearest(self.qp(), self._free_rate, root(self.gain), solver)
        assert found is not None  # zero is a rate
        push = np.concatenate([found.z, found.z_box])
        return ParameterRate(found.x, tuple(int(i) for i in push.nonzero()[0]), True)

    def step(self, dt: float, solver: str | Solver = "pdas") -> Vec:
        """The estimate after dt [s] (p,): the point of the set nearest to â + dt Γ Yᵀ s in the metric Γ⁻¹.

        Raises:
            InvalidInput: dt is not positive.
            SolverFailed: the solver ended without an answer.
        """
        away = checks.number("dt", dt, low=0.0, strict=True) * self._free_rate
        if self._has_formula():
            return np.clip(self.a_hat + away, self.lower, self.upper)
        aim = self.a_hat + away
        if (self.C @ aim <= self.d).all() and (self.lower <= aim).all() and (aim <= self.upper).all():
            return aim  # most ticks of an adaptive law: what stays inside costs no quadratic program
        # In changes of â, so that none is possible to the last digit.
        p, (rows, sides) = len(away), self._lengths()
        qp = QP(
            np.eye(p), np.zeros(p), C=self.C, cu=np.maximum(self.d - self.C @ self.a_hat, 0.0),
            lb=np.minimum(self.lower - self.a_hat, 0.0), ub=np.maximum(self.upper - self.a_hat, 0.0),
        )  # fmt: skip
        outside, metric_root, way = np.inf, root(self.gain), away
        while outside > 0.1 * self._rounding():  # once; twice where rounding of a long way leaves the set
            found = nearest(qp, away, metric_root, solver)
            assert found is not None  # zero is a change
            lengths = np.linalg.norm(np.linalg.solve(metric_root, np.column_stack([found.x, way])), axis=0)
            if lengths[0] <= ROUNDING * lengths[1]:
                return self.a_hat.copy()  # held on all sides: what is left of the way is rounding
            away, before = found.x, outside
            over = np.concatenate([(self.C @ away - qp.cu) / rows, (away - qp.ub) / sides, (qp.lb - away) / sides])
            outside = float(over.max(initial=0.0))
            if outside >= before:
                break
        return np.clip(self.a_hat + away, self.lower, self.upper)  # of rounding

    def difference(self, result: ParameterRate, reference: ParameterRate) -> Mapping[str, float]:
        """Rates relative to Γ Yᵀ s, both in the metric of the gain; and of what a row on the boundary is relaxed by."""
        inverse = np.linalg.inv(root(self.gain))
        size = float(np.linalg.norm(inverse @ self._free_rate)) or 1.0
        x, (row_lengths, sides) = result.a_hat_dot, self._lengths()
        outwards = [self.C @ x / row_lengths, -x / sides, x / sides]
        leaves = np.concatenate([np.where(on, o, 0.0) for on, o in zip(self._on_boundary(), outwards, strict=True)])
        return {
            "a_hat_dot": float(np.linalg.norm(inverse @ (x - reference.a_hat_dot))) / size,
            "set": max(0.0, float(leaves.max(initial=0.0))) / size,
        }
