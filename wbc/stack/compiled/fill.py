"""CompiledFill: a plan's hot path on one state. Tasks that users write are called; the rest is compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, final

import numpy as np

from wbc.compiled import Memory
from wbc.models.pinocchio_state import JointMemory, PinocchioState
from wbc.stack.compiled.row_memory import KernelItems, Written
from wbc.stack.compiled.rows_kernel import CENTRE, JOINTS, LOCAL, WORLD
from wbc.stack.contact import Contact
from wbc.stack.filled import Filled
from wbc.stack.frame_rows import FrameRows, JointRows
from wbc.stack.kernel_rows import kernel_rows_of
from wbc.stack.known_motion import NONE, KnownMotion
from wbc.stack.target import Target
from wbc.stack.writers import Writer
from wbc.types import Mat, Vec

#: A task or contact, its first row, its ``fill`` and what that writes into.
MotionMember = tuple[Any, int, tuple[Callable[..., None], tuple[Any, ...]]]

_Call = tuple[Callable[..., None], str, tuple[Any, ...]]

_ROTATION, _PLACE = slice(0, 9), slice(9, 12)


def _rows_of(member: Any) -> FrameRows | JointRows | None:
    """What a member says of its rows; None where it says nothing, or where a subclass or the object writes its own."""
    if "fill" in vars(member):
        return None
    for kind in type(member).__mro__:
        if "compiled_rows" in vars(kind):
            rows: FrameRows | JointRows | None = member.compiled_rows()
            return rows
        if "fill" in vars(kind):
            return None
    return None


@final
class CompiledFill:
    """Fills the motion rows, the centre, the dynamics and the joints' bounds of ``plan`` from ``state``.

    ``members`` write the motion rows. Those that say what their rows are (``compiled_rows``) are asked once, here, so
    that the state computes what they read and zeros stand where they are never written; all others are called in every
    tick. ``failed`` is told which of them raised, and what. A robot that is not Pinocchio's has no memory to read rows
    from: its members are all called, and the rest is compiled.

    ``is_complete`` is false where a member raised here: then the state may lack what its rows are read from.
    """

    def __init__(
        self, plan: Filled, state: Any, members: Iterable[MotionMember], writers: Iterable[Writer],
        failed: Callable[[str, Exception], None],
    ) -> None:  # fmt: skip
        self.state, self._failed = state, failed
        layout, motion, p, model = plan.layout, plan.motion, plan.problem, plan.model
        self._applied = plan.applied
        self._inertia: Mat | None = None
        self._calls: list[_Call] = []
        self._followers: list[_Follower] = []
        self._moving: list[_Follower] = []
        self._binding, self._targets = plan.binding, -1
        own_memory = isinstance(state, PinocchioState)
        items = _Items(state, model.nv)
        second = plan.level.order == 2
        self._kernels, self._later = (KernelItems(state, second=second, failed=failed) for _ in range(2))
        self._motion = motion
        first = layout.motion_row
        motion.clear()
        self.is_complete = True
        for member, row, (call, out) in members:
            rows = _rows_of(member) if own_memory else None
            kernel = kernel_rows_of(member) if own_memory else None
            if kernel is not None:
                if self._called(call, member.name, out):
                    self._kernels.add(member.name, kernel, Written.into(out[-1]))
                else:
                    self.is_complete = False
                continue
            if rows is None:
                self._calls.append((call, member.name, out))
                continue
            self.is_complete &= self._called(call, member.name, out)
            if isinstance(member, Contact):
                items.add(rows, row - first, out[0].rotation, out[0].position)
            else:
                target = np.zeros(model.nj if isinstance(rows, JointRows) else 12)
                self._followers.append(_Follower(member, rows, target, out[0]))
                items.add(rows, row - first, target, target[_PLACE])
        #: Those who write other rows in every tick, when all these are written.
        self.writers = [writer for writer in writers if not (own_memory and self._takes(writer))]
        dynamics, m = plan.level.dynamics, layout.n_rows - first
        self._sizes = np.array(
            [plan.level.order, model.nv, model.nb, layout.nf, p.n + 1, m, motion.n_joint_blocks, first,
             layout.contact_row, layout.n_u, dynamics, len(items), plan.intervals is not None, 0,
             len(self._followers), 0, 0], dtype=np.int64,
        )  # fmt: skip
        self._references, self._now = np.full((len(self._followers), 7), NONE, dtype=np.int64), np.zeros(1)
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
            q_joints, self._references, self._now, *items.arrays(), *intervals,
        )  # fmt: skip
        #: For the kernel that fills.
        self.address = self._memory.address

    @property
    def is_compiled(self) -> bool:
        """Whether no member writes its own rows."""
        return not (self._calls or self.writers)

    def __call__(self) -> None:
        """Write for what the state is now whatever is not compiled, and what the kernel reads."""
        state = self.state
        t = state.t
        if self._calls:
            self._motion.clear()
            for call, name, out in self._calls:
                self._called(call, name, out)
        if self._binding.targets != self._targets:
            self._targets = self._binding.targets
            self._moving = []
            for follower, reference in zip(self._followers, self._references, strict=True):
                moves = self._follow(follower, t)
                reference[:] = follower.compiled() if moves else NONE
                if moves and reference[0] == NONE:
                    self._moving.append(follower)
        else:
            for follower in self._moving:
                self._follow(follower, t)
        self._now[0] = t
        self._sizes[15], self._sizes[16] = self._kernels(t, self._targets), self._later(t, self._targets)
        if self._copies:
            dynamics = (state.M, state.h) if len(self._copies) > 2 else ()
            for copy, value in zip(self._copies, (state.v, state.q_joints, *dynamics), strict=True):
                copy[:] = value
        if self._applied.inertia is not self._inertia:
            self._inertia = more = self._applied.inertia
            self._sizes[13] = more is not None
            self._more_inertia[:] = 0.0 if more is None else more

    def _takes(self, writer: Writer) -> bool:
        """Whether compiled code writes the rows of a writer."""
        own = writer.own
        kernel = None if own is None else own.kernel()
        if own is None or kernel is None:
            return False
        own.reads(self.state.v)
        try:
            self._later.add(own.name, kernel, own.into(), own.finishing.address)
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

    def _follow(self, follower: _Follower, t: float) -> bool:
        """Whether this target has to be followed in every tick."""
        try:
            follower.follow(t)
        except Exception as cause:
            self._failed(follower.name, cause)
        return follower.moves


@final
class _Follower:
    """Where a task's target goes, and the views for its rates."""

    __slots__ = (
        "_acc_ref",
        "_had_rates",
        "_kept",
        "_parts",
        "_rate_ref",
        "_reference",
        "_seen",
        "_task",
        "moves",
        "name",
    )

    def __init__(self, task: Any, rows: FrameRows | JointRows, memory: Vec, out: Any) -> None:
        self._reference: Callable[[float], Target] = task.reference
        self.name: str = task.name
        self._task, self._kept = task, np.zeros(0)
        self._seen: Target | None = None
        #: Whether the target seen last is a function of time.
        self.moves = True
        self._had_rates = True
        self._rate_ref, self._acc_ref = out.rate_ref, out.acc_ref
        self._parts: tuple[Vec, ...]
        if isinstance(rows, JointRows):
            self._parts = (memory,)
        else:
            rotation, place = memory[_ROTATION].reshape(3, 3), memory[_PLACE]
            if rows.rows == (0, 1, 2, 3, 4, 5):
                self._parts = (rotation, place)
            elif rows.rows == (3, 4, 5):
                self._parts = (rotation,)
            else:
                step = rows.rows[1] - rows.rows[0] if len(rows.rows) > 1 else 1
                self._parts = (place[rows.rows[0] : rows.rows[-1] + 1 : step],)

    def follow(self, t: float) -> None:
        """Copy the target of time t, where it may be another one than before."""
        target = self._reference(t)
        if target is self._seen and not self.moves:
            return
        self._seen, self.moves = target, target.moves
        if len(self._parts) == 1:
            self._parts[0][:] = target.value
        else:
            self._parts[0][:], self._parts[1][:] = target.value
        if target.has_rates or self._had_rates:
            self._rate_ref[:], self._acc_ref[:] = target.rate, target.second
            self._had_rates = target.has_rates

    def compiled(self) -> list[int] | int:
        """The row of the table of references where the target is a motion that kernels know; else NONE."""
        known, place = KnownMotion.of(self._task.target), self._parts[0]
        if known is None or known.size != sum(part.size for part in self._parts):
            return NONE
        self._kept = known.numbers
        written = (self._kept, place, self._rate_ref, self._acc_ref)
        addresses = (int(array.__array_interface__["data"][0]) for array in written)
        self._had_rates = True
        return [known.kind, known.size, place.strides[-1] // place.itemsize, *addresses]


@final
class _Items:
    """The table that the kernel reads: of each item its kind, joint, columns, where its rows go, and its target."""

    def __init__(self, state: Any, nv: int) -> None:
        self._state, self._nv = state, nv
        self._items: list[list[int]] = []
        self._supports: list[list[int]] = []
        self._tables: list[Vec] = []
        self._addresses: list[Any] = []
        self._kept: list[Memory] = []

    def __len__(self) -> int:
        return len(self._items)

    def add(self, rows: FrameRows | JointRows, first: int, target: Vec, place: Vec) -> None:
        """Rows of one member, its first among the motion rows; ``place`` is the target's position."""
        where = [-1] * 6
        table, joint = np.zeros(27), JointMemory.none()
        if isinstance(rows, JointRows):
            kind, where[0] = JOINTS, first
        else:
            for i, row in enumerate(rows.rows):
                where[row] = first + i
            table[12:] = rows.table()
            kind = LOCAL if rows.axes == "local" else WORLD
            if not rows.frame:
                kind = CENTRE
            else:
                joint = self._state.joint_memory(rows.frame, rows.offset if kind == LOCAL else None)
                table[:12] = joint.placement
        turned = not isinstance(rows, JointRows) and rows.turn is not None
        self._items.append([kind, len(joint.columns), int(turned), *where])
        self._supports.append(joint.columns + [0] * (self._nv - len(joint.columns)))
        self._tables.append(table)
        memory = Memory(*joint.arrays, target, place)
        self._kept.append(memory)
        self._addresses.append(memory.addresses)

    def arrays(self) -> list[Any]:
        """In the order that the kernel wants."""
        k, nv = len(self), self._nv
        items = np.array(self._items, dtype=np.int64).reshape(k, 9)
        supports = np.array(self._supports, dtype=np.int64).reshape(k, nv)
        addresses = np.array(self._addresses, dtype=np.int64).reshape(k, 6)
        tables = np.array(self._tables, dtype=np.float64).reshape(k, 27)
        memory = self._state.memory() if isinstance(self._state, PinocchioState) else (np.zeros(1),) * 4
        return [items, supports, tables, addresses, *memory, np.zeros(42)]
