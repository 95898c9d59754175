"""The largest part of a task that limits allow: saturation in the null space, as a finite method and as a QP.

    J x + drift = s · target,   lower ≤ x ≤ upper,   0 ≤ s ≤ 1 as large as possible, then |x| as small as possible.

x is a velocity (target ẏ, no drift) or an acceleration (target ÿ, drift = J̇ v, which is there whatever the robot does
and so is never scaled). The direction of the task is kept, its size is reduced.

*Closed form*: the dual active-set method of :mod:`wbc.methods.farthest` on (x, σ), σ = T s with T = |J# target|. It
ends after finitely many steps with the largest scale and the shortest x. (The loop of Flacco, De Luca and Khatib puts
one joint at its limit after another and takes none away, so it can end below the largest scale.)

*QP*: max s is a linear program. For every μ above some number

    minimise ½ |x|² + ½ (σ − μ)²   subject to   J x + drift = σ target / T,  lower ≤ x ≤ upper,  0 ≤ σ ≤ T

has the largest scale *and* the least norm (a linear penalty is exact; a quadratic one would be biased). The closed
form tells such a μ; a solver then finds x and s on its own.

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
from wbc.errors import InvalidInput
from wbc.methods.least_distance import Nearest, nearest
from wbc.methods.method import Method
from wbc.methods.shared import SMALL, box, factors, largest_known, unit_lengths
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.tolerances import NEAR, ROUNDING, SAME, SHARP, TINY
from wbc.types import Mat, Vec

#: Rounding of J, beside its entries: times its condition, that of an x with J x given.
LAST_BITS = 4.0 * float(np.finfo(np.float64).eps)
#: Targets and drifts below this are zero: their squares are, and limits in such units would not be numbers.
NOTHING = TINY**0.5


@final
@dataclass(frozen=True, eq=False)
class Saturation:
    """x (n,), the scale in [0, 1], the joints at a limit, and whether any scale is feasible.

    Infeasible: x and scale are NaN.
    """

    x: Vec
    scale: float
    saturated: tuple[int, ...]
    feasible: bool


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
        self._set(J=J, target=target, lower=low, upper=high, drift=drift)

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

    def closed_form(self) -> Saturation:
        """The largest scale, then the least norm, in finitely many steps."""
        return self._answer(None)

    @property
    def _level(self) -> _Level:
        return _Level((self.J, self.target, self.drift), self.lower, self.upper)

    def _answer(self, solver: str | Solver | None) -> Saturation:
        level = self._level
        x, scale = level.answer(solver)
        # Where drift and task cancel, x is rounding of either: a limit of 0 is then met by what is no number.
        near = NEAR * largest_known(self.lower, self.upper) + ROUNDING * max(float(np.linalg.norm(x)), level.size)
        at_limit = (x >= self.upper - near) | (x <= self.lower + near)
        return Saturation(x, scale, tuple(int(i) for i in at_limit.nonzero()[0]), not np.isnan(scale))

    def qp(self) -> QP:
        """Scale and least norm at once, in (x, s) (n + 1,): minimise ½ |x|² + ½ (T s − μ)² subject to

        J x − target s = −drift (m rows),  lower ≤ x ≤ upper,  0 ≤ s ≤ 1; T = |J# target| makes s a size of x, and μ is
        above the number from which the answer does not depend on it.
        """
        level = self._level
        n, full = len(self.lower), level.full
        H, g = np.eye(n + 1), np.zeros(n + 1)
        H[n, n], g[n] = full**2, -full * level.push
        return QP(
            H, g, A=np.column_stack([self.J, -self.target]), b=-self.drift,
            lb=np.append(self.lower, 0.0), ub=np.append(self.upper, 1.0),
            rows=[
                *(Row("task", f"row {i}") for i in range(len(self.J))),
                *(Row("limits", f"joint {i}") for i in range(n)), Row("scale", "s"),
            ],
        )  # fmt: skip

    def solve(self, solver: str | Solver = "pdas") -> Saturation:
        """The largest scale, then the least norm, by QP.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        return self._answer(solver)

    def difference(self, result: Saturation, reference: Saturation) -> Mapping[str, float]:
        """Scales by what they change x, residuals, norms at the same scale, relative to |x|; limits to themselves."""
        if result.feasible != reference.feasible:
            return {"feasible": np.inf}
        if not result.feasible:
            return {"feasible": 0.0}
        level, lengths = self._level, unit_lengths(self.J)
        length, other = float(np.linalg.norm(result.x)), float(np.linalg.norm(reference.x))
        known, size = largest_known(self.lower, self.upper), max(length, other, SMALL * level.size)
        over = np.maximum(result.x - self.upper, self.lower - result.x) / np.where(known > 0.0, known, size)
        missing = (self.J @ result.x + self.drift - result.scale * self.target) / lengths
        found = {
            "scale": abs(result.scale - reference.scale) * min(1.0, level.full / size),
            "task": float(np.linalg.norm(missing)) / size,
            "limits": max(0.0, float(over.max(initial=0.0))),
        }
        if found["scale"] <= SHARP:  # ½ |x|² grows by the push for each unit of σ: the last part of a scale may be dear
            dear = level.push * level.full * abs(result.scale - reference.scale) / size
            found["norm"] = max(0.0, abs(length - other) - dear) / size
        if min(result.scale, reference.scale) >= 1.0:
            found["x"] = float(np.linalg.norm(result.x - reference.x)) / size
        return found


@final
class PrioritisedTasks(Method):
    """What :meth:`NullSpaceSaturation.prioritised` makes."""

    def __init__(self, tasks: Sequence[tuple[Any, ...]], *, lower: Any, upper: Any) -> None:
        tasks = checks.items("tasks", tasks, "(J, target) or (J, target, drift)")
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
        """Level by level the largest scale with those above kept, at the end the least norm, in finitely many steps."""
        return self._levels(None)

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
        return self._levels(solver)

    def _levels(self, solver: str | Solver | None) -> PrioritisedSaturation:
        n = len(self.lower)
        rows, x, scales = np.zeros((0, n)), np.full(n, np.nan), list[float | None]()
        for J, target, drift in self.tasks:
            found, scale = _Level((J, target, drift), self.lower, self.upper, (rows, x)).answer(solver)
            scales.append(None if np.isnan(scale) else scale)
            if scales[-1] is not None:
                x, rows = found, np.vstack([rows, factors(J, of_unit_length=True).V])
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


@final
class _Level:
    """J x + drift = s target in the box, with what the tasks above came to kept: A x = A x₀, ``kept`` = (A (k, n), x₀).

    The unknowns are (x, σ) (n + 1,), σ = T s with T = ``full``, the length of the shortest x that does the whole task.
    ``size`` is that of x: what the limits and the task ask for.
    """

    def __init__(self, task: tuple[Mat, Vec, Vec], lower: Vec, upper: Vec, kept: tuple[Mat, Vec] | None = None) -> None:
        (J, target, drift), n = task, len(lower)
        found = factors(J, of_unit_length=True)
        rows, above = (np.zeros((0, n)), np.zeros(n)) if kept is None else kept
        self.lower, self.upper, self.full = lower, upper, found.size(target) or 1.0
        known = float(np.linalg.norm(largest_known(lower, upper)))
        self.size = min(self.full, known or self.full) + float(np.linalg.norm(found.solve(drift)))
        # A limit that the whole task meets exactly would else stop it or not, as rounding falls.
        part = min(LAST_BITS * found.condition, SAME)
        low, high = (part * np.where(limit == 0.0, self.size, np.abs(limit)) for limit in (lower, upper))
        self._towards = np.append(np.zeros(n), 1.0)
        self._qp = QP(
            np.eye(n + 1), np.zeros(n + 1),
            A=np.block([[rows, np.zeros((len(rows), 1))], [J, -target[:, None] / self.full]]),
            b=np.append(rows @ above, -drift), lb=np.append(lower - low, 0.0), ub=np.append(upper + high, self.full),
        )  # fmt: skip
        self._terms = np.append(np.abs(rows) @ np.abs(above), np.abs(drift))  # that b is a sum of

    def _nearest(self, solver: str | Solver | None, unit: float = 1.0) -> Nearest | None:
        root = np.diag(np.where(self._towards > 0.0, unit, 1.0))
        return nearest(self._qp, np.zeros(self._qp.n), root, solver, terms=self._terms, along=self._towards)

    @property
    def push(self) -> float:
        """A μ that is large enough: twice what is needed, and more than the length of the answer."""
        found = self._nearest(None)
        return self.full if found is None else found.push or self.full

    def answer(self, solver: str | Solver | None) -> tuple[Vec, float]:
        """x and the scale by a solver, or (None) by the finite method; NaN where no scale is feasible."""
        found = self._nearest(None)
        if found is not None and solver is not None:
            # A solver knows (x, σ) beside its length: where target and drift cancel in x, σ may not be longer.
            length = max(float(np.linalg.norm(found.x[:-1])), SMALL * self.size)
            found = self._nearest(solver, max(1.0, found.x[-1] / length))
        if found is None:
            return np.full(len(self.lower), np.nan), np.nan
        scale = found.x[-1] / self.full
        scale = 1.0 if self.full - found.x[-1] <= ROUNDING * np.linalg.norm(found.x) else float(max(scale, 0.0))
        return np.clip(found.x[:-1], self.lower, self.upper), scale


def _task(prefix: str, J: Any, target: Any, drift: Any = None) -> tuple[Mat, Vec, Vec]:
    """J (m, n), target (m,) and drift (m,), checked; ``prefix`` says which task it is."""
    J = checks.array(f"{prefix}J", J, (None, None))
    target = checks.array(f"{prefix}target", target, (len(J),))
    drift = np.zeros(len(J)) if drift is None else checks.array(f"{prefix}drift", drift, (len(J),))
    return J, np.where(np.abs(target) < NOTHING, 0.0, target), np.where(np.abs(drift) < NOTHING, 0.0, drift)
