"""Bounds and nothing else (inverse kinematics): the bounds that held are a guess, and DAQP answers where it is wrong.

    minimise ½ (y − c)ᵀD(y − c) + ½ Σ wᵢ (Sᵢ x̂)²   subject to lb <= y <= ub,   x̂ = [y | 1]

But for what does not depend on y the cost is ½ x̂ᵀM x̂, with

    M = ŴᵀŴ + [D  −D c; −(D c)ᵀ  0],   Ŵ = √w Ŝ.

What is known of x̂ (the constant 1, and bounds that are guessed to hold) is tied to its value ĥ by springs of a
stiffness κ beside which all costs are lost in rounding, so that it comes out as it went in, bit by bit:

    (M + κ P) x̂ = κ P ĥ,   P: 1 on the diagonal for what is known, else 0.

One product and one Cholesky give x̂ whole, whatever is guessed. All is divided by κ, a power of four, which rounds
nothing.

The gradient at the answer is then made anew from the rows, whose residuals are exact where their products lose half
the digits, and says whether the guess was right. Many bounds change at once when joints run into their speed limits,
so that repairing a guess does not pay here: DAQP, made for this, starts afresh. As long as its bounds are other ones in
every tick, there is nothing to guess.
"""

from __future__ import annotations

from math import isfinite
from typing import final

import daqp
import numpy as np
from scipy.linalg.blas import dasum, daxpy, dcopy, ddot, dgemm, dgemv, dsyrk, idamax
from scipy.linalg.lapack import dposv

from wbc.qp.rows.dual import DualSolver
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.proof import RowProof
from wbc.qp.rows.solver import RowSolver
from wbc.types import Index, Status, Vec

# A box that is not empty can be met: what is called infeasible here is a matter of numbers.
_STATUS = {1: Status.SOLVED, 2: Status.SOLVED, -3: Status.UNBOUNDED, -4: Status.MAX_ITERATIONS}
_INFINITY = 1e30
# Multipliers below this share of the largest are rounding.
_ROUNDING = 1e-12
# Changes of the working set in a row after which it is not guessed until it stands still.
RESTLESS = 2
# κ and its root: far above any cost, far below where numbers end.
_KAPPA, _ROOT = 2.0**200, 2.0**100


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
        self._weights, self._push = np.zeros(m), np.zeros(m)
        self._roots, self._W = np.zeros((m, n + 1)), np.zeros((m, n + 1))
        self._W_T = self._W.T
        # D and −D c, which is made anew in every tick, over κ; and the same with springs. The lower triangle is read.
        self._D, self._D_tied = (np.zeros((n + 1, n + 1), order="F") for _ in range(2))
        self._minus_metric, self._minus_pull = np.zeros(n), self._D_tied[n, :n]
        self._A, self._sense = np.zeros((0, n)), np.zeros(n, np.int32)
        self._low, self._high = np.zeros(n), np.zeros(n)
        self._lowest, self._highest = np.full(n, -_INFINITY), np.full(n, _INFINITY)
        self._x, self._x1, self._lb, self._ub = p.x, p.x1, p.lb, p.ub
        self._metric, self._centre = p.metric, p.centre
        # Whether the metric is 1 everywhere, and whether all rows weigh the same: then there is less to multiply.
        self._is_uniform = self._is_even = False
        self._has_rows = m > 0  # BLAS refuses empty matrices
        self._beyond, self._part = np.zeros(2 * n), np.zeros(n)
        self._over, self._under = self._beyond[:n], self._beyond[n:]
        self._gradient1 = np.zeros(n + 1)
        self._gradient = self._gradient1[:n]
        # Which unknowns are guessed to be at a bound: +1 upper, −1 lower, 0 free; what is known of x̂.
        self._sides, self._free, self._known = np.zeros(n), np.ones(n), np.zeros(n + 1)
        self._known[n], self._held = 1.0, self._known[:n]
        self._at_upper, self._at_lower = np.zeros(n, bool), np.zeros(n, bool)
        self._proof, self._settler = RowProof(problem), DualSolver(problem)
        self.proof = self._proof  # of the last answer
        self._version = -1
        self.reset()

    def reset(self) -> None:
        self.guess(np.zeros(0, np.intp), np.zeros(0))

    def working_set(self) -> tuple[Index, Vec]:
        return self._pins, self._side

    def guess(self, items: Index, side: Vec) -> None:
        self._pins, self._side, self._is_held = items, side, len(items) > 0
        self._changes, self._is_ready = 0, False

    def _prepare(self) -> None:
        """What a guess is made of, once for all ticks that make it."""
        items = self._pins
        self._sides.fill(0.0)
        self._sides[items] = self._side
        self._held.fill(0.0)
        np.greater(self._sides, 0.0, out=self._at_upper)
        np.less(self._sides, 0.0, out=self._at_lower)
        np.equal(self._sides, 0.0, out=self._free)
        np.fill_diagonal(self._D_tied, self._D.diagonal())
        self._D_tied[items, items] = self._D_tied[-1, -1] = 1.0
        self._is_ready = True

    def _read_weights(self) -> None:
        p = self.problem
        np.divide(p.weights, p.unit, out=self._weights)
        self._is_even = self._has_rows and bool((self._weights == self._weights[0]).all())
        self._weight = float(self._weights[0]) if self._is_even else 1.0
        self._roots[:] = np.sqrt(self._weights)[:, None] / _ROOT
        np.divide(p.metric, -_KAPPA, out=self._minus_metric)
        np.fill_diagonal(self._D[:-1, :-1], -self._minus_metric)
        self._is_uniform = bool((p.metric == 1.0).all())
        self._version, self._is_ready = p.version, False

    # ---- one tick
    def solve(self) -> Status:
        self._read()
        self.iterations = 1
        if self._changes < RESTLESS and self._guessed() and self._verified():
            self._changes = 0
            self.counts.first += 1
            return Status.SOLVED
        return self._ask_daqp()

    def solve_afresh(self) -> Status:
        """Solve without a guess."""
        self._read()
        return self._ask_daqp()

    def _read(self) -> None:
        if self.problem.version != self._version:
            self._read_weights()
        np.multiply(self._minus_metric, self._centre, self._minus_pull)

    def _guessed(self) -> bool:
        """x̂ with the bounds that are guessed; whether it could be found."""
        if not self._is_ready:
            self._prepare()
        if self._is_held:
            np.copyto(self._held, self._ub, where=self._at_upper)
            np.copyto(self._held, self._lb, where=self._at_lower)
        if not self._has_rows:
            M = self._D_tied.copy("F")
        elif self._is_even:
            M = dsyrk(self._weight / _KAPPA, self._S_T, 1.0, self._D_tied, 0, 1)
        else:
            np.multiply(self._S, self._roots, self._W)
            M = dsyrk(1.0, self._W_T, 1.0, self._D_tied, 0, 1)
        dcopy(self._known, self._x1)
        _, x1, info = dposv(M, self._x1, 1, 1, 1)  # in place
        return bool(info == 0 and x1[-1] == 1.0)

    def _verified(self) -> bool:
        """Bounds, and the gradient: zero where free, against its bound where held. NaN is neither."""
        gradient, tolerance = self._slope_at_answer(), self.tolerance
        if not self._is_held:
            dual = _size_of(gradient)
        else:
            pull = np.multiply(gradient, self._sides, self._part)
            wrong = pull[pull.argmax()]
            if wrong > tolerance:  # where both sides are one, it may pull either way
                pull[self._lb == self._ub] = 0.0
                wrong = pull[pull.argmax()]
            dual = max(_size_of(np.multiply(gradient, self._free, self._part)), float(wrong))
        size = 1.0 if dual <= tolerance else self._size()
        return self._beyond_bounds() <= tolerance and dual <= tolerance * size and self._certified()

    def _certified(self) -> bool:
        """Prove the answer from the rows; their pushes are √w times their weighted residuals."""
        np.multiply(self._weights, self._rows, self._push)
        self.certificate, self.proof = self._proof.certify(self._push), self._proof
        return self.certificate.ok

    def _slope_at_answer(self) -> Vec:
        """D (x − c) + Σ wᵢ Sᵢᵀ (Sᵢ x̂), from the data; the rows' values on the way."""
        gradient = self._gradient
        dcopy(self._x, gradient)
        daxpy(self._centre, gradient, len(gradient), -1.0)
        if not self._is_uniform:
            gradient *= self._metric
        if self._has_rows:
            dgemv(1.0, self._S_T, self._x1, 0.0, self._rows, 0, 1, 0, 1, 1, 1)
            push = self._rows if self._is_even else np.multiply(self._weights, self._rows, self._push)
            dgemv(self._weight, self._S_T, push, 1.0, self._gradient1, 0, 1, 0, 1, 0, 1)
        return gradient

    def _beyond_bounds(self) -> float:
        """By how much the worst unknown is outside its bounds; below 0: inside."""
        n = len(self._x)
        dcopy(self._x, self._over)
        daxpy(self._ub, self._over, n, -1.0)
        dcopy(self._lb, self._under)
        daxpy(self._x, self._under, n, -1.0)
        return float(self._beyond[self._beyond.argmax()])

    def _size(self) -> float:
        """1 + ‖g‖∞, g the gradient at zero."""
        p = self.problem
        return 1.0 + _size_of((self._weights * self._S[:, -1]).dot(self._S[:, :-1]) - p.metric * p.centre)

    # ---- a wrong guess
    def _ask_daqp(self) -> Status:
        n = self.problem.n
        self._x1[n], self._D[n, :n] = 1.0, self._minus_pull
        if self._has_rows:
            np.multiply(self._S, self._roots, self._W)
            M = dgemm(_KAPPA, self._W_T, self._W_T, _KAPPA, self._D, 0, 1)
        else:
            M = _KAPPA * self._D
        H, g = M[:n, :n].copy("F"), M[n, :n].copy()
        np.maximum(self._lb, self._lowest, out=self._low)
        np.minimum(self._ub, self._highest, out=self._high)
        if not isfinite(ddot(g, g) + ddot(self._low, self._high)):
            return Status.FAILED
        self.counts.fallback += 1
        x, _, flag, info = daqp.solve(H, g, self._A, self._high, self._low, self._sense, primal_tol=1e-10)
        self.iterations = 1 + int(info["iterations"])
        if flag <= 0:
            self.reset()
            return _STATUS.get(flag, Status.FAILED)
        return self._accept(x, info["lam"])

    def _accept(self, x: Vec, z: Vec) -> Status:
        """Take DAQP's answer, or what follows from the bounds that push, if one is certified."""
        pins = (np.abs(z, self._part) > _ROUNDING * _size_of(z)).nonzero()[0]
        side = np.sign(z[pins])
        changes = self._changes + 1
        if pins.tobytes() != self._pins.tobytes() or side.tobytes() != self._side.tobytes():
            self.guess(pins, side)
            self._changes = changes
        else:
            self._changes = 0
        self._x[:] = x
        self._slope_at_answer()
        if self._certified():
            return Status.SOLVED
        if self._settler.settle(pins, side):
            self.certificate, self.proof = self._settler.certificate, self._settler.proof
            return Status.SOLVED
        self._x[:] = x
        self._slope_at_answer()
        return Status.INACCURATE

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return self.proof.multipliers()

    @property
    def active_count(self) -> int:
        return len(self._pins)


def _size_of(values: Vec) -> float:
    """‖values‖∞. NaN where one of them is, which idamax may not see and the sum does."""
    return abs(float(values[idamax(values)])) + 0.0 * float(dasum(values))
