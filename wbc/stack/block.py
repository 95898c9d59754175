"""Block: what a member of a stack becomes in one plan. Its rows, their names, where they are written."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, final

import numpy as np

from wbc.compiled import Memory
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.qp.rows import RowProblem, RowTask
from wbc.stack.compiled.finish_kernel import BARRIER, FORCE, TORQUE, UNKNOWN, VELOCITY, finish
from wbc.stack.constraint import (
    Barrier,
    BarrierRows,
    ConstraintRows,
    JointInterval,
    LinearConstraint,
    Softly,
    TorqueBySpeed,
    bounds_of,
)
from wbc.stack.contact import Anchor
from wbc.stack.interval import JointIntervals
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.motion import MotionRows
from wbc.stack.task import Exactly, LinearRows, LinearTask, TaskRows, Within
from wbc.types import Index, Mat, Vec

_NONE = slice(0, 0)
#: What rows are about.
_ABOUT = {"velocity": VELOCITY, "torque": TORQUE, "force": FORCE}


class Block(ABC):
    """A member of a stack in one plan.

    ``rows`` are those of G that it has, none for a task on the joints; ``unknowns`` those of x that it pulls
    on, joints or slacks, or that are a contact's force. ``says`` writes the rows: of ``task.exactly()`` the task, of
    ``constraint.softly()`` the constraint, else the member itself; ``out`` is what it writes into. ``weights`` are
    views of those of the problem.
    """

    #: What a kernel writes into in the place of ``out``, and where A goes of a member on forces.
    into: TaskRows
    A: Mat | None = None
    #: Where a contact is held.
    anchor: Anchor | None = None
    #: Addresses of what :func:`wbc.stack.compiled.finish_kernel.pick` and ``finish`` read: 0 for rows that are no
    #: interval of a task, and for rows that gains complete.
    picking = finishing = 0
    weights: Vec
    #: Where a task or contact stands among the plan's motion rows.
    motion: slice

    def __init__(self, member: Any, rows: slice, unknowns: slice = _NONE) -> None:
        self.member, self.rows, self.unknowns = member, rows, unknowns
        self.says = says_of(member)
        self.name: str = member.name
        self.has_rows = rows.stop > rows.start
        self.dim: int = rows.stop - rows.start if self.has_rows else member.dim
        self.out: Any = None

    def kernel_rows(self) -> KernelRows:
        """What a kernel is to read of the settings."""
        found: KernelRows = self.says.kernel_rows()
        return found

    def fill(self, state: RobotState) -> None:
        """Let the member write its rows for this state."""
        self.says.fill(state, self.out)

    @abstractmethod
    def row_task(self) -> RowTask:
        """A task as its level knows it."""

    @abstractmethod
    def check(self, order: int) -> None:
        """After the first fill, on poisoned memory: everything must have been written.

        Raises:
            InvalidInput: naming the member and what it left out.
        """

    def _refuse_unwritten(self, *names: str) -> None:
        for what in names:
            unwritten = np.isnan(getattr(self.out, what))
            if unwritten.any():
                first = int(np.argwhere(unwritten)[0][0])
                raise InvalidInput(
                    f"{self.name}.fill left NaN in out.{what}[{first}]; write it, as by out.{what}[:] = …"
                )


def refuse_crossed(name: str, lower: Vec, upper: Vec) -> None:
    """Refuse bounds (dim,) of a linear constraint of this name between which there is nothing."""
    crossed = (lower > upper) | (lower == np.inf) | (upper == -np.inf)
    if crossed.any():
        i = int(crossed.argmax())
        raise InvalidInput(f"{name} is left nothing: lo[{i}] is {lower[i]:g} and hi[{i}] is {upper[i]:g}")


def says_of(member: Any) -> Any:
    """What writes the rows of a member."""
    member = member.constraint if isinstance(member, Softly) else member
    return member.says if isinstance(member, Exactly) else member


@final
class MotionBlock(Block):
    """A kinematic task or a contact: gains complete its rows. A task on the joints has no rows, it pulls on them."""

    #: The rows of a contact's friction cone.
    cone = _NONE

    def connect(self, motion: MotionRows, model: RobotModel) -> None:
        """Take the views to be written."""
        at = self.motion
        self._wanted, self._drift = motion.wanted[at], motion.drift[at] if motion.order == 2 else np.zeros(self.dim)
        self.out = self.into = out = TaskRows()
        out.e, out.drift, out.ed = motion.e[at], motion.drift[at], motion.own_ed[at]
        out.rate_ref, out.acc_ref = motion.rate_ref[at], motion.acc_ref[at]
        if self.has_rows:
            out.J = motion.J[at]
            out.J[:] = np.nan
            if self.anchor is None and self.says.on_joints:
                out.J[:], out.drift[:] = np.eye(model.nv)[model.nb :], 0.0

    def fill(self, state: RobotState) -> None:
        if self.anchor is None:
            self.says.fill(state, self.out)
        else:
            self.says.fill(state, self.anchor, self.out)

    def row_task(self) -> RowTask:
        rows, unknowns = (self.rows, None) if self.has_rows else (None, self.unknowns)
        return RowTask(
            self.name, rows, unknowns, self.weights, self._wanted, self._drift if self.has_rows else np.zeros(self.dim),
            kinematic=self.has_rows, scaled=self.member.is_scaled,
        )  # fmt: skip

    def check(self, order: int) -> None:
        self._refuse_unwritten("e", *("J", "drift")[: order if self.has_rows else 0])
        own = np.isnan(self.out.ed)
        if own.any() and not own.all():
            raise InvalidInput(f"{self.name}.fill wrote only a part of out.ed; write all of it or none")
        if order == 1:
            self.out.drift[:] = 0.0


@final
class RowBlock(Block):
    """A barrier, a linear constraint or a linear task; compiled code makes of its rows what the solver reads."""

    def connect(self, problem: RowProblem, model: RobotModel, dt: float, *, order: int, forces: Index) -> None:
        """Take the memory to be written; ``forces`` are the columns of the wrenches that a member on forces is about.

        A member on a joint's bounds writes A = I.
        """
        dim, items = self.dim, slice(problem.item(self.rows.start), problem.item(self.rows.stop))
        if isinstance(self.says, JointInterval):
            self.says = _IntervalRows(self.says, model, dt, order)
        is_barrier, second = isinstance(self.says, Barrier), order == 2
        about = BARRIER if is_barrier else _ABOUT.get(self.says.on, UNKNOWN)
        if about == VELOCITY and not second:
            about = UNKNOWN
        width = {FORCE: len(forces), TORQUE: model.nj}.get(about, model.nv)
        G, (lower, upper) = problem.G[self.rows], problem.bounds[:, items]
        A = G[:, : model.nv] if about in (BARRIER, UNKNOWN) else np.empty((dim, width))
        A[:] = np.nan
        into = self.into = TaskRows()
        into.e, into.drift, into.rate_ref, into.acc_ref = b, drift, rate, _ = np.zeros((4, dim))
        b[:], self._poison = np.nan, np.nan if is_barrier and second else 0.0
        if about in (BARRIER, UNKNOWN, VELOCITY):
            into.J = A
        self.A = A if about == FORCE else None
        kind = -1  # what b is: added to the right side (0), bounds (1), or neither
        if is_barrier:
            self.out = out = BarrierRows()
            out.J, out.h, out.drift, out.rate = A, b, drift, rate
        elif isinstance(self.says, LinearTask):
            self.out, kind = LinearRows(), int(isinstance(self.member, Exactly))
            self.out.A, self.out.b = A, b
        else:
            self.out = ConstraintRows()
            self.out.A, self.out.lo, self.out.hi = A, lower, upper
            lower[:], upper[:] = np.nan, np.nan
        self._numbers = np.array([0.0, dt])
        slack = self.unknowns.start if self.unknowns.stop else -1
        sizes = np.array([about, dim, model.nv, problem.n + 1, second, width, kind, slack], dtype=np.int64)
        self._memory = Memory(
            sizes, G, b, drift, rate, lower, upper, A, problem.G[model.nb : model.nv], forces.astype(np.int64),
            problem.scale, self._numbers,
        )  # fmt: skip
        self.finishing = self._memory.address
        self._drift = drift
        if isinstance(self.says, Within):
            self.into, row, sign, bound = self.says.picked()
            task, sizes = self.into, np.array([dim, *self.into.J.shape, problem.n + 1], dtype=np.int64)
            of_task = task.e, task.drift, task.rate_ref, task.acc_ref, task.J
            self._picked = Memory(sizes, row, sign, bound, *of_task, b, drift, rate, G)
            self.picking = self._picked.address

    def kernel_rows(self) -> KernelRows:
        self._read()
        return super().kernel_rows()

    def fill(self, state: RobotState) -> None:
        self._read()
        self._drift[:] = self._poison
        super().fill(state)
        if isinstance(self.says, LinearConstraint):
            refuse_crossed(self.name, self.out.lo, self.out.hi)
        v = np.ascontiguousarray(state.v)
        finish(self.finishing, v.__array_interface__["data"][0])

    def _read(self) -> None:
        if isinstance(self.says, Barrier):
            self._numbers[0] = self.says.rate

    def row_task(self) -> RowTask:
        rows, unknowns = (None, self.unknowns) if self.unknowns.stop else (self.rows, None)
        return RowTask(self.name, rows, unknowns, self.weights, np.zeros(self.dim), np.zeros(self.dim))

    def check(self, order: int) -> None:
        self._refuse_unwritten(*(what for what in self.out.__slots__ if what != "drift" or order == 2))


@final
class _IntervalRows:
    """Bounds on each joint's motion or torque as rows, for a constraint that may be broken."""

    def __init__(self, limit: JointInterval, model: RobotModel, dt: float, order: int) -> None:
        self._limit, self._bounds = limit, bounds_of(limit, model)
        self.on = "torque" if limit.quantity == "torque" else ""
        if not self.on:
            self._intervals, self._order = JointIntervals([limit], model, dt), order

    def fill(self, state: RobotState, out: ConstraintRows) -> None:
        out.A[:] = np.eye(out.A.shape[1])[-len(out.A) :]
        if not self.on:
            self._intervals.write(self._order, state.q_joints, state.v_joints, out.lo, out.hi)
            return
        out.lo[:], out.hi[:] = self._bounds
        if isinstance(self._limit, TorqueBySpeed):
            self._limit.narrow(state.v_joints, out.lo, out.hi)
