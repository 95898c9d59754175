"""The largest step along a projected gradient that keeps every joint inside its velocity limits.

A redundant robot follows a task velocity ṙ = J v and climbs a criterion H(q) with what is left,

    v(α) = v_task + α v_null,    v_task = J# ṙ,    v_null = (I − J# J) ∇H,    J v(α) = J J# ṙ for every α.

With joint limits v_min ≤ v ≤ v_max each joint allows an interval of α,

    v_null > 0:   (v_min − v_task) / v_null ≤ α ≤ (v_max − v_task) / v_null
    v_null < 0:   (v_max − v_task) / v_null ≤ α ≤ (v_min − v_task) / v_null
    v_null = 0:   every α, or none where v_task is outside

and α* is the upper end of their intersection with [0, α_max]. Where v_task is inside its limits only the upper ends
count. Where nothing moves (v_null = 0) every α gives the same velocity, and α* = 0 by convention.

Liégeois: Automatic supervisory control of the configuration and behavior of multibody mechanisms, IEEE Transactions
on Systems, Man, and Cybernetics 7(12), 1977.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.methods.gradient_step import Projection, Step
from wbc.methods.least_distance import nearest
from wbc.methods.method import Method
from wbc.methods.shared import box, factors, largest_known
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.tolerances import NEAR, ROUNDING, SHARP
from wbc.types import Vec

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@final
@dataclass(frozen=True, eq=False, init=False)
class ProjectedGradientStep(Method):
    """Largest α in [0, α_max] with v_min ≤ v_task + α v_null ≤ v_max.

    Args:
        v_task: velocity of the task (n,) [rad/s, m/s].
        v_null: direction that leaves the task alone (n,) [unit of the gradient].
        v_min: lower limits (n,), or −inf.
        v_max: upper limits (n,), or inf; equal to ``v_min`` where a joint is locked.
        alpha_max: largest step allowed, not negative [velocity per gradient].
        origin: the projection, where :meth:`from_gradient` made this; the QP over velocities needs it.

    Raises:
        InvalidInput: shapes, NaN, crossed limits, a negative ``alpha_max``, or a step that nothing ends.

    Example:
        >>> from wbc.methods import ProjectedGradientStep
        >>> step = ProjectedGradientStep.from_gradient([[1, 1]], [1.0], [1.0, 0.0], v_min=[-1, -1], v_max=[1, 1])
        >>> round(step.closed_form().alpha, 9), step.closed_form().active
        (1.0, (0,))
    """

    v_task: Vec
    v_null: Vec
    v_min: Vec
    v_max: Vec
    alpha_max: float
    origin: Projection | None

    def __init__(
        self,
        v_task: Any,
        v_null: Any,
        *,
        v_min: Any,
        v_max: Any,
        alpha_max: float = np.inf,
        origin: Projection | None = None,
    ) -> None:
        if not isinstance(origin, Projection | None):
            raise InvalidInput(f"origin is {origin!r}; from_gradient makes it")
        v_task = checks.array("v_task", v_task, (None,))
        lower, upper = box(v_task.size, v_min=v_min, v_max=v_max)
        self._set(
            v_task=v_task, v_null=checks.array("v_null", v_null, v_task.shape), v_min=lower, v_max=upper,
            alpha_max=_largest(alpha_max), origin=origin,
        )  # fmt: skip
        if not np.isfinite(self._unit()):
            raise InvalidInput("alpha_max is inf, and so are all limits in the direction of v_null: give alpha_max")

    @classmethod
    def from_gradient(
        cls, J: Any, task_velocity: Any, gradient: Any, *, v_min: Any, v_max: Any, alpha_max: float = np.inf
    ) -> ProjectedGradientStep:
        """The step for a Jacobian J (m, n), a task velocity (m,) and the gradient (n,) of a criterion to be maximised.

        Any rank: a task velocity out of reach is met in least squares, whatever the step. m = 0: no task.

        Raises:
            InvalidInput: as the class.
        """
        gradient = checks.array("gradient", gradient, (None,))
        J = checks.array("J", J, (None, gradient.size))
        task_velocity = checks.array("task_velocity", task_velocity, (len(J),))
        rows = factors(J, of_unit_length=True)
        # Rows in units far apart cost digits, and only where they cannot all be met do their units matter.
        found = rows if rows.reaches(task_velocity, np.abs(task_velocity)) else factors(J)
        v_task = found.inverse(task_velocity)
        missed = np.linalg.norm(found.unreached(task_velocity)) / found.values.min(initial=np.inf)
        known = max(ROUNDING, 16.0 * np.finfo(float).eps * found.condition) * float(np.linalg.norm(v_task) + missed)
        return cls(
            v_task, rows.projected(gradient), v_min=v_min, v_max=v_max, alpha_max=alpha_max,
            origin=Projection(J, task_velocity, gradient, known),
        )  # fmt: skip

    # ---- what both ways share
    @property
    def _moving(self) -> Any:
        """Joints that the step moves; what is rounding beside the others is zero."""
        return np.abs(self.v_null) > ROUNDING * np.abs(self.v_null).max(initial=0.0)

    @property
    def _column(self) -> Vec:
        """v_null without what is rounding."""
        return np.asarray(np.where(self._moving, self.v_null, 0.0))

    @property
    def _size(self) -> Vec:
        """The largest finite velocity known of each joint; what is rounding of the task's velocity is none."""
        task = np.where(np.abs(self.v_task) <= self._rounding(), 0.0, self.v_task)
        return largest_known(task, self.v_min, self.v_max)

    def _rounding(self) -> float:
        """What last bits of J move v_task by; zero where that is given."""
        return self.origin.rounding if self.origin else 0.0

    def _room(self) -> tuple[Vec, Vec]:
        """From v_task down to v_min and up to v_max (n,); zero where a joint is at its limit."""
        rounding = ROUNDING * self._size + self._rounding()
        down, up = self.v_min - self.v_task, self.v_max - self.v_task
        return np.where(np.abs(down) <= rounding, 0.0, down), np.where(np.abs(up) <= rounding, 0.0, up)

    def _unit(self) -> float:
        """The step that takes some joint, or α, across its range: α* is at most twice that; 1 where nothing moves."""
        ahead = np.where(self.v_null > 0.0, self.v_max, -self.v_min)
        ends = self._moving & np.isfinite(ahead)
        steps = np.append(self._size[ends] / np.abs(self.v_null[ends]), self.alpha_max)
        known = steps[np.isfinite(steps)]
        return float(min(known[known > 0.0], default=1.0)) if known.size or not self._moving.any() else np.inf

    def _beyond(self) -> float:
        """A step beyond every feasible one; 0 where nothing moves, which is α* by convention."""
        return 2.0 * self._unit() if self._moving.any() else 0.0

    # ---- closed form
    def closed_form(self) -> Step:
        """α* by the sign of each component of v_null."""
        down, up = self._room()
        moving = self._moving
        if (np.maximum(down, -up)[~moving] > 0.5 * SHARP * self._size[~moving]).any():
            return self._infeasible(np.inf, -np.inf)
        if not moving.any():
            return self._step(0.0, (0.0, self.alpha_max))
        ends = np.sort(np.array([down[moving], up[moving]]) / self.v_null[moving], axis=0)
        low, high = max(0.0, float(ends[0].max())), min(self.alpha_max, float(ends[1].min()))
        if low > high + SHARP * self._unit():
            return self._infeasible(low, high)
        high = max(high, 0.0)
        return self._step(high, (min(low, high), high))

    def _step(self, alpha: float, interval: tuple[float, float]) -> Step:
        """The result for one step; joints that stop it are at their limit exactly."""
        down, up = self._room()
        ahead = np.where(self.v_null > 0.0, up, -down)
        left = ahead - alpha * np.abs(self.v_null)
        stopped = self._moving & (left <= NEAR * self._size)
        return Step(
            alpha, self.v_task + alpha * self.v_null, interval, tuple(int(i) for i in stopped.nonzero()[0]), True
        )

    def _infeasible(self, low: float, high: float) -> Step:
        return Step(np.nan, np.full(self.v_task.size, np.nan), (low, high), (), False)

    # ---- QPs
    def qp(self) -> QP:
        """max α as a strictly convex QP in α (1,): minimise ½ (α − ᾱ)², ᾱ beyond every feasible step, subject to

        v_min − v_task ≤ v_null α ≤ v_max − v_task (n rows),  0 ≤ α ≤ α_max.
        """
        down, up = self._room()
        reach = 4.0 * self._unit() * np.abs(self._column)  # what no feasible step comes near is no limit
        down, up = np.where(down < -reach, -np.inf, down), np.where(up > reach, np.inf, up)
        return QP(
            [[1.0]], [-self._beyond()], C=self._column[:, None], cl=down, cu=up, lb=[0.0], ub=[self.alpha_max],
            rows=[*self._joint_rows(), Row("step", "α")],
        )  # fmt: skip

    def qp_with_velocity(self) -> QP:
        """The same step in x = (v, α) (n + 1,): minimise ½ |v − v_task − α v_null|² + ½ (α − ᾱ)² subject to

        v − α v_null = v_task (n rows),  v_min ≤ v ≤ v_max,  0 ≤ α ≤ α_max. The first term is zero wherever the rows
        hold; it makes H positive definite without a price on v.
        """
        n, alpha, (down, up) = self.v_task.size, self._beyond(), self._room()
        link = np.hstack([np.eye(n), -self._column[:, None]])
        last = np.eye(n + 1)[n]
        return QP(
            link.T @ link + np.outer(last, last), -link.T @ self.v_task - alpha * last, A=link, b=self.v_task,
            lb=np.append(self.v_task + down, 0.0), ub=np.append(self.v_task + up, self.alpha_max),
            rows=[*(Row("velocity", f"joint {i}") for i in range(n)), *self._joint_rows(), Row("step", "α")],
        )  # fmt: skip

    def qp_over_velocity(self, alpha: float) -> QP:
        """The general QP in v (n,): minimise ½ |v|² − α ∇Hᵀv subject to J v = ṙ (m rows), v_min ≤ v ≤ v_max.

        Without active limits its answer is v(α); with them it need not stay on the ray v_task + α v_null, so it climbs
        at least as well and is feasible whenever the task is.

        Raises:
            NotSupported: this step was not made :meth:`from_gradient`.
            InvalidInput: ``alpha`` is not a finite number ≥ 0.
        """
        if self.origin is None:
            raise NotSupported("the QP over velocities needs J and the gradient: make the step with from_gradient")
        alpha, of = checks.number("alpha", alpha, low=0.0), self.origin
        return QP(
            np.eye(self.v_task.size), -alpha * of.gradient, A=of.J, b=of.task_velocity, lb=self.v_min, ub=self.v_max,
            rows=[*(Row("task", f"row {i}") for i in range(len(of.J))), *self._joint_rows()],
        )  # fmt: skip

    def _joint_rows(self) -> list[Row]:
        return [Row("velocity limits", f"joint {i}") for i in range(self.v_task.size)]

    def solve(self, solver: str | Solver = "pdas") -> Step:
        """α* by the QP over α, and the lower end of ``interval`` by another.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        low = self._furthest(-1.0, solver)
        if np.isnan(low):
            return self._infeasible(np.inf, -np.inf)
        if not self._moving.any():
            return self._step(0.0, (0.0, self.alpha_max))
        high = self._furthest(1.0, solver)
        return self._step(high, (min(low, high), high))

    def _furthest(self, direction: float, solver: str | Solver) -> float:
        """The largest (1.0) or smallest (−1.0) feasible step; NaN where there is none."""
        qp, unit = self.qp(), self._unit()
        # α in units of the range: rows are not compared with a bound on α that has the gradient's unit.
        with np.errstate(over="ignore"):
            ub = qp.ub / unit
        ub[ub > 4.0] = np.inf  # what no feasible step comes near is no limit, and its size would hide contradictions
        measured = QP(qp.H, np.zeros(1), C=qp.C * unit, cl=qp.cl, cu=qp.cu, lb=qp.lb, ub=ub)
        found = nearest(measured, np.zeros(1), np.eye(1), solver, along=np.array([direction]))
        return np.nan if found is None else float(np.clip(found.x[0] * unit, 0.0, self.alpha_max))

    def difference(self, result: Step, reference: Step) -> Mapping[str, float]:
        """Steps relative to the step that takes a joint across its range, velocities to what the joints move at."""
        if result.feasible != reference.feasible:
            return {"feasible": np.inf}
        if not result.feasible:
            return {"feasible": 0.0}
        unit = self._unit()
        speed = np.abs(self.v_task).max(initial=0.0) + unit * np.abs(self.v_null).max(initial=0.0)
        motion = self._size + unit * np.abs(self.v_null)
        over = np.maximum(result.v - self.v_max, self.v_min - result.v) / np.where(motion > 0.0, motion, 1.0)
        return {
            "alpha": abs(result.alpha - reference.alpha) / unit,
            "interval": abs(result.interval[0] - reference.interval[0]) / unit,
            "velocity": float(np.abs(result.v - reference.v).max(initial=0.0)) / (speed or 1.0),
            "limits": max(0.0, float(over.max(initial=0.0))),
        }

    def plot(self) -> Figure:
        """The plane (v1, v2) of a robot with two joints: box, task line, gradient, its projection, and the result.

        Raises:
            NotSupported: n is not 2, or matplotlib is not installed.
        """
        from wbc.methods.step_picture import draw

        return draw(self.v_task, self.v_null, (self.v_min, self.v_max), self.origin, self.closed_form())


def _largest(alpha_max: Any) -> float:
    if isinstance(alpha_max, float) and alpha_max == np.inf:
        return np.inf
    return checks.number("alpha_max", alpha_max, low=0.0)
