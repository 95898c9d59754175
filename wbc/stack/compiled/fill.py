"""CompiledFill: a plan's hot path on one state. Tasks that users write are called; the rest is compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np

from wbc.compiled import Memory
from wbc.errors import InvalidInput, MemberFailed
from wbc.stack.block import Block
from wbc.stack.compiled.row_memory import Following, Item, kernel_of
from wbc.stack.filled import Filled
from wbc.stack.kernel_rows import kernel_rows_of
from wbc.types import Mat


@final
class CompiledFill:
    """Fills the motion rows, the centre, the dynamics and the joints' bounds of ``plan`` from ``state``.

    Blocks whose members say their rows by a kernel are asked once, here; all others are called in every tick: those of
    motion rows here, ``others``, when all these are written, by the plan. ``attempt(name, function, argument)`` calls
    one, keeps who raised, and what, and returns whether nobody did.

    ``is_complete`` is false where a member raised here: then it is called, which says why, until it is asked again.
    """

    def __init__(self, plan: Filled, state: Any, attempt: Callable[..., bool]) -> None:
        self.state, self._attempt = state, attempt
        layout, motion, p, model = plan.layout, plan.motion, plan.problem, plan.model
        self._applied, self._binding, self._references = plan.applied, plan.binding, motion.numbers[2:4]
        self._inertia: Mat | None = None
        second = plan.level.order == 2
        self._now, self._version = np.zeros(1), -1
        #: Those whose rows kernels write: of motion rows, and of others.
        self._items: tuple[list[tuple[Block, Item]], ...] = [], []
        #: Targets that users write, with the names of their tasks.
        self.moving: list[tuple[str, Following]] = []
        self.is_complete = True

        def takes(k: int, block: Block) -> bool:
            """Whether compiled code writes the rows of a block."""
            said = kernel_rows_of(block.says)
            if said is None:
                return False
            try:
                kernel_of(said.kernel)
            except InvalidInput as cause:  # a member's own fill would hide it
                raise MemberFailed(f"{block.name}.kernel_rows", cause) from cause
            try:
                item = Item(block.kernel_rows(), state, block.into, block.anchor, block.A, second=second)
            except Exception:
                self.is_complete = False
                return False
            self._items[k].append((block, item))
            return True

        self._calls = [block for block in layout.motions if not takes(0, block)]
        #: Those who write other rows in every tick, when all these are written.
        self.others = [block for block in layout.others if not takes(1, block)]
        dynamics, first = plan.level.dynamics, layout.motion_row
        self._sizes = np.array(
            [plan.level.order, model.nv, model.nb, layout.nf, p.n + 1, layout.n_rows - first, motion.n_joint_blocks,
             first, layout.contact_row, layout.n_u, dynamics, 0, 0, 0, len(p.lower)], dtype=np.int64,
        )  # fmt: skip
        scale = p.scale[model.nv : model.nv + layout.nf]
        self._more_inertia = np.zeros((model.nv, model.nv))
        v = state.v
        of_dynamics = [state.M, state.h, plan.extra_bias, scale, self._more_inertia] if dynamics else [v] * 5
        self._memory = Memory(
            self._sizes, p.G, motion.numbers, plan.shares, p.centre, v, *of_dynamics, *plan.joint_bound_rows,
            state.q_joints, *plan.intervals.memory, p.lower, p.upper,
        )  # fmt: skip
        #: Of either kind of items: rows of the motions that kernels know, and what the kernel reads.
        self._known: list[list[list[int]]] = [[], []]
        self._tables = [self._table(items, []) for items in self._items]
        self._sizes[12:14] = [table.address for table in self._tables]
        #: For the kernel that fills.
        self.address = self._memory.address

    @property
    def is_compiled(self) -> bool:
        """Whether no member writes its own rows."""
        return not (self._calls or self.others)

    def __call__(self) -> None:
        """Write for what the state is now whatever is not compiled, and what the kernel reads."""
        state = self.state
        if self._calls:
            self._references[:] = 0.0  # those that a task does not write are zero, in every tick
            for block in self._calls:
                self._attempt(block.name, block.fill, state)
        self._now[0] = t = state.t
        if self._version == self._binding.version:
            for name, target in self.moving:
                self._attempt(name, target.follow, t)
        else:
            self._read(t)
        if self._applied.inertia is not self._inertia:
            self._inertia = more = self._applied.inertia
            self._sizes[11] = more is not None
            self._more_inertia[:] = 0.0 if more is None else more

    def _read(self, t: float) -> None:
        """Settings and targets of what has changed, where one raises in the next tick too; which targets move."""
        since, self._version, self.moving = self._version, self._binding.version, []
        for k, items in enumerate(self._items):
            known: list[list[int]] = []
            for block, item in items:
                changed = self._binding.has_changed(block.member, since)
                read = not changed or self._attempt(block.name, item.take, block)
                for target in item.targets:
                    if changed or target.is_called:
                        read &= self._attempt(block.name, target.follow, t)
                    known += target.known
                    if target.is_called:
                        self.moving.append((block.name, target))
                if not read:
                    self._version = since
            if known != self._known[k]:
                self._known[k], self._tables[k] = known, self._table(items, known)
                self._sizes[12 + k] = self._tables[k].address

    def _table(self, items: list[tuple[Block, Item]], known: list[list[int]]) -> Memory:
        """What :func:`~wbc.stack.compiled.finish_kernel.write_all` reads."""
        sizes = np.array([len(items), len(known)], dtype=np.int64)
        addresses = [[item.memory.address, block.picking, block.finishing] for block, item in items]
        return Memory(sizes, np.array(known, dtype=np.int64), self._now, np.array(addresses, dtype=np.int64))
