"""KernelRows: what a member says of rows that a compiled kernel writes, in a tick and when it is called."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, Self, final

import numpy as np

from wbc.stack.target import Target
from wbc.stack.tracking import Tracking
from wbc.types import Index, Mat, Vec

Numbers = Vec | Index | Sequence[float]

#: What moves as a whole, beside frames: the centre of mass, and the momentum A_G v, linear before angular.
CENTRE: Final = "the centre of mass"
MOMENTUM: Final = "the momentum"
#: Where joints are and how they move: a kernel that reads these has no Jacobian to write.
NOTHING: tuple[str, ...] = ()


@final
@dataclass(frozen=True, eq=False)
class Followed:
    """A target: what it is at a time, and what a user gave."""

    reference: Callable[[float], Target]
    given: Callable[[], Any]


@final
@dataclass(frozen=True, eq=False)
class KernelRows:
    """Rows that are linear in how some things move: J = Σ Cᵢ Jᵢ and J̇ v = Σ Cᵢ (J̇ᵢ v) + bent.

    ``kernel`` "file.name" of :mod:`wbc.stack.compiled` writes e, C, bent, rate_ref and acc_ref; ``of`` are the things,
    each with six rows: frames by name (velocity of the origin, angular velocity, world axes), CENTRE or MOMENTUM.
    ``numbers`` are settings, read again where something is assigned; ``follows`` are targets.
    """

    kernel: str
    of: tuple[str, ...] = NOTHING
    numbers: Numbers = ()
    follows: tuple[Followed, ...] = ()
    #: J (dim, nv), or A of a member on torques, where it never changes.
    constant: Mat | None = None
    #: Whether the kernel writes A in the place of C: of a member on forces.
    writes_A: bool = False
    #: What a kernel reads beside: v, gravity "g" or all of "h", (nv,) each.
    bias: Literal["v", "g", "h"] = "v"

    @classmethod
    def tracking(
        cls, task: Tracking, kernel: str, *of: str, numbers: Numbers = (),
        also: tuple[Followed, ...] = (), **more: Any,
    ) -> Self:  # fmt: skip
        """Of a task with a ``target``."""
        return cls(kernel, of, numbers, (Followed(task.reference, lambda: task.target), *also), **more)

    @classmethod
    def of_joints(cls, offset: Vec, J: Mat) -> Self:
        """e = offset − J q, a row for each of ``offset`` (dim,); J (dim, nv) has nothing of the base."""
        return cls("joint.linear", numbers=np.concatenate([offset, J.ravel()]), constant=J)


def kernel_rows_of(member: Any) -> Callable[[], KernelRows] | None:
    """What asks a member for its kernel; None where it, or a subclass, or the object, writes its own rows."""
    if "fill" in vars(member):
        return None
    for kind in type(member).__mro__:
        if "kernel_rows" in vars(kind):
            said: Callable[[], KernelRows] = member.kernel_rows
            return None if member.kernel_rows() is None else said
        if "fill" in vars(kind):
            return None
    return None
