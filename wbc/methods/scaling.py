"""Largest scales of tasks inside a box: tasks with independent rows, and proximal steps that any solver can take."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from wbc.errors import SolverFailed
from wbc.methods.projection import projection
from wbc.methods.shared import factors
from wbc.qp.conflict import least_violation
from wbc.qp.solver import Solver
from wbc.types import Mat, Vec

Mask = NDArray[np.bool_]

#: Limits that must give way by more than this part of their size cannot be met; a w below the second number may be
#: what a solver left of a large distance.
SAME, NEARLY = 5e-9, 1e-5
#: A part of a target or drift, relative to the whole, that counts as out of the range of J.
OUT_OF_RANGE = 1e-9
#: Pushes towards larger scales, in units of x: nine tasks in ten need the first or second.
PUSHES = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6)
#: Prices of limits, in units of the push, and what a step gains, in units of x, when there is nothing to gain.
PRICES = (1e1, 1e2, 1e3, 1e4)
GAIN, ROUNDING = 1e-10, 1e-12
#: The push of a step that only takes away what solvers leave of larger ones.
SMALL = 1e-3
#: What equations leave of a limit of unit length: less than the first and they settle it, less than the second and it
#: gives way by that, so that rounding in it stays rounding in the others.
SETTLED, ACUTE = 1e-9, 1e-6
#: Changes of the unit of x before the best so far is the answer.
ROUNDS = 4


@final
class ScaledTask:
    """J x + drift = s · target with independent rows: V x + drift = σ · direction, σ in [low, high].

    V (r, n) has orthonormal rows, ``direction`` unit length, and σ = ``full`` means s = 1: it is the length of the
    shortest x that does the whole task. ``drift`` is (r,) here. What J cannot reach asks for one scale or for none
    (low > high).
    """

    def __init__(self, J: Mat, target: Vec, drift: Vec) -> None:
        found = factors(J)
        self.V = found.V
        self.drift = found.solve(drift)
        size = float(np.linalg.norm(found.solve(target)))
        self.full = size or 1.0
        self.direction: Vec = found.solve(target) / self.full
        missing, off = found.rest.T @ target, found.rest.T @ drift
        missing[np.abs(missing) <= OUT_OF_RANGE * np.linalg.norm(target)] = 0.0
        off[np.abs(off) <= OUT_OF_RANGE * np.linalg.norm(drift)] = 0.0
        low, high = 0.0, 1.0
        if missing.any() or off.any():
            low = high = float(missing @ off / (missing @ missing)) if missing.any() else np.nan
            reached = np.linalg.norm(high * missing - off) <= OUT_OF_RANGE * np.linalg.norm(drift)
            low, high = (low, high) if reached and 0.0 <= low <= 1.0 else (1.0, 0.0)
        self.low, self.high = self.full * low, self.full * high


@final
class Box:
    """lower ≤ x ≤ upper, with what rounding means in it."""

    def __init__(self, lower: Vec, upper: Vec) -> None:
        self.lower, self.upper = lower, upper
        self.size = len(lower)
        known = np.abs([lower, upper])
        self.range: Vec = np.where(np.isfinite(known), known, 0.0).max(axis=0, initial=0.0)

    def exceeded(self, x: Vec) -> Mask:
        """Joints beyond a limit."""
        rounding = 1e-12 * np.maximum(self.range, np.abs(x))
        return (x > self.upper + rounding) | (x < self.lower - rounding)

    def reached(self, x: Vec) -> Mask:
        """Joints at a limit."""
        rounding = 1e-7 * self.range
        return (x >= self.upper - rounding) | (x <= self.lower + rounding)

    def scales(self, start: Vec, rate: Vec) -> tuple[Vec, Vec]:
        """Smallest and largest σ with start + σ rate inside, joint by joint (n,); crossed where there is none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort([(self.lower - start) / rate, (self.upper - start) / rate], axis=0)
        still, outside = rate == 0.0, self.exceeded(start)
        low, high = np.where(still, -np.inf, ends[0]), np.where(still, np.inf, ends[1])
        return np.where(still & outside, np.inf, low), np.where(still & outside, -np.inf, high)


def unit_of(task: ScaledTask, box: Box) -> float:
    """A size of x, about as large as the answer: no σ is larger than what the box reaches along the task."""
    along = task.V.T @ task.direction
    with np.errstate(invalid="ignore"):
        ends = np.array([along * box.lower, along * box.upper]).max(axis=0)
    reach = float(np.where(along == 0.0, 0.0, ends).sum() + task.direction @ task.drift)
    return (max(0.0, min(task.high, reach)) + float(np.linalg.norm(task.drift))) or task.full


@final
@dataclass(frozen=True)
class Scaled:
    """x (n,) of least norm at the largest σ; NaN where there is none."""

    x: Vec
    size: float
    feasible: bool


def largest_scale(task: ScaledTask, box: Box, solver: str | Solver, kept: tuple[Mat, Vec]) -> Scaled:
    """Largest σ, then least norm, of one task inside the box, with other rows ``kept``: (A (k, n), b (k,)), A x = b.

    Raises:
        SolverFailed: the solver ended without an answer.
    """
    none = Scaled(np.full(box.size, np.nan), np.nan, False)
    if task.low > task.high:
        return none
    offset = max(float(np.linalg.norm(kept[1])), float(np.linalg.norm(task.drift)))
    unit = unit_of(task, box) + offset
    found = none
    for _ in range(ROUNDS):
        found = _largest(_ProximalSteps(task, box, solver, kept=kept, unit=unit))
        if not found.feasible:
            return none
        size = max(float(np.linalg.norm(found.x)), found.size, offset)
        if size >= 0.1 * unit:
            break
        unit = max(size, 1e-6 * unit)  # the box was much larger than the answer: once more in units that fit
    if abs(found.size - task.high) <= ROUNDING * max(float(np.linalg.norm(found.x)), task.high):
        found = replace(found, size=task.high)
    return found


def _largest(steps: _ProximalSteps) -> Scaled:
    """From zero with larger and larger pushes, until a step from the answer gains nothing; at the end a small step."""
    found = steps.from_zero(PUSHES[0])
    for push in PUSHES[1:]:
        if not found.feasible or steps.onwards(found, push).size <= found.size + GAIN * steps.unit:
            break
        found = steps.from_zero(push)
    return steps.onwards(found, SMALL) if found.feasible else found


@final
class _ProximalSteps:
    """Points (x, σ) of V x − σ direction = −drift, σ in [low, high], x in the box, nearest to others.

    Every limit gives way by w ≥ 0, measured along the motions that the equations leave, at a price above its
    multiplier: a solver then has an interior and an answer, also where one point is feasible. Unknowns (x, σ, w), x and
    σ in units of their own. A limit that is nearly parallel to the equations gives way by little: its ``slope`` is the
    length of what they leave of it.

    ``inside``: the point that violates limits least; not feasible where that is more than counts as met, which is a
    proof (:func:`wbc.qp.conflict.least_violation`) and no solver's word.
    """

    def __init__(self, task: ScaledTask, box: Box, solver: str | Solver, *, kept: tuple[Mat, Vec], unit: float) -> None:
        (rows, right), n, self.unit = kept, box.size, unit
        self.solver = solver
        right = np.append(right, -task.drift) / self.unit
        equal = np.column_stack([np.vstack([rows, task.V]), np.zeros(len(right)), np.zeros(len(right))])
        equal[len(rows) :, n] = -task.direction
        self.equal, self.factors = (equal, right), factors(equal)
        missing = self.factors.rest.T @ right
        consistent = float(np.linalg.norm(missing)) <= OUT_OF_RANGE * float(np.linalg.norm(right))
        self.size = np.append(np.where(box.range > 0.0, np.clip(box.range / unit, 1e-2, 1.0), 1.0), 1.0)
        self.low = np.append(box.lower, task.low) / self.unit
        self.high = np.append(box.upper, task.high) / self.unit
        without_w = factors(equal[:, :-1])
        slope = np.linalg.norm(without_w.null, axis=0)
        self.slope, self.settled = np.maximum(slope, ACUTE), slope <= SETTLED
        at = without_w.inverse(right)
        free = np.where(self.settled, 0.0, without_w.null).T
        point = at + free @ least_violation(free, self.low - at, self.high - at)[0]
        inside = Scaled(unit * point[:-1], unit * float(point[-1]), True)
        self.inside = replace(inside, feasible=consistent and self._within(inside))
        #: The w that no price takes away. Above it a w that stays the same may still be what a limit of σ holds.
        self.least = (1.0 + 1e-6) * self._way(point)

    def from_zero(self, push: float) -> Scaled:
        """The answer, if this push is enough; not feasible where no point is within the limits."""
        if not self.inside.feasible:
            return self.inside
        found = self._priced(Scaled(np.zeros(len(self.low) - 1), 0.0, True), push)
        return found if self._within(found) else self.inside

    def _within(self, found: Scaled) -> bool:
        """Whether no limit gives way by more than counts as met."""
        point = np.append(found.x, found.size) / self.unit
        return float((self._beyond(point) / self.size).max()) <= SAME

    def _priced(self, centre: Scaled, push: float) -> Scaled:
        """The nearest point at a price that leaves no w, or at the highest: a little w may buy much σ.

        At a higher price limits meet at more acute angles; where that is too much for the solver, a w that counts as
        none is left.
        """
        found = centre
        for price in PRICES:
            try:
                found, w = self._nearest(centre, push, price)
                if ROUNDING < w <= NEARLY:
                    found, w = self._nearest(found, SMALL, price)
            except SolverFailed:
                if not self._within(found):
                    raise
                break
            if w <= max(ROUNDING, self.least):
                break
        return found

    def onwards(self, found: Scaled, push: float) -> Scaled:
        """One more step from a point within the limits; that point where no price keeps them from giving way."""
        further = self._priced(found, push)
        return further if self._within(further) else found

    def _nearest(self, centre: Scaled, push: float, price: float) -> tuple[Scaled, float]:
        """The point nearest to ``centre`` pushed towards larger σ, and w, which costs ``price`` times what σ gains.

        Not a long push of w but its unit makes the price, so that no distance is large: it is w · price that is
        pushed, as much as σ is.
        """
        start = np.append(centre.x, centre.size) / self.unit
        towards = np.append(start, -push)
        towards[-2] += push
        (rows, low, high), units = self._limits(), np.append(np.ones(len(start)), 1.0 / price)
        x = projection(towards, self.equal, (rows * units, low, high), self._met(start) / units, self.solver)
        return Scaled(self.unit * x[:-2], self.unit * float(x[-2]), True), self._way(x[:-1])

    def _limits(self) -> tuple[Mat, Vec, Vec]:
        """Rows of (x, σ, w), their lower and their upper ends; not those that the equations settle."""
        n, way = len(self.low), self.slope[:, None]
        one, none = np.eye(n), np.full(n, np.inf)
        low, high = np.where(self.settled, -np.inf, self.low), np.where(self.settled, np.inf, self.high)
        return (
            np.block([[one, -way], [one, way], [np.zeros((1, n)), np.ones((1, 1))]]),
            np.concatenate([-none, low, [0.0]]), np.concatenate([high, none, [np.inf]]),
        )  # fmt: skip

    def _met(self, start: Vec) -> Vec:
        """The point on the equations nearest to this one, with the w that it takes there."""
        (equal, right), point = self.equal, np.append(start, 0.0)
        point += self.factors.inverse(right - equal @ point)
        point[-1] = self._way(point[:-1])
        return point

    def _way(self, point: Vec) -> float:
        """The w at which all limits give way enough for this (x, σ)."""
        return float(np.where(self.settled, 0.0, self._beyond(point) / self.slope).max())

    def _beyond(self, point: Vec) -> Vec:
        """By how much (x, σ) is beyond its limits (n + 1,)."""
        return np.maximum(0.0, np.maximum(point - self.high, self.low - point))
