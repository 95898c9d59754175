"""Bounds and nothing else (inverse kinematics): the bounds that held are a guess, and DAQP answers where it is wrong.

    minimise ½ (y − c)ᵀD(y − c) + ½ Σ wᵢ (Sᵢ x̂)²   subject to lb <= y <= ub,   x̂ = [y | 1]

With Ŵ = √w Ŝ, the columns of what is held set to zero and their contribution moved into the last one, ŴᵀŴ + D holds
both the cost of what is free and its slope: one product, one Cholesky. The gradient at the answer is then made anew
from the rows, whose residuals are exact where their products lose half the digits, and says whether the guess was
right. Many bounds change at once when joints run into their speed limits, so that repairing a guess does not pay here:
DAQP, made for this, starts afresh.
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
from wbc.types import Index, Mat, Status, Vec

# A box that is not empty can be met: what is called infeasible here is a matter of numbers.
_STATUS = {1: Status.SOLVED, 2: Status.SOLVED, -3: Status.UNBOUNDED, -4: Status.MAX_ITERATIONS}
_INFINITY = 1e30
# Multipliers below this share of the largest are rounding.
_ROUNDING = 1e-12


@final
class BoxSolver(RowSolver):
    """Guess and verify, then daqp.solve."""

    form = "box"

    def __init__(self, problem: RowProblem, *, tolerance: float = 1e-8) -> None:
        super().__init__(problem)
        self.tolerance = tolerance
        p, n, m = problem, problem.n, problem.n_soft
        self._S = p.G[p.soft]
        self._S_T = self._S.T
        self._rows = p.value[p.item(p.soft.start) : p.item(p.soft.stop)]
        self._root, self._weights = np.zeros(m), np.zeros(m)
        self._roots, self._masked, self._W = (np.zeros((m, n + 1)) for _ in range(3))
        self._slope = self._W[:, n]
        self._D: Mat = np.zeros((n + 1, n + 1), order="F")
        self._A, self._sense = np.zeros((0, n)), np.zeros(n, np.int32)
        self._low, self._high = np.zeros(n), np.zeros(n)
        self._pull, self._right, self._gradient, self._over, self._under = (np.zeros(n) for _ in range(5))
        self._push, self._held = np.zeros(m), np.zeros(n + 1)
        self._z_box = np.zeros(n)
        self._version = -1
        self.reset()

    def reset(self) -> None:
        self.guess(np.zeros(0, np.intp), np.zeros(0))

    def working_set(self) -> tuple[Index, Vec]:
        return self._pins, self._side

    def guess(self, items: Index, side: Vec) -> None:
        self._pins, self._side = items, side
        self._bounds = items + (side > 0) * len(self.problem.value)
        self._masked[:] = self._roots
        self._masked[:, items] = 0.0
        self._held[:] = 0.0
        self._held[-1] = 1.0

    def _read_weights(self) -> None:
        p = self.problem
        np.divide(p.weights, p.unit, out=self._weights)
        np.sqrt(self._weights, out=self._root)
        self._roots[:] = self._root[:, None]
        self._D[:-1, :-1] = np.diag(p.metric)
        self._version = p.version
        self.guess(self._pins, self._side)

    # ---- one tick
    def solve(self) -> Status:
        self._read()
        self.iterations = 1
        if self._guessed():
            self.counts.first += 1
            return Status.SOLVED
        return self._ask_daqp()

    def solve_afresh(self) -> Status:
        """Solve without a guess."""
        self._read()
        return self._ask_daqp()

    def _read(self) -> None:
        p = self.problem
        if p.version != self._version:
            self._read_weights()
        np.multiply(p.metric, p.centre, self._pull)

    def _guessed(self) -> bool:
        """Solve for the bounds that are guessed; whether that is the answer."""
        p, n, pins = self.problem, self.problem.n, self._pins
        H = self._D
        if len(pins):
            self._held[pins] = p.bounds.take(self._bounds)
        if p.n_soft:  # BLAS refuses empty matrices
            W = np.multiply(self._S, self._masked, self._W).T
            if len(pins):
                np.multiply(np.dot(self._S, self._held), self._root, self._slope)
            H = dgemm(1.0, W, W, 1.0, self._D, 0, 1)
        np.subtract(self._pull, H[:n, n], self._right)
        _, x, info = dposv(H[:n, :n], self._right)
        if info:
            return False
        p.x[:] = x
        if len(pins):
            p.x[pins] = self._held[pins]
        return self._verify()

    def _verify(self) -> bool:
        """Bounds, and the gradient: zero where free, against its bound where held. NaN is neither."""
        p, pins, gradient, over, under = self.problem, self._pins, self._gradient, self._over, self._under
        x = p.x
        self._slope_at(x)
        wrong = 0.0
        self._z_box.fill(0.0)
        if len(pins):
            pull = gradient[pins]
            self._z_box[pins] = -pull
            pull *= self._side
            pull[p.lower[pins] == p.upper[pins]] = 0.0
            wrong = float(pull[pull.argmax()])
            gradient[pins] = 0.0
        np.subtract(x, p.ub, over)
        np.subtract(p.lb, x, under)
        np.maximum(over, under, out=over)
        primal = max(float(over[over.argmax()]), 0.0)
        dual = max(_largest(np.abs(gradient, gradient)), wrong)
        size = 1.0 if dual <= self.tolerance else self._size()
        self.certificate = Certificate(primal, dual * p.unit, 0.0, size * p.unit, size * p.unit)
        return primal <= self.tolerance and dual <= self.tolerance * size

    def _slope_at(self, x: Vec) -> None:
        """D (x − c) + Σ wᵢ Sᵢᵀ (Sᵢ x̂), from the data; the rows' values on the way."""
        p, gradient = self.problem, self._gradient
        np.dot(self._S, p.x1, out=self._rows)
        np.multiply(p.metric, x, gradient)
        np.subtract(gradient, self._pull, gradient)
        if p.n_soft:
            np.multiply(self._weights, self._rows, self._push)
            gradient += dgemv(1.0, self._S_T, self._push)[: p.n]

    def _size(self) -> float:
        """1 + ‖g‖∞, g the gradient at zero."""
        return 1.0 + _largest(np.abs(self._S_T[:-1] @ (self._weights * self._S[:, -1]) - self._pull))

    # ---- a wrong guess
    def _ask_daqp(self) -> Status:
        p, n = self.problem, self.problem.n
        H, g = np.diag(p.metric), -self._pull
        if p.n_soft:
            W = np.multiply(self._S, self._roots, self._W).T
            both = dgemm(1.0, W, W, 1.0, self._D, 0, 1)
            H, g = np.asfortranarray(both[:n, :n]), both[:n, n] - self._pull
        np.maximum(p.lb, -_INFINITY, out=self._low)
        np.minimum(p.ub, _INFINITY, out=self._high)
        if not isfinite(g.dot(g) + self._low.dot(self._high)):
            return Status.FAILED
        self.counts.fallback += 1
        x, _, flag, info = daqp.solve(H, g, self._A, self._high, self._low, self._sense, primal_tol=1e-10)
        self.iterations = 1 + int(info["iterations"])
        if flag <= 0:
            self.reset()
            return _STATUS.get(flag, Status.FAILED)
        return self._accept(x, info["lam"])

    def _accept(self, x: Vec, z: Vec) -> Status:
        """Take DAQP's answer and its multipliers, if they are certified; what pushes is the next guess."""
        p, gradient, over, under = self.problem, self._gradient, self._over, self._under
        size_of_push = np.abs(z)
        pins = np.flatnonzero(size_of_push > _ROUNDING * _largest(size_of_push))
        self.guess(pins, np.sign(z[pins]))
        p.x[:] = x
        self._slope_at(x)
        gradient += z
        self._z_box = z
        np.subtract(x, p.ub, over)
        np.subtract(p.lb, x, under)
        gap = float(np.abs(z[pins] * np.where(z[pins] > 0, over[pins], under[pins])).sum())
        np.maximum(over, under, out=over)
        primal, dual = max(float(over[over.argmax()]), 0.0), _largest(np.abs(gradient, gradient))
        size = self._size()
        self.certificate = Certificate(primal, dual * p.unit, gap * p.unit, size * p.unit, size * p.unit)
        sound = primal <= self.tolerance and dual <= self.tolerance * size and gap <= self.tolerance * size
        return Status.SOLVED if sound else Status.INACCURATE

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return np.zeros(0), np.zeros(0), self._z_box * self.problem.unit / self.problem.scale

    @property
    def active_count(self) -> int:
        return len(self._pins)


def _largest(values: Vec) -> float:
    return float(values[values.argmax()])
