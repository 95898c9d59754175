"""Writers: what fills the rows of barriers, linear constraints and linear tasks; made once, called each tick.

Memory is poisoned with NaN when a writer is made; after the first call ``check`` finds what a member forgot.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.qp.rows import RowProblem
from wbc.stack.compiled.finish_kernel import BARRIER, FORCE, TORQUE, UNKNOWN, VELOCITY, finish
from wbc.stack.compiled.row_memory import Written
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
from wbc.stack.kernel_rows import KernelRows, kernel_rows_of
from wbc.stack.layout import Layout
from wbc.stack.task import LinearExactly, LinearRows, LinearTask
from wbc.types import Mat, Vec

#: What rows are about.
_ABOUT = {"barrier": BARRIER, "velocity": VELOCITY, "torque": TORQUE, "force": FORCE}


class Writer(ABC):
    """Lets one member write, and puts what it wrote into the row array."""

    name: str

    @abstractmethod
    def fill(self, state: RobotState) -> None:
        """Write the member's rows for this state."""

    @abstractmethod
    def written(self) -> dict[str, Vec]:
        """The memory the member writes into, by the names it knows."""

    @property
    def own(self) -> RowWriter | None:
        """What writes rows that a kernel may write too."""
        return None

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


class RowWriter(Writer):
    """Rows of a barrier, a linear constraint or a linear task; compiled code makes of them what the solver reads."""

    def __init__(self, member: Barrier | LinearConstraint | LinearTask, row: int, problem: RowProblem, layout: Layout,
                 dt: float) -> None:  # fmt: skip
        self.name, self.row, self.member = member.name, row, member
        dim, model, second = member.dim, layout.model, layout.level.order == 2
        rows, items = slice(row, row + dim), slice(problem.item(row), problem.item(row + dim))
        self._G, self._items = problem.G[rows], items
        on = "barrier" if isinstance(member, Barrier) else member.on
        about = _ABOUT.get(on, UNKNOWN)
        if about == VELOCITY and not second:
            about = UNKNOWN
        where = layout.forces_of(member) if on == "force" and not isinstance(member, Barrier) else np.zeros(0)
        width = {FORCE: len(where), TORQUE: model.nj}.get(about, model.nv)
        J = self._G[:, : model.nv]
        self.A: Mat = J if about in (BARRIER, UNKNOWN) else np.full((dim, width), np.nan)
        self.A[:] = np.nan
        self.b, self.drift, self.rate = np.full(dim, np.nan), np.zeros(dim), np.zeros(dim)
        self._is_motion, self._is_force = about in (BARRIER, UNKNOWN, VELOCITY), about == FORCE
        self._numbers = np.array([0.0, dt])
        self._v = np.zeros(model.nv)
        lower, upper = problem.lower[items], problem.upper[items]
        self._sizes = np.array([about, dim, model.nv, problem.n + 1, second, width, self._kind, -1], dtype=np.int64)
        self.finishing = Memory(
            self._sizes, self._G, self.b, self.drift, self.rate, lower, upper, self.A, problem.G[model.nb : model.nv],
            where.astype(np.int64), problem.scale, self._v, self._numbers,
        )  # fmt: skip

    #: What b is: added to the right side (0), bounds (1), or neither (−1).
    _kind = 0

    @property
    def own(self) -> RowWriter:
        return self

    def has_slack_in(self, column: int) -> None:
        """Rows may be broken, by as much as unknowns from ``column`` on say."""
        self._sizes[7] = column

    def reads(self, v: Vec) -> None:
        """The velocities are these, until others are."""
        self._v = np.ascontiguousarray(v)
        self.finishing.addresses[11] = self._v.__array_interface__["data"][0]

    def kernel(self) -> Callable[[], KernelRows] | None:
        """What asks the member for its kernel; None where it has none."""
        said = kernel_rows_of(self.member)
        return None if said is None else partial(self._said, said)

    def _said(self, said: Callable[[], KernelRows]) -> KernelRows:
        self._read()
        return said()

    def into(self) -> Written:
        """Where a kernel writes."""
        dim = len(self.b)
        return Written(
            self.b, self.drift, self.rate, np.zeros(dim), self.A if self._is_motion else None,
            A=self.A if self._is_force else None,
        )  # fmt: skip

    def fill(self, state: RobotState) -> None:
        self.reads(state.v)
        self._read()
        self.drift[:] = 0.0
        self._call(state)
        finish(self.finishing.address)

    def _read(self) -> None:
        if isinstance(self.member, Barrier):
            self._numbers[0] = self.member.rate

    @abstractmethod
    def _call(self, state: RobotState) -> None:
        """Let the member write."""


@final
class BarrierWriter(RowWriter):
    """ḣ >= −γ h, or ḧ >= −2 γ ḣ − γ² h."""

    _kind = -1

    def __init__(self, barrier: Barrier, row: int, problem: RowProblem, layout: Layout, dt: float) -> None:
        super().__init__(barrier, row, problem, layout, dt)
        self.barrier = barrier
        self._out = out = BarrierRows()
        out.J, out.h, out.drift, out.rate = self.A, self.b, self.drift, self.rate
        self._order = layout.level.order

    def _call(self, state: RobotState) -> None:
        self.drift[:] = np.nan
        self.barrier.fill(state, self._out)

    @property
    def margins(self) -> Vec:
        """h (dim,) of the state that was filled last."""
        return self.b

    def written(self) -> dict[str, Vec]:
        found = {"h": self.b, "J": self.A}
        return found if self._order == 1 else found | {"drift": self.drift}


@final
class ConstraintWriter(RowWriter):
    """lo <= A y <= hi."""

    _kind = -1

    def __init__(self, constraint: LinearConstraint, row: int, problem: RowProblem, layout: Layout, dt: float) -> None:
        super().__init__(
            constraint.task if isinstance(constraint, LinearExactly) else constraint, row, problem, layout, dt
        )
        self.name = constraint.name
        self._sizes[6] = 1 if isinstance(constraint, LinearExactly) else -1
        self._constraint, self._out, self._equal = constraint, ConstraintRows(), LinearRows()
        self._equal.A, self._equal.b = self.A, self.b
        self._out.A, self._out.lo, self._out.hi = self.A, problem.lower[self._items], problem.upper[self._items]
        self._out.lo[:], self._out.hi[:] = np.nan, np.nan

    def _call(self, state: RobotState) -> None:
        if isinstance(self._constraint, LinearExactly):
            self._constraint.task.fill(state, self._equal)
        else:
            self._constraint.fill(state, self._out)

    def written(self) -> dict[str, Vec]:
        return {"A": self.A, "lo": self._out.lo, "hi": self._out.hi}


@final
class JointIntervalWriter(Writer):
    """Bounds on each joint's motion or torque as rows, for a constraint that may be broken."""

    def __init__(self, constraint: JointInterval, row: int, problem: RowProblem, layout: Layout, dt: float) -> None:
        self.name = constraint.name
        model, nj, nb = layout.model, layout.model.nj, layout.model.nb
        self._rows = problem.G[row : row + nj]
        items = slice(problem.item(row), problem.item(row + nj))
        self._lower, self._upper = problem.lower[items], problem.upper[items]
        self._torques, self._intervals = None, None
        self._constraint, self._model = constraint, model
        if constraint.quantity == "torque":
            self._torques = problem.G[nb : nb + nj]
            self._lower[:], self._upper[:] = constraint.bounds(model)
        else:
            self._intervals = JointIntervals.compose([constraint], model, dt)
            self._rows[:, nb : nb + nj] = np.eye(nj)
            self._bound = self._intervals.velocity if layout.level.order == 1 else self._intervals.acceleration

    def fill(self, state: RobotState) -> None:
        if self._torques is not None:
            self._rows[:] = self._torques
            if isinstance(self._constraint, TorqueBySpeed):
                self._lower[:], self._upper[:] = self._constraint.bounds(self._model)
                self._constraint.narrow(state.v_joints, self._lower, self._upper)
        else:
            self._bound(state.q_joints, state.v_joints, self._lower, self._upper)

    def written(self) -> dict[str, Vec]:
        return {"lower": self._lower, "upper": self._upper}


@final
class TorqueSpeedWriter(Writer):
    """Bounds on torques that move with speed, from those that components may write into."""

    def __init__(self, constraints: Sequence[TorqueBySpeed], bounds: tuple[Vec, Vec], now: tuple[Vec, Vec]) -> None:
        self.name = constraints[0].name
        self._constraints, self._bounds, self._now = constraints, bounds, now

    def fill(self, state: RobotState) -> None:
        (lower, upper), (low, high) = self._now, self._bounds
        lower[:], upper[:] = low, high
        for constraint in self._constraints:
            constraint.narrow(state.v_joints, lower, upper)
        np.minimum(lower, upper, out=lower)  # a component may have left less than the speed leaves

    def written(self) -> dict[str, Vec]:
        return {"lower": self._now[0], "upper": self._now[1]}


@final
class SoftConstraintWriter(Writer):
    """lo <= A y + s <= hi: the constraint's own rows, each with its slack s."""

    def __init__(self, soft: Softly, at: tuple[int, int], problem: RowProblem, layout: Layout, dt: float) -> None:
        constraint, (row, column) = soft.constraint, at
        self.name = soft.name
        self._constraint: RowWriter | JointIntervalWriter
        if isinstance(constraint, Barrier):
            self._constraint = BarrierWriter(constraint, row, problem, layout, dt)
        elif isinstance(constraint, LinearConstraint):
            self._constraint = ConstraintWriter(constraint, row, problem, layout, dt)
        else:
            assert isinstance(constraint, JointInterval)
            self._constraint = JointIntervalWriter(constraint, row, problem, layout, dt)
        #: What writes the constraint's own rows, where it is a barrier.
        self.barrier = self._constraint if isinstance(self._constraint, BarrierWriter) else None
        self._slacks = np.einsum("ii->i", problem.G[row : row + soft.dim, column : column + soft.dim])
        self._scale = problem.scale[column : column + soft.dim]
        if isinstance(self._constraint, RowWriter):
            self._constraint.has_slack_in(column)

    @property
    def own(self) -> RowWriter | None:
        return self._constraint.own

    def fill(self, state: RobotState) -> None:
        self._constraint.fill(state)
        if self.own is None:
            self._slacks[:] = self._scale

    def written(self) -> dict[str, Vec]:
        return self._constraint.written()


@final
class LinearWriter(RowWriter):
    """A y = b, in least squares."""

    def __init__(self, task: LinearTask, row: int, problem: RowProblem, layout: Layout, dt: float) -> None:
        super().__init__(task, row, problem, layout, dt)
        self._task, self._out = task, LinearRows()
        self._out.A, self._out.b = self.A, self.b

    def _call(self, state: RobotState) -> None:
        self._task.fill(state, self._out)

    def written(self) -> dict[str, Vec]:
        return {"A": self.A, "b": self.b}
