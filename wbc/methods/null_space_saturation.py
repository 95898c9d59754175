"""The largest part of a task that limits allow: saturation in the null space, as a loop and as a QP.

    J x + drift = s · target,   lower ≤ x ≤ upper,   0 ≤ s ≤ 1 as large as possible, then |x| as small as possible.

x is a velocity (target ẏ, no drift) or an acceleration (target ÿ, drift = J̇ v, which is there whatever the robot does
and so is never scaled). The direction of the task is kept, its size gives way.

*Closed form*, the loop of Flacco, De Luca and Khatib: the pseudo-inverse solution; while a joint is beyond its limit,
the one that limits the scale most is put there, and the others take over with what is left of the null space; when
nothing is left, the best scale met on the way. Printed with the exit condition "until limit exceeded", it must be until
*not* exceeded. It can end below the largest scale, and at scale one above the least norm.

*QP*: max s is a linear program, solved in proximal steps that are strictly convex,

    minimise ½ |x − x₀|² + ½ (σ − σ₀ − μ)²,   σ = s |target| seen through J#,

and for x₀ = σ₀ = 0 and μ beyond a finite value the answer is the largest scale *and* the least norm at once (a linear
penalty is exact; a quadratic one would be biased). μ is large enough when a second step from the answer gains nothing.

Flacco, De Luca, Khatib: Motion control of redundant robots under joint constraints: saturation in the null space, IEEE
ICRA 2012; Control of redundant robots under hard joint constraints: saturation in the null space, IEEE Transactions on
Robotics 31(3), 2015.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NoClosedForm
from wbc.methods.method import Method
from wbc.methods.scaling import Box, ScaledTask, largest_scale, unit_of
from wbc.methods.shared import box
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.types import Mat, Vec

#: Targets and drifts below this are zero: their squares are, and limits in such units would not be numbers.
NOTHING = 1e-150


@final
@dataclass(frozen=True, eq=False)
class Saturation:
    """x (n,), the scale in [0, 1], the joints at a limit, and whether any scale is feasible.

    ``optimal``: the scale is known to be the largest and x the shortest there is. Infeasible: x and scale are NaN.
    """

    x: Vec
    scale: float
    saturated: tuple[int, ...]
    feasible: bool
    optimal: bool


@final
@dataclass(frozen=True, eq=False)
class PrioritisedSaturation:
    """x (n,) of least norm, a scale per level (``None``: it admits none and is dropped), whether any level is kept."""

    x: Vec
    scales: tuple[float | None, ...]
    feasible: bool


@final
@dataclass(frozen=True, eq=False, init=False)
class NullSpaceSaturation(Method):
    """Largest scale of one task inside a box, then least norm.

    Args:
        J: Jacobian (m, n), of any rank.
        target: task velocity or acceleration (m,) [unit of the task / s, / s²].
        lower: lower limits of x (n,), a number for all, or −inf.
        upper: upper limits of x (n,), or inf.
        drift: what the task does on its own (m,), J̇ v at the acceleration level; never scaled.

    Raises:
        InvalidInput: shapes, NaN, crossed limits.

    Example:
        >>> from wbc.methods import NullSpaceSaturation
        >>> task = NullSpaceSaturation([[1.0, 1.0]], [4.0], lower=[-1, -1], upper=[1, 2])
        >>> print(round(task.closed_form().scale, 9), task.closed_form().x.round(9))
        0.75 [1. 2.]
    """

    J: Mat
    target: Vec
    lower: Vec
    upper: Vec
    drift: Vec

    def __init__(self, J: Any, target: Any, *, lower: Any, upper: Any, drift: Any = None) -> None:
        J, target, drift = _task("", J, target, drift)
        low, high = box(J.shape[1], lower=lower, upper=upper)
        for name, value in {"J": J, "target": target, "lower": low, "upper": high, "drift": drift}.items():
            object.__setattr__(self, name, value)

    @classmethod
    def prioritised(cls, tasks: Sequence[tuple[Any, ...]], *, lower: Any, upper: Any) -> PrioritisedTasks:
        """Several tasks (J, target) or (J, target, drift), the first above all others, each with its own scale.

        Raises:
            InvalidInput: as the class, naming the task.

        Example:
            >>> both = NullSpaceSaturation.prioritised([([[1, 0]], [4]), ([[0, 1]], [1])], lower=[-1, -1], upper=[2, 2])
            >>> [round(scale, 9) for scale in both.solve("daqp").scales]
            [0.5, 1.0]
        """
        return PrioritisedTasks(tasks, lower=lower, upper=upper)

    # ---- closed form
    def closed_form(self) -> Saturation:
        """The loop. Ties between joints go to the first; ``optimal`` where no joint had to be saturated."""
        task, limits = ScaledTask(self.J, self.target, self.drift), Box(self.lower, self.upper)
        if task.low > task.high:
            return self._infeasible(optimal=True)
        free, held = np.ones(limits.size, dtype=bool), np.zeros(limits.size)
        best, x_best = -np.inf, held
        while np.linalg.matrix_rank(task.V * free, tol=1e-9) == len(task.V):
            inverse = np.linalg.pinv(task.V * free, rcond=1e-9)
            rate, start = inverse @ task.direction, held + inverse @ (-task.drift - task.V @ held)
            whole = start + task.high * rate
            beyond = free & limits.exceeded(whole)
            if not beyond.any():
                return self._result(whole, task.high, task, optimal=bool(free.all()) and task.high == task.full)
            lowest, highest = limits.scales(start, rate)
            low, high = max(task.low, lowest.max()), min(task.high, highest.min())
            if best < high and low <= high:
                best, x_best = high, start + high * rate
            first = int(np.where(beyond, np.where(lowest > task.high, -np.inf, highest), np.inf).argmin())
            held[first] = self.upper[first] if whole[first] > self.upper[first] else self.lower[first]
            free[first] = False
        return self._infeasible(optimal=False) if best == -np.inf else self._result(x_best, best, task, optimal=False)

    def _result(self, x: Vec, size: float, task: ScaledTask, *, optimal: bool) -> Saturation:
        at_limit = Box(self.lower, self.upper).reached(x)
        scale = min(1.0, max(0.0, size / task.full))
        return Saturation(x, scale, tuple(int(i) for i in at_limit.nonzero()[0]), True, optimal)

    def _infeasible(self, *, optimal: bool) -> Saturation:
        return Saturation(np.full(len(self.lower), np.nan), np.nan, (), False, optimal)

    # ---- QP
    def qp(self) -> QP:
        """Scale and least norm at once, in (x, s) (n + 1,): minimise ½ |x|² + ½ (T s − (1 + μ) T)² subject to

        J x − target s = −drift (m rows),  lower ≤ x ≤ upper,  0 ≤ s ≤ 1; T = |J# target| makes s a size of x. μ = 100
        is enough nearly always; :meth:`solve` makes sure.
        """
        n, full = self.J.shape[1], ScaledTask(self.J, self.target, self.drift).full
        H, g = np.eye(n + 1), np.zeros(n + 1)
        H[n, n], g[n] = full**2, -101.0 * full**2
        return QP(
            H, g, A=np.column_stack([self.J, -self.target]), b=-self.drift,
            lb=np.append(self.lower, 0.0), ub=np.append(self.upper, 1.0),
            rows=[
                *(Row("task", f"row {i}") for i in range(len(self.J))),
                *(Row("limits", f"joint {i}") for i in range(n)), Row("scale", "s"),
            ],
        )  # fmt: skip

    def solve(self, solver: str | Solver = "pdas") -> Saturation:
        """The largest scale, then the least norm.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        task = ScaledTask(self.J, self.target, self.drift)
        n = len(self.lower)
        found = largest_scale(task, Box(self.lower, self.upper), solver, (np.zeros((0, n)), np.zeros(0)))
        return (
            self._result(found.x, found.size, task, optimal=True) if found.feasible else self._infeasible(optimal=True)
        )

    def difference(self, result: Saturation, reference: Saturation) -> Mapping[str, float]:
        """Scales in [0, 1], residuals and norms relative to |x|, limits relative to themselves.

        The loop need not reach the largest scale, so a result is only held to what the reference is known to be: no
        worse where that is not optimal, equal where it is, and the same x where the whole task is done.
        """
        if not result.feasible:
            return {"feasible": np.inf if reference.feasible else 0.0}
        if not reference.feasible:
            return {"feasible": np.inf if reference.optimal else 0.0}
        task, limits = ScaledTask(self.J, self.target, self.drift), Box(self.lower, self.upper)
        size = max(float(np.linalg.norm(result.x)), float(np.linalg.norm(reference.x)), 1e-3 * unit_of(task, limits))
        range_ = np.where(limits.range > 0.0, limits.range, size)
        over = np.maximum(result.x - self.upper, self.lower - result.x) / range_
        missing = task.V @ result.x + task.drift - result.scale * task.full * task.direction
        less, longer = (
            reference.scale - result.scale, float(np.linalg.norm(result.x) - np.linalg.norm(reference.x)) / size,
        )  # fmt: skip
        both = result.optimal and reference.optimal
        found = {
            "scale": abs(less) if both else max(0.0, less),
            "task": float(np.linalg.norm(missing)) / size,
            "limits": max(0.0, float(over.max(initial=0.0))),
        }
        if abs(less) * task.full <= 1e-8 * size:
            found["norm"] = abs(longer) if both else max(0.0, longer)
        if both and min(result.scale, reference.scale) >= 1.0:
            found["x"] = float(np.linalg.norm(result.x - reference.x)) / size
        return found


@final
class PrioritisedTasks(Method):
    """What :meth:`NullSpaceSaturation.prioritised` makes."""

    def __init__(self, tasks: Sequence[tuple[Any, ...]], *, lower: Any, upper: Any) -> None:
        if not tasks:
            raise InvalidInput("tasks is empty; give at least one (J, target)")
        for i, entry in enumerate(tasks):
            if not isinstance(entry, tuple | list) or len(entry) not in (2, 3):
                raise InvalidInput(f"tasks[{i}] is {entry!r}; it must be (J, target) or (J, target, drift)")
        named = [_task(f"tasks[{i}].", *entry) for i, entry in enumerate(tasks)]
        n = named[0][0].shape[1]
        for i, (J, _, _) in enumerate(named):
            if J.shape[1] != n:
                raise InvalidInput(f"tasks[{i}].J has {J.shape[1]} columns, tasks[0].J has {n}")
        self.tasks = tuple(named)
        self.lower, self.upper = box(n, lower=lower, upper=upper)

    def closed_form(self) -> PrioritisedSaturation:
        raise NoClosedForm("several scaled tasks have no closed form; use solve")

    def qp(self) -> QP:
        """The QP of the first level alone; those below it depend on its answer."""
        J, target, drift = self.tasks[0]
        return NullSpaceSaturation(J, target, lower=self.lower, upper=self.upper, drift=drift).qp()

    def solve(self, solver: str | Solver = "pdas") -> PrioritisedSaturation:
        """Level by level: the largest scale with those above kept; at the end the least norm.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        limits = Box(self.lower, self.upper)
        rows, right = np.zeros((0, limits.size)), np.zeros(0)
        x, scales = np.full(limits.size, np.nan), list[float | None]()
        for entry in self.tasks:
            task = ScaledTask(*entry)
            found = largest_scale(task, limits, solver, (rows, right))
            if not found.feasible:
                scales.append(None)
                continue
            x = found.x
            scales.append(min(1.0, max(0.0, found.size / task.full)))
            rows = np.vstack([rows, task.V])
            right = np.append(right, found.size * task.direction - task.drift)
        return PrioritisedSaturation(x, tuple(scales), any(scale is not None for scale in scales))

    def difference(self, result: PrioritisedSaturation, reference: PrioritisedSaturation) -> Mapping[str, float]:
        """Scales level by level, and norms."""
        if [s is None for s in result.scales] != [s is None for s in reference.scales]:
            return {"feasible": np.inf}
        pairs = [
            (a, b) for a, b in zip(result.scales, reference.scales, strict=True) if a is not None and b is not None
        ]
        found = {"scale": max((abs(a - b) for a, b in pairs), default=0.0)}
        if result.feasible:
            sizes = np.linalg.norm(result.x), np.linalg.norm(reference.x)
            found["norm"] = float(abs(sizes[0] - sizes[1]) / (max(sizes) or 1.0))
        return found


def _task(prefix: str, J: Any, target: Any, drift: Any = None) -> tuple[Mat, Vec, Vec]:
    """J (m, n), target (m,) and drift (m,), checked; ``prefix`` says which task it is."""
    J = checks.array(f"{prefix}J", J, (None, None))
    target = checks.array(f"{prefix}target", target, (len(J),))
    drift = np.zeros(len(J)) if drift is None else checks.array(f"{prefix}drift", drift, (len(J),))
    return J, np.where(np.abs(target) < NOTHING, 0.0, target), np.where(np.abs(drift) < NOTHING, 0.0, drift)
