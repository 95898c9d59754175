"""Writers: what fills the rows of barriers, linear constraints and linear tasks; made once, called each tick.

Memory is poisoned with NaN when a writer is made; after the first call ``check`` finds what a member forgot.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import final

import numpy as np

from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.qp.rows import RowProblem
from wbc.stack.constraint import (
    Barrier,
    BarrierRows,
    ConstraintRows,
    JointInterval,
    LinearConstraint,
    Softly,
    TorqueBySpeed,
)
from wbc.stack.interval import JointIntervals
from wbc.stack.layout import Layout
from wbc.stack.task import LinearRows, LinearTask
from wbc.types import Mat, Vec


class Writer(ABC):
    """Lets one member write, and puts what it wrote into the row array."""

    name: str

    @abstractmethod
    def fill(self, state: RobotState) -> None:
        """Write the member's rows for this state."""

    @abstractmethod
    def written(self) -> dict[str, Vec]:
        """The memory the member writes into, by the names it knows."""

    @final
    def check(self) -> None:
        """After the first fill: everything must have been written.

        Raises:
            InvalidInput: naming the member and what it left out.
        """
        for what, values in self.written().items():
            if np.isnan(values).any():
                where = int(np.argwhere(np.isnan(values))[0][0])
                raise InvalidInput(f"{self.name}.fill left NaN in out.{what}[{where}]")


@final
class BarrierWriter(Writer):
    """ḣ >= −γ h, or ḧ >= −2 γ ḣ − γ² h."""

    def __init__(self, barrier: Barrier, row: int, problem: RowProblem, layout: Layout) -> None:
        self.name, self.barrier, self.row = barrier.name, barrier, row
        rows, items = slice(row, row + barrier.dim), slice(problem.item(row), problem.item(row + barrier.dim))
        self._barrier, self._order = barrier, layout.level.order
        self._out = out = BarrierRows()
        out.J = problem.G[rows, : layout.model.nv]
        out.J[:] = np.nan
        out.h, out.drift = np.full(barrier.dim, np.nan), np.full(barrier.dim, np.nan)
        out.rate = np.zeros(barrier.dim)
        self._right, self._lower = problem.G[rows, problem.n], problem.lower[items]

    def fill(self, state: RobotState) -> None:
        out, rate = self._out, self._barrier.rate
        self._barrier.fill(state, out)
        if self._order == 1:
            np.multiply(out.h, -rate, self._lower)
            self._lower -= out.rate
        else:
            self._right[:] = out.drift
            self._lower[:] = -2.0 * rate * (out.J @ state.v + out.rate) - rate**2 * out.h

    @property
    def margins(self) -> Vec:
        """h (dim,) of the state that was filled last."""
        return self._out.h

    def written(self) -> dict[str, Vec]:
        found = {"h": self._out.h, "J": self._out.J}
        return found if self._order == 1 else found | {"drift": self._out.drift}


@final
class ConstraintWriter(Writer):
    """lo <= A y <= hi."""

    def __init__(self, law: LinearConstraint, row: int, problem: RowProblem, layout: Layout, dt: float) -> None:
        self.name = law.name
        self._law, self._out = law, ConstraintRows()
        items = slice(problem.item(row), problem.item(row + law.dim))
        self._out.A = np.full((law.dim, layout.size_of(law)), np.nan)
        self._out.lo, self._out.hi = problem.lower[items], problem.upper[items]
        self._out.lo[:], self._out.hi[:] = np.nan, np.nan
        self._write = _quantity(law, problem.G[row : row + law.dim], problem, layout, dt)

    def fill(self, state: RobotState) -> None:
        self._law.fill(state, self._out)
        self._write(self._out.A, state.v)

    def written(self) -> dict[str, Vec]:
        return {"A": self._out.A, "lo": self._out.lo, "hi": self._out.hi}


@final
class JointIntervalWriter(Writer):
    """Bounds on each joint's motion or torque as rows, for a law that may be broken."""

    def __init__(self, law: JointInterval, row: int, problem: RowProblem, layout: Layout, dt: float) -> None:
        self.name = law.name
        model, nj, nb = layout.model, layout.model.nj, layout.model.nb
        self._rows = problem.G[row : row + nj]
        items = slice(problem.item(row), problem.item(row + nj))
        self._lower, self._upper = problem.lower[items], problem.upper[items]
        self._torques, self._intervals = None, None
        self._law, self._model = law, model
        if law.quantity == "torque":
            self._torques = problem.G[nb : nb + nj]
            self._lower[:], self._upper[:] = law.bounds(model)
        else:
            self._intervals = JointIntervals.compose([law], model, dt)
            self._rows[:, nb : nb + nj] = np.eye(nj)
            self._bound = self._intervals.velocity if layout.level.order == 1 else self._intervals.acceleration

    def fill(self, state: RobotState) -> None:
        if self._torques is not None:
            self._rows[:] = self._torques
            if isinstance(self._law, TorqueBySpeed):
                self._lower[:], self._upper[:] = self._law.bounds(self._model)
                self._law.narrow(state.v_joints, self._lower, self._upper)
        else:
            self._bound(state.q_joints, state.v_joints, self._lower, self._upper)

    def written(self) -> dict[str, Vec]:
        return {"lower": self._lower, "upper": self._upper}


@final
class TorqueSpeedWriter(Writer):
    """Bounds on torques that move with speed, from those that components may write into."""

    def __init__(self, laws: Sequence[TorqueBySpeed], bounds: tuple[Vec, Vec], now: tuple[Vec, Vec]) -> None:
        self.name = laws[0].name
        self._laws, self._bounds, self._now = laws, bounds, now

    def fill(self, state: RobotState) -> None:
        (lower, upper), (low, high) = self._now, self._bounds
        lower[:], upper[:] = low, high
        for law in self._laws:
            law.narrow(state.v_joints, lower, upper)
        np.minimum(lower, upper, out=lower)  # a component may have left less than the speed leaves

    def written(self) -> dict[str, Vec]:
        return {"lower": self._now[0], "upper": self._now[1]}


@final
class SoftLawWriter(Writer):
    """lo <= A y + s <= hi: the law's own rows, and what each of them gives way by."""

    def __init__(self, soft: Softly, at: tuple[int, int], problem: RowProblem, layout: Layout, dt: float) -> None:
        law, (row, column) = soft.law, at
        self.name = soft.name
        self._law: Writer
        if isinstance(law, Barrier):
            self._law = BarrierWriter(law, row, problem, layout)
        elif isinstance(law, LinearConstraint):
            self._law = ConstraintWriter(law, row, problem, layout, dt)
        else:
            assert isinstance(law, JointInterval)
            self._law = JointIntervalWriter(law, row, problem, layout, dt)
        #: What writes the law's own rows, where it is a barrier.
        self.barrier = self._law if isinstance(self._law, BarrierWriter) else None
        self._gives = np.einsum("ii->i", problem.G[row : row + soft.dim, column : column + soft.dim])
        self._scale = problem.scale[column : column + soft.dim]

    def fill(self, state: RobotState) -> None:
        self._law.fill(state)
        self._gives[:] = self._scale

    def written(self) -> dict[str, Vec]:
        return self._law.written()


@final
class LinearWriter(Writer):
    """A y = b, in least squares."""

    def __init__(self, task: LinearTask, row: int, problem: RowProblem, layout: Layout, dt: float) -> None:
        self.name = task.name
        self._task, self._out = task, LinearRows()
        self._out.A, self._out.b = np.full((task.dim, layout.size_of(task)), np.nan), np.full(task.dim, np.nan)
        rows = problem.G[row : row + task.dim]
        self._right = rows[:, problem.n]
        self._write = _quantity(task, rows, problem, layout, dt)

    def fill(self, state: RobotState) -> None:
        self._task.fill(state, self._out)
        self._write(self._out.A, state.v)
        self._right -= self._out.b

    def written(self) -> dict[str, Vec]:
        return {"A": self._out.A, "b": self._out.b}


def _quantity(
    member: LinearTask | LinearConstraint, rows: Mat, problem: RowProblem, layout: Layout, dt: float
) -> Callable[[Mat, Vec], None]:
    """``write(A, v)``: A y as rows of x̂ = [x | 1] for the quantity y that the member is about."""
    nv, nb = layout.model.nv, layout.model.nb
    right = rows[:, problem.n]
    if member.on == "torque":
        torques = problem.G[nb:nv]

        def write(A: Mat, v: Vec) -> None:
            np.matmul(A, torques, out=rows)

    elif member.on == "force":
        columns = layout.forces_of(member)

        def write(A: Mat, v: Vec) -> None:
            rows[:, columns] = A * problem.scale[columns]
            right[:] = 0.0

    elif member.on == "velocity" and layout.level.order == 2:

        def write(A: Mat, v: Vec) -> None:  # the velocity that the tick ends with, v + a dt
            np.multiply(A, dt, out=rows[:, :nv])
            right[:] = np.dot(A, v)

    else:  # the unknown itself; Layout lets no other quantity through

        def write(A: Mat, v: Vec) -> None:
            rows[:, :nv] = A
            right[:] = 0.0

    return write
