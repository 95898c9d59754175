"""Bounds and nothing else (inverse kinematics): the cost is formed and DAQP, made for this, answers directly.

Boxes change often when joints run into their speed limits, so that guessing the active set does not pay here, but
for one guess: where no bound pushed in the last answer, one Cholesky says whether none does now.
"""

from __future__ import annotations

from math import isfinite
from typing import final

import daqp
import numpy as np
from scipy.linalg.blas import dgemm, dgemv
from scipy.linalg.lapack import dposv

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
        self._soft = p.G[p.soft]
        self._roots, self._weighted = np.zeros((m, n + 1)), np.zeros((m, n + 1))
        self._rows = p.value[p.item(p.soft.start) : p.item(p.soft.stop)]
        self._lb, self._ub = p.lb, p.ub
        self._D: Mat = np.zeros((n, n), order="F")
        self._H, self._g = self._D.copy(order="F"), np.zeros(n)
        self._A = np.zeros((0, n))
        self._low, self._high = np.full(n, -_INFINITY), np.full(n, _INFINITY)
        self._sense = np.zeros(n, np.int32)
        self._over, self._under, self._pull, self._minus_g = (np.zeros(n) for _ in range(4))
        self._z_box = self._no_push = np.zeros(n)
        self._free = True
        self._version = -1

    def reset(self) -> None:
        """All that is remembered is whether a bound pushed in the last answer."""
        self._free = True

    def _read_weights(self) -> None:
        p = self.problem
        self._roots[:] = np.sqrt(p.weights / p.unit)[:, None]
        self._D[:] = np.diag(p.metric)
        self._version = p.version

    def solve(self) -> Status:
        p = self.problem
        if p.version != self._version:
            self._read_weights()
        H, g = self._cost()
        self.counts.first += 1
        self.iterations = 1
        if self._free:
            np.negative(g, self._minus_g)
            _, x, info = dposv(H, self._minus_g)
            if not info and self._certified(H, g, x):  # NaN is certified by nothing
                return Status.SOLVED
        np.maximum(self._lb, -_INFINITY, out=self._low)
        np.minimum(self._ub, _INFINITY, out=self._high)
        if not isfinite(g.dot(g) + self._low.dot(self._high)):
            self.counts.first -= 1
            return Status.FAILED
        x, _, flag, info = daqp.solve(H, g, self._A, self._high, self._low, self._sense, primal_tol=1e-10)
        self.iterations = int(info["iterations"])
        if flag <= 0:
            return _STATUS.get(flag, Status.FAILED)
        return Status.SOLVED if self._certified(H, g, x, info["lam"]) else Status.INACCURATE

    def _cost(self) -> tuple[Mat, Vec]:
        """½ yᵀH y + gᵀy, divided by the problem's unit: Ŝᵀ Ŝ holds both, with Ŝ = √w [S s]."""
        p, n = self.problem, self.problem.n
        np.multiply(p.metric, p.centre, self._pull)
        if not p.n_soft:  # BLAS refuses empty matrices
            return self._D, -self._pull
        W = np.multiply(self._soft, self._roots, self._weighted).T
        both = dgemm(1.0, W, W, 0.0, None, 0, 1)
        np.add(both[:n, :n], self._D, self._H)
        np.subtract(both[:n, n], self._pull, self._g)
        return self._H, self._g

    def _certified(self, H: Mat, g: Vec, x: Vec, z: Vec | None = None) -> bool:
        """Take x and its multipliers z (none pushes by default) as the answer; residuals from the data.

        Stationarity is H x + g + z = 0.
        """
        p, over, under = self.problem, self._over, self._under
        p.x[:] = x
        np.dot(self._soft, p.x1, out=self._rows)
        gradient = dgemv(1.0, H, x, 1.0, g)
        gap, self._z_box, self._free = 0.0, self._no_push, True
        if z is not None:
            gradient += z
            gap = float(np.abs(z * (np.where(z > 0, self._high, self._low) - x)).sum())
            self._z_box, self._free = z, not np.count_nonzero(z)
        dual = _largest(np.abs(gradient, gradient))
        np.subtract(x, self._ub, over)
        np.subtract(self._lb, x, under)
        np.maximum(over, under, out=over)
        primal = max(float(over[over.argmax()]), 0.0)
        size = 1.0 + _largest(np.abs(g, gradient))
        unit = p.unit
        self.certificate = Certificate(primal, dual * unit, gap * unit, size * unit, size * unit)
        return primal <= self.tolerance and dual <= self.tolerance * size and gap <= self.tolerance * size

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return np.zeros(0), np.zeros(0), self._z_box * self.problem.unit / self.problem.scale

    @property
    def active_count(self) -> int:
        return int(np.count_nonzero(self._z_box))


def _largest(values: Vec) -> float:
    return float(values[values.argmax()])
