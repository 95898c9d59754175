"""Members whose rows a compiled kernel writes, in a tick and when they are called."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from wbc.models.model import RobotState
from wbc.stack.constraint import Barrier, BarrierRows
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.task import LinearRows, LinearTask, Task, TaskRows

if TYPE_CHECKING:
    from wbc.stack.compiled.row_memory import Written


class KernelTask(Task):
    """A kinematic task that a kernel writes: subclasses say ``kernel_rows`` and no ``fill``."""

    @abstractmethod
    def kernel_rows(self) -> KernelRows:
        """Which kernel writes the rows, and what it reads."""

    def fill(self, state: RobotState, out: TaskRows) -> None:
        rows = _called(self.kernel_rows(), self.dim, state)
        out.e[:], out.rate_ref[:], out.acc_ref[:] = rows.e, rows.rate_ref, rows.acc_ref
        if not self.on_joints:
            out.J[:], out.drift[:] = rows.J, rows.drift


class KernelBarrier(Barrier):
    """A barrier that a kernel writes, with e for h and rate_ref for ∂h/∂t."""

    @abstractmethod
    def kernel_rows(self) -> KernelRows:
        """Which kernel writes the rows, and what it reads."""

    def fill(self, state: RobotState, out: BarrierRows) -> None:
        rows = _called(self.kernel_rows(), self.dim, state)
        out.h[:], out.J[:], out.drift[:], out.rate[:] = rows.e, rows.J, rows.drift, rows.rate_ref


class KernelLinearTask(LinearTask):
    """A linear task that a kernel writes: A y = e − drift, A = J."""

    @abstractmethod
    def kernel_rows(self) -> KernelRows:
        """Which kernel writes the rows, and what it reads."""

    def fill(self, state: RobotState, out: LinearRows) -> None:
        rows = _called(self.kernel_rows(), self.dim, state)
        out.A[:], out.b[:] = rows.J, rows.e - rows.drift


def _called(said: KernelRows, dim: int, state: RobotState) -> Written:
    # Compiled code is loaded where rows are written, and not before.
    from wbc.stack.compiled.row_memory import called

    return called(said, dim, state)
