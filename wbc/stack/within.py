"""Within: a kinematic task as an inequality. Its error stays in an interval."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.constraint import Barrier, BarrierRows
from wbc.stack.task_rows import Kinematic, TaskRows
from wbc.types import Index, Vec


@final
class Within(Barrier):
    """lower <= e <= upper for the error e of a task, row by row; made by ``task.within(…)``.

    h = e − lower and upper − e, a row for each bound that is finite, with ḣ = ±(ẏ_ref − J v) and
    ḧ = ±(ÿ_ref − J a − J̇ v): a moving target moves the interval. For rows that are a rotation vector this is exact up
    to first order in the error. ``constraint.softly()`` makes it an objective again: a task that is content within a
    tolerance.

    Raises:
        InvalidInput: when a stack is compiled: bounds of another size, an empty interval, no finite bound, or one on a
            row with kp = 0, which asks for a velocity and has no error.

    Example:
        >>> import wbc
        >>> from wbc.tasks import CenterOfMass
        >>> CenterOfMass(target=[0.0, 0.0, 0.8]).within(0.02)
        CenterOfMass within
    """

    def __init__(
        self, task: Kinematic, lower: Any, upper: Any = None, *, rate: float = 10.0, slack: float | None = None,
        name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(rate=rate, slack=slack, name=name or f"{task.name} within")
        self.task = task
        if upper is None:
            tolerance = np.asarray(lower, dtype=np.float64)
            lower, upper = -tolerance, tolerance
        self._given = lower, upper

    def prepare(self, model: RobotModel) -> None:
        task = self.task
        task.prepare(model)
        bounds = [
            checks.array(
                f"{self.name}.{which}", np.full(task.dim, b) if np.ndim(b) == 0 else b, (task.dim,), finite=False
            )
            for which, b in zip(("lower", "upper"), self._given, strict=True)
        ]
        lower, upper = bounds
        if not (lower < upper).all():
            i = int(np.argmin(lower < upper))
            raise InvalidInput(f"{self.name}: row {i} is left nothing: lower {lower[i]:g}, upper {upper[i]:g}")
        below, above = np.flatnonzero(np.isfinite(lower)), np.flatnonzero(np.isfinite(upper))
        #: Of each row of the barrier: the row of the task, and whether it bounds e from below (+1) or above (−1).
        self._row: Index = np.concatenate([below, above])
        self._sign: Vec = np.repeat([1.0, -1.0], [len(below), len(above)])
        self._bound: Vec = np.concatenate([-lower[below], upper[above]])
        self.dim = len(self._row)
        if self.dim == 0:
            raise InvalidInput(f"{self.name} has no finite bound")
        velocities = np.flatnonzero(task.gains()[0][self._row] == 0.0)
        if velocities.size:
            i = int(self._row[velocities[0]])
            raise InvalidInput(
                f"{self.name}: row {i} has kp = 0, which asks for a velocity; its bounds must be infinite"
            )
        self.units = tuple(task.unit(int(i)) for i in self._row)
        self._out = out = TaskRows()
        for array in ("e", "ed", "drift", "rate_ref", "acc_ref"):
            setattr(out, array, np.zeros(task.dim))
        out.J = np.eye(model.nv)[model.nb :] if task.on_joints else np.zeros((task.dim, model.nv))

    def fill(self, state: RobotState, out: BarrierRows) -> None:
        rows, row, sign = self._out, self._row, self._sign
        rows.rate_ref[:], rows.acc_ref[:] = 0.0, 0.0
        self.task.fill(state, rows)
        out.h[:] = sign * rows.e[row] + self._bound
        out.J[:] = -sign[:, None] * rows.J[row]
        out.rate[:] = sign * rows.rate_ref[row]
        out.drift[:] = sign * (rows.acc_ref - rows.drift)[row]

    def label(self, row: int) -> str:
        """The row of the task, and which bound it is."""
        return f"{self.task.label(int(self._row[row]))} {'>=' if self._sign[row] > 0 else '<='}".strip()
