"""The memory of kernels that write rows: from Pinocchio's, for ticks, or from what any state gives, when called."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, final

import numpy as np

from wbc.compiled import Memory, callee
from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.models.views import JointMemory
from wbc.stack.block import Block
from wbc.stack.compiled import row_kernel
from wbc.stack.contact import Anchor
from wbc.stack.kernel_rows import CENTRE, MOMENTUM, KernelRows, KnownMotion
from wbc.stack.target import Target
from wbc.stack.task_rows import TaskRows
from wbc.types import Mat, Vec


def called(
    said: KernelRows, dim: int, state: RobotState, anchor: Anchor | None = None, A: Mat | None = None
) -> TaskRows:
    """The rows of a member in a state of any robot; of one on forces A, of this size, stands for J.

    Raises:
        InvalidInput: the kernel does not write rows of this size.
    """
    rows = TaskRows()
    rows.e, rows.drift, rows.rate_ref, rows.acc_ref = np.zeros((4, dim))
    rows.J = np.zeros((dim, state.model.nv)) if said.constant is None else said.constant
    item = _Item(said, state, rows, anchor, None if A is None else np.zeros(A.shape), second=None)
    for target in item.targets:
        target.follow(state.t)
    things = [_seen(thing, state) for thing in said.of]
    for place, motion, (at, own, rate) in zip(item.places, item.motions, things, strict=True):
        place[:] = at
        motion[: len(own)], motion[6 : 6 + len(own)] = own @ state.v, rate
    if item.kernel(item.memory.address) != 1:
        raise InvalidInput(f"it cannot have {item.C.shape[0]} rows about {item.C.shape[1]} numbers")
    if A is not None:
        rows.J = item.C
    rows.drift[:] = item.bent
    for k, (_, own, rate) in enumerate(things):
        C = item.C[:, 6 * k : 6 * k + len(own)]
        rows.J += C @ own
        rows.drift += C @ rate
    return rows


def _seen(thing: str, state: RobotState) -> tuple[Vec, Mat, Vec]:
    """Rotation and position (12,) of a thing, its Jacobian (6, nv), or (3, nv), and drift."""
    if thing == MOMENTUM:
        return np.zeros(12), state.centroidal_map, state.centroidal_drift
    if thing == CENTRE:
        return np.concatenate([np.zeros(9), state.com]), state.com_jacobian, state.com_drift
    frame = state.frame(thing)
    drift = frame.drift() if state.drifts else np.full(6, np.nan)
    return np.concatenate([frame.rotation.ravel(), frame.position]), frame.jacobian(), drift


@final
class KernelItems:
    """The members of a plan whose rows kernels write from one state of Pinocchio: all of them in one call."""

    def __init__(
        self, state: RobotState, now: Vec, *, second: bool, failed: Callable[[str, Exception], None]
    ) -> None:  # fmt: skip
        self._state, self._now, self._second, self._failed = state, now, second, failed
        self._items: list[tuple[Block, _Item]] = []
        #: Targets that users write, with the names of their tasks.
        self.moving: list[tuple[str, _Following]] = []

    def add(self, block: Block) -> None:
        """The rows of one member more."""
        said = block.kernel_rows()
        item = _Item(said, self._state, block.into, block.anchor, block.A, second=self._second)
        self._items.append((block, item))
        block.reads(self._state.v)

    def follow(self, t: float) -> None:
        """Follow the targets that users write."""
        for name, target in self.moving:
            self._follow(name, target, t)

    def read(self, t: float) -> int:
        """Settings again, and which targets move; what :func:`~wbc.stack.compiled.finish_kernel.write_all` reads."""
        known: list[list[int]] = []
        self.moving = []
        for block, item in self._items:
            try:
                item.numbers[:] = block.kernel_rows().numbers
            except Exception as cause:
                self._failed(block.name, cause)
            for target in item.targets:
                self._follow(block.name, target, t)
                if target.function is not None:
                    row = target.known()
                    if row is None:
                        self.moving.append((block.name, target))
                    else:
                        known.append(row)
        sizes = np.array([len(self._items), len(known)], dtype=np.int64)
        addresses = [[item.memory.address, block.finishing] for block, item in self._items]
        references, items = np.array(known, dtype=np.int64), np.array(addresses, dtype=np.int64)
        self._memory = Memory(sizes, references, self._now, items)
        return self._memory.address if self._items else 0

    def _follow(self, name: str, target: _Following, t: float) -> None:
        try:
            target.follow(t)
        except Exception as cause:
            self._failed(name, cause)


@final
class _Item:
    """The memory of one kernel: see :func:`wbc.stack.compiled.row_kernel.write`.

    ``second`` says whether accelerations are decided; None where a kernel is called by itself.
    """

    def __init__(
        self, said: KernelRows, state: RobotState, rows: TaskRows, anchor: Anchor | None, A: Mat | None, *,
        second: bool | None,
    ) -> None:  # fmt: skip
        file, name = said.kernel.split(".")
        self.kernel: callee = getattr(import_module(f"wbc.stack.compiled.{file}_kernel"), name)
        dim, n, model = len(rows.e), len(said.of), state.model
        targets = [reference(state.t) for reference in said.follows]
        n_value = [sum(part.size for part in _parts(target)) for target in targets]
        n_rate = [len(target.rate) for target in targets]
        value, rate, moved = (np.zeros(sum(n)) for n in (n_value, n_rate, n_rate))
        places = (np.split(value, np.cumsum(n_value)), *(np.split(a, np.cumsum(n_rate)) for a in (rate, moved)))
        self.targets = [_Following(*one) for one in zip(said.follows, *places, strict=False)]
        self.numbers = np.array(said.numbers, dtype=np.float64)
        self.places, self.motions, placements = np.zeros((3, n, 12))
        self.C, self.bent = np.zeros((dim, 6 * n)) if A is None else A, np.zeros(dim)
        things, owners = np.zeros((n, row_kernel.THING + model.nv), dtype=np.int64), []
        if second is not None:
            owners = [_placed(things[k], placements[k], thing, state) for k, thing in enumerate(said.of)]
        J: Mat | None = getattr(rows, "J", None)
        if J is not None and said.of and second is not None:
            J[:] = 0.0  # kernels write the columns that move something
        width = J.strides[0] // J.itemsize if J is not None and said.of else 0
        sizes = [
            self.kernel.place, dim, n, model.nv, width, bool(second), len(self.numbers), len(value), len(rate),
            model.nj, self.C.shape[1],
        ]  # fmt: skip
        anchor = Anchor(np.eye(3), np.zeros(3)) if anchor is None else anchor
        self.memory = Memory(
            np.array(sizes, dtype=np.int64), things, placements, self.places, self.motions, self.C, self.bent,
            np.zeros(1) if J is None else J, rows.e, rows.drift, rows.rate_ref, rows.acc_ref, self.numbers, value, rate,
            moved, np.asarray(state.q_joints), np.asarray(state.v_joints), anchor.rotation, anchor.position,
            np.asarray(state.v), np.zeros(row_kernel.WORK), np.asarray(getattr(state, said.bias)),
        )  # fmt: skip
        self._kept = owners, anchor


def _placed(thing: Any, placement: Vec, name: str, state: RobotState) -> Any:
    """Write where compiled code finds a thing; what owns that memory."""
    columns, zero = list(range(state.model.nv)), np.zeros(1)
    data = state.data
    if name in {CENTRE, MOMENTUM}:
        _seen(name, state)  # so that the state computes it
    if name == CENTRE:
        kind, arrays, owner = row_kernel.CENTRE, (zero, state.com, zero, state.com_drift, data.Jcom), data
    elif name == MOMENTUM:
        kind, arrays, owner = row_kernel.MOMENTUM, (zero, zero, zero, state.centroidal_drift, data.Ag), data
    else:
        joint: JointMemory = state.joint_memory(name)
        placement[:], columns = joint.placement, joint.columns
        kind, arrays, owner = row_kernel.FRAME, (*joint.arrays, data.J), joint
    memory = Memory(*arrays)
    thing[: 2 + len(arrays)] = [kind, len(columns), *memory.addresses]
    thing[row_kernel.THING : row_kernel.THING + len(columns)] = columns
    return memory, owner


@final
class _Following:
    """Where a target goes: its value as numbers, (12,) of a pose, its rate and its acceleration."""

    __slots__ = ("_kept", "_reference", "_seen", "function", "rate", "second", "value")

    def __init__(self, reference: Callable[[float], Target], value: Vec, rate: Vec, second: Vec) -> None:
        self._reference, self.value, self.rate, self.second = reference, value, rate, second
        self._seen: Target | None = None
        #: The function of time that the target seen last is; None for a value.
        self.function: Callable[[float], Any] | None = None

    def follow(self, t: float) -> None:
        """Copy the target of time t, where it may be another one than before."""
        target = self._reference(t)
        if target is self._seen and self.function is None:
            return
        self._seen, self.function = target, target.function
        first = 0
        for part in _parts(target):
            self.value[first : first + part.size] = part.ravel()
            first += part.size
        self.rate[:], self.second[:] = target.rate, target.second

    def known(self) -> list[int] | None:
        """The row of the table of motions, where kernels know this one."""
        found = KnownMotion.of(self.function)
        if found is None or found.size != len(self.value):
            return None
        self._kept = Memory(found.numbers, self.value, self.rate, self.second)
        return [found.kind, found.size, *self._kept.addresses.tolist()]


def _parts(target: Target) -> tuple[Vec, ...]:
    value = target.value
    return value if isinstance(value, tuple) else (value,)
