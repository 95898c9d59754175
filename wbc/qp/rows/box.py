"""Bounds and nothing else (inverse kinematics): the cost is formed and DAQP, made for this, answers directly.

Boxes change often when joints run into their speed limits, so that guessing the active set does not pay here.
"""

from __future__ import annotations

from math import isfinite
from typing import final

import daqp
import numpy as np
from scipy.linalg.blas import dgemm, dgemv

from wbc.qp.certificate import Certificate
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.solver import RowSolver
from wbc.types import Mat, Status, Vec

_STATUS = {1: Status.SOLVED, 2: Status.SOLVED, -1: Status.INFEASIBLE, -3: Status.UNBOUNDED, -4: Status.MAX_ITERATIONS}
_INFINITY = 1e30


@final
class BoxSolver(RowSolver):
    """minimise ½ (y − c)ᵀD(y − c) + ½ Σ wᵢ (Sᵢ x̂)² subject to lb ≤ y ≤ ub, through daqp.solve."""

    form = "box"

    def __init__(self, problem: RowProblem, *, tolerance: float = 1e-8) -> None:
        super().__init__(problem)
        self.tolerance = tolerance
        p, n, m = problem, problem.n, problem.n_soft
        self._S = p.G[p.soft, :n]
        self._right = p.G[p.soft, n]
        self._weighted = np.zeros((m, n))
        self._soft = p.G[p.soft]
        self._rows = p.value[p.item(p.soft.start) : p.item(p.soft.stop)]
        self._lb, self._ub = p.lb, p.ub
        self._roots = np.zeros((m, n))
        self._root = np.zeros(m)
        self._b = np.zeros(m)
        self._D: Mat = np.zeros((n, n), order="F")
        self._A = np.zeros((0, n))
        self._low, self._high = np.full(n, -_INFINITY), np.full(n, _INFINITY)
        self._sense = np.zeros(n, np.int32)
        self._gradient, self._over, self._pull = np.zeros(n), np.zeros(n), np.zeros(n)
        self._z_box = np.zeros(n)
        self._version = -1

    def reset(self) -> None:
        """Nothing is remembered."""

    def _read_weights(self) -> None:
        p = self.problem
        self._root[:] = np.sqrt(p.weights / p.unit)
        self._roots[:] = self._root[:, None]
        self._D[:] = np.diag(p.metric)
        self._version = p.version

    def solve(self) -> Status:
        p = self.problem
        if p.version != self._version:
            self._read_weights()
        W = np.multiply(self._S, self._roots, self._weighted)
        H = dgemm(1.0, W.T, W.T, 1.0, self._D, 0, 1)
        np.multiply(self._right, self._root, self._b)
        g = dgemv(1.0, W.T, self._b)
        np.multiply(p.metric, p.centre, self._pull)
        g -= self._pull
        np.maximum(self._lb, -_INFINITY, out=self._low)
        np.minimum(self._ub, _INFINITY, out=self._high)
        if not isfinite(g.dot(g) + self._low.dot(self._high)):
            return Status.FAILED
        x, _, flag, info = daqp.solve(H, g, self._A, self._high, self._low, self._sense, primal_tol=1e-10)
        self.iterations = int(info["iterations"])
        self.counts.first += 1
        if flag <= 0:
            return _STATUS.get(flag, Status.FAILED)
        p.x[:] = x
        np.dot(self._soft, p.x1, out=self._rows)
        return self._certify(H, g, info["lam"])

    def _certify(self, H: Mat, g: Vec, multiplier: Vec) -> Status:
        """Stationarity H x + g + z = 0 and the bounds, from the data."""
        p, x = self.problem, self.problem.x
        z = self._z_box = multiplier  # DAQP makes a new array for each answer
        gradient, over = self._gradient, self._over
        np.dot(H, x, out=gradient)
        gradient += g
        gradient += z
        dual = max(gradient[gradient.argmax()], -gradient[gradient.argmin()])
        np.subtract(x, self._high, out=over)
        primal = over[over.argmax()]
        np.subtract(self._low, x, out=over)
        primal = max(primal, over[over.argmax()], 0.0)
        gap = 0.0
        if z.any():
            gap = float(np.abs(z * (np.where(z > 0, self._high, self._low) - x)).sum())
        size = 1.0 + max(g[g.argmax()], -g[g.argmin()])
        self.certificate = Certificate(primal, dual * p.unit, gap * p.unit, size * p.unit, size * p.unit)
        good = primal <= self.tolerance and dual <= self.tolerance * size and gap <= self.tolerance * size
        return Status.SOLVED if good else Status.INACCURATE

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return np.zeros(0), np.zeros(0), self._z_box * self.problem.unit / self.problem.scale

    @property
    def active_count(self) -> int:
        return int(np.count_nonzero(self._z_box))
