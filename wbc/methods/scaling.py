"""Largest scales of tasks inside a box: tasks with independent rows, and proximal steps that any solver can take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.methods.least_distance import nearest
from wbc.methods.shared import answered, factors
from wbc.qp.problem import QP
from wbc.qp.solver import Solver
from wbc.types import Mat, Vec

#: Limits that must give way by more than this part of their size cannot be met.
SAME = 5e-9
#: A part of a target or drift, relative to the whole, that counts as out of the range of J.
OUT_OF_RANGE = 1e-9


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

    def exceeded(self, x: Vec) -> Vec:
        """Joints beyond a limit."""
        rounding = 1e-12 * np.maximum(self.range, np.abs(x))
        result: Vec = (x > self.upper + rounding) | (x < self.lower - rounding)
        return result

    def reached(self, x: Vec) -> Vec:
        """Joints at a limit."""
        rounding = 1e-7 * self.range
        result: Vec = (x >= self.upper - rounding) | (x <= self.lower + rounding)
        return result

    def scales(self, start: Vec, rate: Vec) -> tuple[Vec, Vec]:
        """Smallest and largest σ with start + σ rate inside, joint by joint (n,); crossed where there is none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort([(self.lower - start) / rate, (self.upper - start) / rate], axis=0)
        still, outside = rate == 0.0, self.exceeded(start)
        low, high = np.where(still, -np.inf, ends[0]), np.where(still, np.inf, ends[1])
        return np.where(still & outside, np.inf, low), np.where(still & outside, -np.inf, high)


@final
@dataclass(frozen=True)
class Scaled:
    """x (n,) of least norm at the largest σ; NaN where there is none."""

    x: Vec
    size: float
    feasible: bool


def largest_scale(
    task: ScaledTask, box: Box, solver: str | Solver, *, rows: Mat | None = None, right: Vec | None = None
) -> Scaled:
    """Largest σ, then least norm, of one task inside the box, with other rows (k, n) kept at ``right``.

    Raises:
        SolverFailed: the solver ended without an answer.
    """
    if task.low <= task.high:
        steps = _ProximalSteps(task, box, solver, rows, right)
        for push in (1e1, 1e2, 1e3, 1e4, 1e5, 1e6):
            found = steps.from_zero(push)
            if found is None:
                break
            sharper = steps.onwards(found, push)
            if sharper is None or sharper.size <= found.size + 1e-7 * push * steps.unit:
                return sharper or found
    return Scaled(np.full(box.size, np.nan), np.nan, False)


@final
class _ProximalSteps:
    """Points (x, σ) of V x − σ direction = −drift, σ in [low, high], x in the box, nearest to others.

    Every limit gives way by the same part w ≥ 0 of its size, at a price above its multiplier: a solver then has an
    interior and an answer, also where one point or none is feasible, and w tells.
    """

    def __init__(self, task: ScaledTask, box: Box, solver: str | Solver, rows: Mat | None, right: Vec | None) -> None:
        self.task, self.box, self.solver = task, box, solver
        n = box.size
        rows = np.zeros((0, n)) if rows is None else rows
        self.right = np.append(np.zeros(0) if right is None else right, -task.drift)
        self.equal = np.vstack([
            np.column_stack([rows, np.zeros((len(rows), 2))]),
            np.column_stack([task.V, -task.direction, np.zeros(len(task.V))]),
        ])  # fmt: skip
        self.unit = self._unit()
        self.give = np.minimum(box.range, self.unit)
        self.give[self.give == 0.0] = self.unit

    def _unit(self) -> float:
        """A size of x to start with: no σ is larger than what the box reaches along the task."""
        task, box = self.task, self.box
        along = task.V.T @ task.direction
        with np.errstate(invalid="ignore"):
            ends = np.array([along * box.lower, along * box.upper])
        reach = float(np.where(along == 0.0, 0.0, ends.max(axis=0)).sum() + task.direction @ task.drift)
        drift = float(np.linalg.norm(self.right))
        return (max(0.0, min(task.high, reach)) + drift) or task.full

    def from_zero(self, push: float) -> Scaled | None:
        """The answer, if this push is enough; ``None`` where limits cannot be met."""
        centre, before = np.zeros(self.box.size + 1), np.inf
        for price in (1e1, 1e3, 1e5, 1e7):
            found, w = self._nearest(centre, push, price * push)
            if w <= SAME:
                return found
            if w > 0.5 * before:
                return None
            before = w
        return None

    def onwards(self, found: Scaled, push: float) -> Scaled | None:
        """A small step on from there: distances are smaller, and so is what a solver leaves of them."""
        better, w = self._nearest(np.append(found.x, found.size), 1e-3 * push, 1e-2 * push)
        return better if w <= SAME else None

    def _nearest(self, centre: Vec, push: float, price: float) -> tuple[Scaled, float]:
        """The point nearest to ``centre`` pushed towards larger σ, and w; both pushes in units of x."""
        n, unit, box, task = self.box.size, self.unit, self.box, self.task
        none = np.full(n, np.inf)
        limited = np.eye(n, n + 1)
        qp = QP(
            np.eye(n + 2), np.zeros(n + 2), A=self.equal, b=self.right,
            C=np.vstack([np.column_stack([limited, -self.give]), np.column_stack([limited, self.give])]),
            cl=np.append(-none, box.lower), cu=np.append(box.upper, none),
            lb=np.concatenate([-none, [task.low, 0.0]]), ub=np.concatenate([none, [task.high, np.inf]]),
        )  # fmt: skip
        towards = np.append(centre, -price)
        towards[n] += push * unit
        root = np.diag(np.append(np.full(n + 1, unit), 1.0))
        x = answered(nearest(qp, towards, root, self.solver), self.solver).x
        return Scaled(x[:n], float(x[n]), True), float(x[n + 1])
