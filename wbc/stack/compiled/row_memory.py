"""The memory of kernels that write rows from Pinocchio's: in ticks, or where one is called by itself."""

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


def kernel_of(name: str) -> callee:
    """The kernel "module:function".

    Raises:
        InvalidInput: there is none of this name.
    """
    module, _, function = name.partition(":")
    try:
        found = getattr(import_module(module), function, None)
    except (ImportError, TypeError, ValueError) as cause:
        raise InvalidInput(f'there is no kernel {name!r}, "module:function": {cause}') from cause
    if not isinstance(found, callee):
        kind = "a kernel" if found is None else "decorated with wbc.compiled.callee"
        raise InvalidInput(f"{module} has no function {function!r} that is {kind}")
    return found


def called(
    said: KernelRows, dim: int, state: RobotState, anchor: Anchor | None = None, A: Mat | None = None
) -> TaskRows:
    """The rows of a member in a state; of one on forces A, of this size, stands for J. Without drifts these are NaN.

    Raises:
        InvalidInput: the kernel does not write rows of this size.
    """
    rows = TaskRows()
    rows.e, rows.drift, rows.rate_ref, rows.acc_ref = np.zeros((4, dim))
    if A is None:
        rows.J = np.zeros((dim, state.model.nv)) if said.constant is None else said.constant
    if said.of and not state.drifts:
        rows.drift[:] = np.nan
    item = Item(said, state, rows, anchor, None if A is None else np.zeros(A.shape), second=state.drifts)
    for target in item.targets:
        target.follow(state.t)
    if row_kernel.write(item.memory.address) != 1:
        raise InvalidInput(f"it cannot have {item.C.shape[0]} rows about {item.C.shape[1]} numbers")
    if A is not None:
        rows.J = item.C
    return rows


@final
class Item:
    """The memory of one kernel: see :func:`wbc.stack.compiled.row_kernel.write`.

    ``second`` says whether accelerations are decided.
    """

    def __init__(
        self, said: KernelRows, state: RobotState, rows: TaskRows, anchor: Anchor | None, A: Mat | None, *,
        second: bool,
    ) -> None:  # fmt: skip
        self.kernel = kernel_of(said.kernel)
        dim, n, model = len(rows.e), len(said.of), state.model
        targets = [reference(state.t) for reference in said.follows]
        n_value = [sum(part.size for part in _parts(target)) for target in targets]
        n_rate = [len(target.rate) for target in targets]
        value, rate, moved = (np.zeros(sum(n)) for n in (n_value, n_rate, n_rate))
        places = (np.split(value, np.cumsum(n_value)), *(np.split(a, np.cumsum(n_rate)) for a in (rate, moved)))
        self.targets = [Following(*one) for one in zip(said.follows, *places, strict=False)]
        self.numbers = np.array(said.numbers, dtype=np.float64)
        self.C, placements = np.zeros((dim, 6 * n)) if A is None else A, np.zeros((n, 12))
        things = np.zeros((n, row_kernel.THING + model.nv), dtype=np.int64)
        owners = [_placed(things[k], placements[k], thing, state) for k, thing in enumerate(said.of)]
        J: Mat = getattr(rows, "J", np.zeros((0, 0)))
        if J.size and said.of:
            J[:] = 0.0  # kernels write the columns that move something
        width = J.strides[0] // J.itemsize if J.size and said.of else 0
        sizes = [
            self.kernel.place, dim, n, model.nv, width, bool(second), len(self.numbers), len(value), len(rate),
            model.nj, self.C.shape[1], J.__array_interface__["data"][0],
        ]  # fmt: skip
        anchor = Anchor(np.eye(3), np.zeros(3)) if anchor is None else anchor
        memory = row_kernel.LAYOUT.arrays(
            np.array(sizes, dtype=np.int64), things=things, placements=placements, C=self.C, e=rows.e, drift=rows.drift,
            rate_ref=rows.rate_ref, acc_ref=rows.acc_ref, numbers=self.numbers, value=value, rate=rate, second=moved,
            q=state.q_joints, v=state.v_joints, velocity=state.v, bias=np.asarray(getattr(state, said.bias)),
            other=anchor.rotation.T, origin=anchor.position,
        )  # fmt: skip
        self.memory, self._kept = Memory(*memory), (owners, anchor, J)

    def take(self, block: Block) -> None:
        """Read the settings again."""
        self.numbers[:] = block.kernel_rows().numbers


def _placed(thing: Any, placement: Vec, name: str, state: RobotState) -> Any:
    """Write where compiled code finds a thing; what owns that memory."""
    columns, zero = list(range(state.model.nv)), np.zeros(1)
    data = state.data
    if name == CENTRE:
        _ = state.com_jacobian  # so that the state computes it
        kind, arrays, owner = row_kernel.CENTRE, (zero, state.com, zero, state.com_drift, data.Jcom), data
    elif name == MOMENTUM:
        _ = state.centroidal_map
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
class Following:
    """Where a target goes: its value as numbers, (12,) of a pose, its rate and its acceleration."""

    __slots__ = ("_kept", "_reference", "_seen", "known", "rate", "second", "value")

    def __init__(self, reference: Callable[[float], Target], value: Vec, rate: Vec, second: Vec) -> None:
        self._reference, self.value, self.rate, self.second = reference, value, rate, second
        self._seen: Target | None = None
        #: Of the target seen last: its row in the table of motions, where kernels know it.
        self.known: list[list[int]] = []

    @property
    def is_called(self) -> bool:
        """Whether the target seen last is a function of time that kernels do not know."""
        return self._seen is not None and self._seen.function is not None and not self.known

    def follow(self, t: float) -> None:
        """Copy the target of time t, where it may be another one than before."""
        target = self._reference(t)
        if target is not self._seen:
            found = KnownMotion.of(target.function)
            self._seen, self.known = target, []
            if found is not None and found.size == len(self.value):
                self._kept = Memory(found.numbers, self.value, self.rate, self.second)
                self.known = [[found.kind, found.size, *self._kept.addresses.tolist()]]
        elif target.function is None:
            return
        first = 0
        for part in _parts(target):
            self.value[first : first + part.size] = part.ravel()
            first += part.size
        self.rate[:], self.second[:] = target.rate, target.second


def _parts(target: Target) -> tuple[Vec, ...]:
    value = target.value
    return value if isinstance(value, tuple) else (value,)
