"""CompiledFill: a plan's hot path on one state. Tasks that users write are called; the rest is compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, final

import numpy as np

from wbc.compiled import Memory
from wbc.models.pinocchio_state import PinocchioState
from wbc.stack.compiled.row_memory import KernelItems, Written
from wbc.stack.contact import Contact
from wbc.stack.filled import Filled
from wbc.stack.kernel_rows import kernel_rows_of
from wbc.stack.writers import Writer
from wbc.types import Mat

#: A task or contact, its first row, its ``fill`` and what that writes into.
MotionMember = tuple[Any, int, tuple[Callable[..., None], tuple[Any, ...]]]

_Call = tuple[Callable[..., None], str, tuple[Any, ...]]


@final
class CompiledFill:
    """Fills the motion rows, the centre, the dynamics and the joints' bounds of ``plan`` from ``state``.

    ``members`` write the motion rows, ``writers`` those of barriers, torques and forces. Those that say their rows by a
    kernel are asked once, here; all others are called in every tick, the writers by the plan. ``failed`` is told which
    of them raised, and what. A robot that is not Pinocchio's has no memory to read rows from: its members are all
    called, and the rest is compiled.

    ``is_complete`` is false where a member raised here: then the state may lack what its rows are read from.
    """

    def __init__(
        self, plan: Filled, state: Any, members: Iterable[MotionMember], writers: Iterable[Writer],
        failed: Callable[[str, Exception], None],
    ) -> None:  # fmt: skip
        self.state, self._failed = state, failed
        layout, motion, p, model = plan.layout, plan.motion, plan.problem, plan.model
        self._applied, self._binding, self._motion = plan.applied, plan.binding, motion
        self._inertia: Mat | None = None
        self._calls: list[_Call] = []
        own_memory, second = isinstance(state, PinocchioState), plan.level.order == 2
        self._now, self._version = np.zeros(1), -1
        self._tasks, self._others = (KernelItems(state, self._now, second=second, failed=failed) for _ in range(2))
        motion.clear()
        self.is_complete = True
        for member, _, (call, out) in members:
            kernel = kernel_rows_of(member) if own_memory else None
            if kernel is None:
                self._calls.append((call, member.name, out))
            elif self._called(call, member.name, out):
                anchor = out[0] if isinstance(member, Contact) else None
                self._tasks.add(member.name, kernel, Written.into(out[-1], anchor))
            else:
                self.is_complete = False
        #: Those who write other rows in every tick, when all these are written.
        self.writers = [writer for writer in writers if not (own_memory and self._takes(writer))]
        dynamics, first = plan.level.dynamics, layout.motion_row
        self._sizes = np.array(
            [plan.level.order, model.nv, model.nb, layout.nf, p.n + 1, layout.n_rows - first, motion.n_joint_blocks,
             first, layout.contact_row, layout.n_u, dynamics, plan.intervals is not None, 0, 0, 0], dtype=np.int64,
        )  # fmt: skip
        writes_ed = np.zeros(len(motion.e)) if motion.writes_ed is None else motion.writes_ed.astype(np.float64)
        scale = p.scale[model.nv : model.nv + layout.nf]
        self._more_inertia = np.zeros((model.nv, model.nv))
        read = [state.v, state.q_joints, *([state.M, state.h] if dynamics else [])]
        #: Of a robot that may answer with new arrays each time: what is read of it, and where the kernel finds it.
        self._copies = [] if own_memory else [np.array(value) for value in read]
        v, q_joints, *of_dynamics = self._copies or read
        of_dynamics = [*of_dynamics, plan.extra_bias, scale, self._more_inertia] if dynamics else [v] * 5
        bounds = (np.array([plan.dt]), *plan.joint_bound_rows)
        intervals = () if plan.intervals is None else plan.intervals.memory()
        self._memory = Memory(
            self._sizes, p.G, motion.e, motion.drift, motion.rate_ref, motion.acc_ref, motion.kp, motion.kd,
            motion.rate, motion.own_ed, writes_ed, motion.wanted, plan.shares, p.centre, v, *of_dynamics, *bounds,
            q_joints, *intervals,
        )  # fmt: skip
        #: For the kernel that fills.
        self.address = self._memory.address

    @property
    def is_compiled(self) -> bool:
        """Whether no member writes its own rows."""
        return not (self._calls or self.writers)

    def __call__(self) -> None:
        """Write for what the state is now whatever is not compiled, and what the kernel reads."""
        state, version = self.state, self._binding.targets
        if self._calls:
            self._motion.clear()
            for call, name, out in self._calls:
                self._called(call, name, out)
        self._now[0] = t = state.t
        if version != self._version:
            self._version = version
            self._sizes[13:] = self._tasks.read(t), self._others.read(t)
        else:
            self._tasks.follow(t)
            self._others.follow(t)
        if self._copies:
            dynamics = (state.M, state.h) if len(self._copies) > 2 else ()
            for copy, value in zip(self._copies, (state.v, state.q_joints, *dynamics), strict=True):
                copy[:] = value
        if self._applied.inertia is not self._inertia:
            self._inertia = more = self._applied.inertia
            self._sizes[12] = more is not None
            self._more_inertia[:] = 0.0 if more is None else more

    def _takes(self, writer: Writer) -> bool:
        """Whether compiled code writes the rows of a writer."""
        own = writer.own
        kernel = None if own is None else own.kernel()
        if own is None or kernel is None:
            return False
        own.reads(self.state.v)
        try:
            self._others.add(own.name, kernel, own.into(), own.finishing.address)
        except Exception:
            return False  # when it is called it says why
        return True

    def _called(self, call: Callable[..., None], name: str, out: tuple[Any, ...]) -> bool:
        """Whether a member wrote its rows; one that raises is told of."""
        try:
            call(self.state, *out)
        except Exception as cause:
            self._failed(name, cause)
            return False
        return True
