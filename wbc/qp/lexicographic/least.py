"""Least squares within bounded rows by a working set: exact however flat the cost is.

    minimise   ½ ‖W z + a‖² + ½ ε ‖z − c‖²        W (m, d), c (d,) the centre
    subject to low ≤ A z ≤ high                    A (r, d)

With B the rows that are held at a bound b, Bᵀ = Q₁ R (QR with pivoting) and N the rest of Q,

    z₀ = Q₁ R⁻ᵀ b + N Nᵀ c ,      W N = U Σ Vᵀ ,      z = z₀ − N V Σ (Σ² + ε)⁻¹ Uᵀ (W z₀ + a)

The products WᵀW and B Bᵀ are never made, so nothing is lost by squaring: ε may be as small as 1e-12 of the largest
curvature. What the held rows push with is λ = −R⁻¹ Q₁ᵀ (Wᵀ(W z + a) + ε (z − c)).
Source: Björck, Numerical Methods for Least Squares Problems, SIAM, 1996, 5.1 and 5.3.
"""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgeqp3, dgesdd, dormqr, dtrtrs

from wbc.qp.rows.pivoting import Pivoting
from wbc.types import Index, Mat, Vec

#: Rows of unit length that reach no further than this out of the span of others depend on them.
_DEPENDENT = 1e-11
#: A push the wrong way below this share of what it is made of is rounding.
_ROUNDING = 1e-11
#: Pushes above this share of what they push against hold a stage back. With less, a stage is held by its own rows,
#: which are told apart down to a tenth of this; what is kept for nothing takes freedom from the stages below, unseen.
_HOLDS = 1e-6
#: Changes of the working set for each row; steps that are none; and what tells one row from the next.
_MOST, _STILL, _GOLDEN = 5, 1e-11, 0.6180339887498949
_NOTHING: Vec = np.zeros(0)
Mask = NDArray[np.bool_]


class Cost(NamedTuple):
    """½ ‖W z + a‖² + ½ ε ‖z − c‖²; where all of W z + a is within ``enough`` of zero it is as good as least.

    ``columns`` (d, m + 1) is [Wᵀ c], and ``size`` is ‖W‖.
    """

    columns: Mat
    a: Vec
    eps: float
    size: float
    enough: float


class Held(NamedTuple):
    """The minimum with some rows held: z (d,), which rows, on which side, what they push with, down from an upper side.

    ``wrong`` is how much each pulls instead of pushing, as far as that is more than rounding; ``holds`` which of them
    (mask) keep ‖W z + a‖ from being less.
    """

    z: Vec
    rows: Index
    side: Vec
    force: Vec
    wrong: Vec
    holds: Index


@final
class Within:
    """The rows, their bounds and lengths, and which of them (mask ``fixed``) nothing in this space moves."""

    def __init__(self, A: Mat, low: Vec, high: Vec, *, length: Vec, fixed: Mask, tolerance: float) -> None:
        self.A, self.low, self.high, self.length = A, low, high, length
        self.fixed, self.tolerance = fixed, tolerance
        self.iterations = 0

    def guess(self, cost: Cost, rows: Index, side: Vec, *, tries: int) -> Held | None:
        """The minimum with these rows held, or others that follow by block principal pivoting; None: not in time."""
        if len(rows):
            fits = ~self.fixed[rows] & np.isfinite(np.where(side > 0.0, self.high[rows], self.low[rows]))
            rows, side = rows[fits], side[fits]
        pivoting = Pivoting()
        for _ in range(tries):
            held = self.hold(cost, rows, side)
            value = self.A @ held.z
            over, under = value - self.high, self.low - value
            broken = np.maximum(over, under) > self.tolerance
            following = pivoting.exchanged(held.rows, held.side, held.wrong <= 0.0, broken, over=over, under=under)
            if following is None:
                return held
            rows, side = following
            if self.fixed[rows].any():
                return None
        return None

    def descend(self, cost: Cost, rows: Index, side: Vec, start: Vec) -> Held | None:
        """The minimum by a primal active set from where all rows hold, and these are at their bounds.

        In each step as far as the rows allow; the one that stops it is held from then on, and where nothing does, the
        one that pulls most is let go. More rows than there are unknowns may meet in one point, where that could go in
        circles: each bound is first put a little further out, by an amount of its own. None: too many changes.
        Source: Nocedal, Wright, Numerical Optimization, 16.5; Gill, Murray, Saunders, Wright, Math. Prog. 45, 1989.
        """
        given, value = (self.low, self.high), self.A @ start
        bound = np.where(side > 0.0, self.high[rows], self.low[rows])
        fits = ~self.fixed[rows] & (np.abs(value[rows] - bound) <= self.tolerance)
        rows, side = rows[fits], side[fits]
        out = self.tolerance * (0.1 + 0.1 * np.modf(_GOLDEN * np.arange(len(value)))[0])
        out[rows] = 0.0
        self.low, self.high = np.minimum(self.low, value) - out, np.maximum(self.high, value) + out
        held = self._descend(cost, rows, side, start)
        self.low, self.high = given
        if held is None:
            return None
        there = self.hold(cost, held.rows, held.side)
        return there if self.beyond(there.z) <= self.tolerance and there.wrong.max(initial=0.0) <= 0.0 else held

    def _descend(self, cost: Cost, rows: Index, side: Vec, z: Vec) -> Held | None:
        idle = self.fixed.copy()
        for _ in range(_MOST * len(self.low) + 1):
            held = self.hold(cost, rows, side)
            idle[rows] = True  # those that depend on others, too: nothing moves them either
            first, far, on = self._stops(z, held.z - z, idle)
            rows, side = held.rows, held.side
            if far < 1.0:
                z = z + far * (held.z - z)
                rows, side = np.append(rows, first), np.append(side, on)
                continue
            z = held.z
            if not len(rows) or held.wrong.max() <= 0.0:
                return held
            last = held.wrong.argmax()
            rows, side = np.delete(rows, last), np.delete(side, last)
            idle = self.fixed.copy()
        return None

    def beyond(self, z: Vec) -> float:
        """How far the worst row is beyond its bounds at z."""
        value = self.A @ z
        return float(np.maximum(value - self.high, self.low - value).max(initial=0.0))

    def _stops(self, z: Vec, step: Vec, idle: Mask) -> tuple[int, float, float]:
        """Which row, but for idle ones, stops the way from z along the step, after which share of it, on which side."""
        ahead, value = self.A @ step, self.A @ z
        idle = idle | (np.abs(ahead) <= _DEPENDENT * self.length * np.linalg.norm(step))
        if idle.all() or np.abs(step).max() <= _STILL * (1.0 + np.abs(z).max()):
            return 0, np.inf, 0.0
        ahead[idle] = 1.0
        room = np.where(ahead > 0.0, self.high - value, self.low - value) / ahead
        room[idle] = np.inf
        first = int(room.argmin())
        return first, max(0.0, float(room[first])), float(np.sign(ahead[first]))

    def hold(self, cost: Cost, rows: Index, side: Vec) -> Held:
        """The minimum with these rows held at their bounds, without those that depend on others.

        Everything is done in the coordinates Qᵀ z: W and c are turned there once, and the answer is turned back.
        """
        self.iterations += 1
        rank, turned = 0, cost.columns
        if len(rows):
            length = self.length[rows]
            qr, order, tau, _, _ = dgeqp3((self.A.take(rows, 0) / length[:, None]).T, overwrite_a=1)
            rank = rank_of(qr, _DEPENDENT)
            order = order[:rank] - 1
            rows, side, length = rows[order], side[order], length[order]
        if not rank:
            return Held(_least(cost, turned, 0, _NOTHING)[0], rows, side, _NOTHING, _NOTHING, rows)
        R, reflectors, tau, work = qr[:rank, :rank], qr[:, :rank], tau[:rank], 64 * turned.shape[1]
        turned = dormqr("L", "T", reflectors, tau, turned, work)[0]
        low, high = self.low[rows], self.high[rows]
        z, missing = _least(cost, turned, rank, dtrtrs(R, np.where(side > 0.0, high, low) / length, trans=1)[0])
        gradient = np.empty((rank, 2), order="F")
        np.dot(turned[:rank, :-1], missing, gradient[:, 0])
        away = cost.eps * (z - turned[:, -1])
        np.add(gradient[:, 0], away[:rank], gradient[:, 1])
        least, push = -dtrtrs(R, gradient)[0].T
        pull = cost.size * float(missing.dot(missing)) ** 0.5
        wrong = -push * side
        met = largest(missing) <= cost.enough
        wrong[(wrong <= _ROUNDING * (pull + float(away.dot(away)) ** 0.5)) | met | (low == high)] = 0.0
        z = dormqr("L", "N", reflectors, tau, z[:, None], work)[0][:, 0]
        return Held(z, rows, side, push / length, wrong, rows[np.abs(least) > _HOLDS * pull])


def largest(values: Vec) -> float:
    """The largest magnitude; argmax and argmin cost a fifth of max and min, and find a NaN first."""
    return max(float(values[values.argmax()]), -float(values[values.argmin()])) if len(values) else 0.0


def rank_of(qr: Mat, tolerance: float) -> int:
    """How many columns of unit length a QR with pivoting finds to be more than this from those before."""
    return int(np.count_nonzero(np.abs(qr.diagonal()) > tolerance))


def _least(cost: Cost, turned: Mat, rank: int, held: Vec) -> tuple[Vec, Vec]:
    """The minimum where the first ``rank`` coordinates are held, and W z + a there; ``turned`` is [Wᵀ c]."""
    W, z = turned[:, :-1].T, turned[:, -1].copy()
    z[:rank] = held
    if not len(cost.a):
        return z, cost.a
    missing = W @ z + cost.a
    if rank < len(z):
        U, size, V, _ = dgesdd(W[:, rank:], full_matrices=0)
        z[rank:] -= ((missing @ U) * (size / (size * size + cost.eps))) @ V
        missing = W @ z + cost.a
    return z, missing
