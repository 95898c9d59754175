"""Members whose rows a compiled kernel writes, in a tick and when they are called."""

from __future__ import annotations

from abc import abstractmethod

from wbc.models.model import RobotState
from wbc.stack.constraint import Barrier, BarrierRows
from wbc.stack.contact import Anchor, Contact
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.member import Member
from wbc.stack.task import LinearRows, LinearTask, Task, TaskRows
from wbc.types import Mat


class KernelMember(Member):
    """Anything whose rows a kernel writes."""

    @abstractmethod
    def kernel_rows(self) -> KernelRows | None:
        """Which kernel writes the rows, and what it reads; None where ``fill`` writes them."""

    def _called(self, state: RobotState, anchor: Anchor | None = None, A: Mat | None = None) -> TaskRows:
        """The rows that the kernel writes; of a member on forces A, of this size, stands for J."""
        # Compiled code is loaded where rows are written, and not before.
        from wbc.stack.compiled.row_memory import called

        said = self.kernel_rows()
        assert said is not None, f"{self.name} has no kernel, so it needs a fill"
        return called(said, self.dim, state, anchor, A)


class KernelTask(Task, KernelMember):
    """A kinematic task that a kernel writes: subclasses say ``kernel_rows`` and no ``fill``."""

    def fill(self, state: RobotState, out: TaskRows) -> None:
        rows = self._called(state)
        out.e[:], out.rate_ref[:], out.acc_ref[:] = rows.e, rows.rate_ref, rows.acc_ref
        if not self.on_joints:
            out.J[:], out.drift[:] = rows.J, rows.drift


class KernelBarrier(Barrier, KernelMember):
    """A barrier that a kernel writes, with e for h and rate_ref for ∂h/∂t."""

    def fill(self, state: RobotState, out: BarrierRows) -> None:
        rows = self._called(state)
        out.h[:], out.J[:], out.drift[:], out.rate[:] = rows.e, rows.J, rows.drift, rows.rate_ref


class KernelContact(Contact, KernelMember):
    """A contact whose motion rows a kernel writes."""

    def fill(self, state: RobotState, anchor: Anchor, out: TaskRows) -> None:
        rows = self._called(state, anchor)
        out.e[:], out.J[:], out.drift[:] = rows.e, rows.J, rows.drift


class KernelLinearTask(LinearTask, KernelMember):
    """A linear task that a kernel writes: A y = e − drift, A = J or what the kernel writes itself."""

    def fill(self, state: RobotState, out: LinearRows) -> None:
        rows = self._called(state, A=out.A if self.on == "force" else None)
        out.A[:], out.b[:] = rows.J, rows.e - rows.drift
