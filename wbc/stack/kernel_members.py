"""Members whose rows a compiled kernel writes, in a tick and when they are called."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from wbc.models.model import RobotState
from wbc.stack.constraint import Barrier, BarrierRows, ConstraintRows, LinearConstraint
from wbc.stack.contact import Anchor, Contact, ContactRows
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.task import LinearRows, LinearTask, Task, TaskRows
from wbc.types import Mat, Vec

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


class KernelContact(Contact):
    """A contact whose motion rows a kernel writes."""

    @abstractmethod
    def kernel_rows(self) -> KernelRows:
        """Which kernel writes the rows, and what it reads."""

    def fill(self, state: RobotState, anchor: Anchor, out: ContactRows) -> None:
        rows = _called(self.kernel_rows(), self.dim, state, anchor=anchor)
        out.e[:], out.J[:], out.drift[:] = rows.e, rows.J, rows.drift


class KernelConstraint(LinearConstraint):
    """A linear constraint whose A a kernel writes, with A = J, and whose bounds stand."""

    @abstractmethod
    def kernel_rows(self) -> KernelRows:
        """Which kernel writes the rows, and what it reads."""

    @abstractmethod
    def bounds(self) -> tuple[Vec, Vec]:
        """lo and hi (dim,)."""

    def fill(self, state: RobotState, out: ConstraintRows) -> None:
        out.A[:] = _called(self.kernel_rows(), self.dim, state).J
        out.lo[:], out.hi[:] = self.bounds()


class KernelLinearTask(LinearTask):
    """A linear task that a kernel writes: A y = e − drift, A = J or what the kernel writes itself."""

    @abstractmethod
    def kernel_rows(self) -> KernelRows | None:
        """Which kernel writes the rows, and what it reads; None: ``fill`` writes them."""

    def fill(self, state: RobotState, out: LinearRows) -> None:
        said = self.kernel_rows()
        assert said is not None, f"{self.name} has no kernel, so it needs a fill"
        rows = _called(said, self.dim, state, out.A)
        out.b[:] = rows.e - rows.drift
        if not said.writes_A:
            out.A[:] = rows.J


def _called(
    said: KernelRows, dim: int, state: RobotState, A: Mat | None = None, anchor: Anchor | None = None
) -> Written:
    # Compiled code is loaded where rows are written, and not before.
    from wbc.stack.compiled.row_memory import called

    return called(said, dim, state, anchor, A if said.writes_A else None)
