"""The farthest point of a polyhedron in one direction and, where there are several, the shortest: a finite method.

    maximise cᵀ u, then minimise |u|²   subject to   lower ≤ start + F u ≤ upper,   cᵀ u bounded there.

Both at once are  minimise ½ |u|² − μ cᵀ u  subject to G u ≤ h, G = [F; −F],  for every μ above some number
(Mangasarian). The dual active-set method of Goldfarb and Idnani solves that. It keeps a set A of rows held as
equations, with multipliers y ≥ 0, and its point is the optimum of these rows alone:

    u = μ c − G_Aᵀ y,   G_A u = h_A.

Each step takes a violated row p. With n = G_pᵀ, r = G_A#ᵀ n and the rest d = n − G_Aᵀ r, the multiplier of p grows by
t, those of A change by −t r, and the violation shrinks by t |d|². The first event ends the step: p is met and joins A,
or a multiplier is zero and its row leaves. If d = 0 and no multiplier shrinks, −r ≥ 0 combines the rows of A and p to a
contradiction, 0 ≤ −(violation): the multipliers prove that there is no point. The cost of the optimum grows with each
row that joins, so no set A comes twice and the method ends, whatever ties there are.

No step multiplies two quantities that depend on μ. They are therefore pairs (a, b) = a μ + b, compared by a first and
then by b: μ is larger than every number, and no value of it has to be guessed. At the end a = 0 for all of u.

Rounding is judged relative to the problem: rows of F are no longer than one, so d is known to a part of 1 + Σ|r| and a
violation to a part of the lengths in it. Quantities within that of each other tie. The optimum is unique, so the order
of steps, and with it the rounding of another processor, changes its last bits only.

Mangasarian: Normal solutions of linear programs, Mathematical Programming Study 22, 1984. Goldfarb, Idnani: A
numerically stable dual method for solving strictly convex quadratic programs, Mathematical Programming 27, 1983.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.linalg import solve_triangular

from wbc.methods.shared import SMALL, largest_known
from wbc.tolerances import NOISE, ROUNDING, SHARP
from wbc.types import Mat, Vec

#: The part of their size by which limits may be relaxed where together they leave no point.
WIDENED = 0.5 * SHARP


@final
@dataclass(frozen=True, eq=False)
class Farthest:
    """The point u (k,), its values start + F u (m,), and how rows push on it when the push along the slope is μ.

    ``push`` is the least μ from which u is the optimum. ``lower`` and ``upper`` (m,) are those given, but for limits
    that contradict each other by no more than rounding.
    """

    u: Vec
    values: Vec
    lower: Vec
    upper: Vec
    push: float
    pushes: Mat

    def multipliers(self, push: float) -> Vec:
        """Multipliers (m,) of the rows at this μ, positive at an upper limit: u − μ slope + Fᵀ multipliers = 0."""
        return np.asarray(push * self.pushes[:, 0] + self.pushes[:, 1])


def farthest(start: Vec, F: Mat, lower: Vec, upper: Vec, slope: Vec, *, terms: float = 0.0) -> Farthest | None:
    """The u (k,) of largest ``slope`` · u, then of least norm, with lower ≤ start + F u ≤ upper.

    Neither rows of F (m, k) nor ``slope`` (k,) are longer than one. Some limit must end every way along which
    ``slope`` · u grows. ``terms`` is the size of the numbers that ``start`` is a sum of, where they are larger: it is
    known to their rounding. ``None``: multipliers prove that there is no such u.
    """
    search, m = _Search((start, max(terms, float(np.linalg.norm(start)))), F, (lower, upper), slope), len(start)
    while (row := search.violated()) is not None:
        if not search.joined(row):
            return None
    pushes, low, high, values = np.zeros((2 * m, 2)), -search.limit[m:], search.limit[:m], search.z[:, 1].copy()
    pushes[search.held] = search.y
    for row in search.held:
        values[row % m] = high[row] if row < m else low[row - m]
    growing = search.y[:, 0] > 0.0
    push = float((-search.y[growing, 1] / search.y[growing, 0]).max(initial=0.0))
    return Farthest(search.u[:, 1], values, low, high, push, pushes[:m] - pushes[m:])


@final
class _Search:
    """Rows that are held, of z = start + F u and the cost ½ |u|² − μ slope · u, and the steps that change them."""

    def __init__(self, start: tuple[Vec, float], F: Mat, limits: tuple[Vec, Vec], slope: Vec) -> None:
        (self.start, self.terms), self.F, self.slope = start, F, slope
        self.G = np.concatenate([F, -F])
        self.limit = np.concatenate([limits[1], -limits[0]])
        self.held: list[int] = []
        self._hold()

    # ---- what follows from the rows held
    def _hold(self) -> None:
        """Point and multipliers of the rows held, as pairs: u (k, 2), z (n, 2), y (q, 2)."""
        N, b = self.G[self.held], self._room()[self.held]
        self.Q, self.R = np.linalg.qr(N.T)
        y = np.column_stack([self._coefficients(self.slope), self._coefficients(self._from_values(-b))])
        along, _ = self._rest(self.slope)
        self.y = _settled(y)
        self.u = np.column_stack([along, self._from_values(b)])
        self.z = self.F @ self.u
        self.z[:, 1] += self.start
        self.length = float(np.hypot(np.linalg.norm(self.u[:, 1]), self.terms))

    def _room(self) -> Vec:
        """h (2 n,): how far each limit is from ``start``."""
        return np.asarray(self.limit - np.concatenate([self.start, -self.start]))

    def _from_values(self, b: Vec) -> Vec:
        """G_A# b (k,)."""
        return np.asarray(self.Q @ solve_triangular(self.R, b, trans="T") if self.held else np.zeros(len(self.slope)))

    def _coefficients(self, n: Vec) -> Vec:
        """r = G_A#ᵀ n (q,)."""
        return np.asarray(solve_triangular(self.R, self.Q.T @ n) if self.held else np.zeros(0))

    def _rest(self, n: Vec) -> tuple[Vec, Vec]:
        """d = n − G_Aᵀ r, zero where it is rounding, and r."""
        r, d = self._coefficients(n), n - self.Q @ (self.Q.T @ n)
        d -= self.Q @ (self.Q.T @ d)
        if np.linalg.norm(d) <= ROUNDING * (1.0 + np.abs(r).sum()):
            d = np.zeros_like(d)
        return d, r

    # ---- steps
    def violated(self) -> int | None:
        """The row that is violated most; ``None`` where none is."""
        growth, at = self.G @ self.u[:, 0], np.concatenate([self.z[:, 1], -self.z[:, 1]])
        finite = np.isfinite(self.limit)
        finite[self.held] = False
        if self.u[:, 0].any():
            return int(np.where(finite, growth, -np.inf).argmax())
        limit = np.where(finite, self.limit, 0.0)
        beyond = np.where(finite, at - limit - NOISE * (self.length + np.abs(limit)), -1.0)
        row = int(beyond.argmax()) if len(beyond) else 0
        return row if len(beyond) and beyond[row] > 0.0 else None

    def joined(self, row: int) -> bool:
        """Whether the row could be met: it joins the set, or is violated by what is rounding."""
        normal, before = self.G[row], list(self.held)
        violation = np.array([normal @ self.u[:, 0], normal @ self.u[:, 1] - self._room()[row]])
        while True:
            rest, r = self._rest(normal)
            event = self._first(r, violation, float(rest @ rest))
            if event is None:
                return self._relax(row, r, violation[1], before)
            step, place = event
            if place is None:
                self.held.append(row)
                self._hold()
                return True
            self.y = _settled(np.delete(self.y - np.outer(r, step), place, axis=0))
            violation = violation - float(rest @ rest) * step
            self.held.pop(place)
            self.Q, self.R = np.linalg.qr(self.G[self.held].T)

    def _first(self, r: Vec, violation: Vec, square: float) -> tuple[Vec, int | None] | None:
        """The first event as the multiplier of the new row grows; ``None`` where there is none.

        Its step, a pair, and the place whose multiplier is zero then, or (``None``) the row is met.
        """
        shrinks = (r > ROUNDING * (1.0 + np.abs(r).sum())).nonzero()[0]
        places: list[int | None] = [*(int(i) for i in shrinks)]
        steps, rates = self.y[shrinks], r[shrinks]
        if square:
            places, steps, rates = [*places, None], np.vstack([steps, violation]), np.append(rates, square)
        if not places:
            return None
        ends = steps / rates[:, None]
        known = ends[:, 0] + ROUNDING * (1.0 + np.abs(self.y[:, 0]).sum()) / rates
        ties = ends[:, 0] - ROUNDING * (1.0 + np.abs(self.y[:, 0]).sum()) / rates <= known.min()
        first = int(np.where(ties, ends[:, 1], np.inf).argmin())
        return ends[first], places[first]

    def _relax(self, row: int, r: Vec, violation: float, before: list[int]) -> bool:
        """Rows that contradict each other are relaxed by equal parts of their sizes, if these are small enough.

        The set is then the one ``before`` the step.
        """
        rows = [row, *self.held]
        weight = np.append(1.0, np.abs(r))
        n = len(self.start)
        known = largest_known(*self.limit.reshape(2, n))
        size = np.maximum(np.tile(known, 2)[rows], SMALL * self.length)
        part = violation / float(weight @ size) if size.any() else np.inf
        if part > WIDENED:
            return False
        self.limit[rows] += part * size * (weight > 0.0) + np.spacing(self.length + np.abs(self.limit[rows]))
        self.held = before
        self._hold()
        return True


def _settled(y: Mat) -> Mat:
    """Multipliers as pairs, zero where what depends on μ is rounding, and not negative."""
    fixed = np.abs(y[:, 0]) <= ROUNDING * (1.0 + np.abs(y[:, 0]).sum())
    return np.column_stack([np.where(fixed, 0.0, y[:, 0]), np.where(fixed, np.maximum(y[:, 1], 0.0), y[:, 1])])
