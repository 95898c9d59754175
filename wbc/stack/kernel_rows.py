"""KernelRows: what a member says of rows that a compiled kernel writes, in a tick and when it is called."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, Self, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.stack.target import Target
from wbc.stack.tracking import Tracking
from wbc.types import Index, Mat, Vec

Numbers = Vec | Index | Sequence[float]

#: What moves as a whole, beside frames: the centre of mass, and the momentum A_G v, linear before angular.
CENTRE: Final = "the centre of mass"
MOMENTUM: Final = "the momentum"
#: Kinds of motions.
SINUSOID, MINIMUM_JERK, POSE, SAMPLES, PIECEWISE = range(5)


@final
@dataclass(frozen=True, eq=False)
class KernelRows:
    """Rows that are linear in how some things move: J = Σ Cᵢ Jᵢ and J̇ v = Σ Cᵢ (J̇ᵢ v) + bent.

    ``kernel`` "module:function", a :class:`wbc.compiled.callee` of any module, writes e, C, bent, rate_ref and acc_ref
    of :class:`wbc.stack.compiled.row_kernel.Rows`; ``of`` are the things, each with six rows: frames by name (velocity
    of the origin, angular velocity, world axes), CENTRE or MOMENTUM.
    ``numbers`` are settings, read again where something is assigned; ``follows`` give targets at a time [s].
    """

    kernel: str
    #: () for where joints are and how they move: such a kernel has no Jacobian to write. Nor has one of a member on
    #: forces, which writes A in the place of C.
    of: tuple[str, ...] = ()
    numbers: Numbers = ()
    follows: tuple[Callable[[float], Target], ...] = ()
    #: J (dim, nv), or A of a member on torques, where it never changes.
    constant: Mat | None = None
    #: What a kernel reads beside: v, gravity "g" or all of "h", (nv,) each.
    bias: Literal["v", "g", "h"] = "v"
    #: Whether rows in metres are the way of the one thing to its target along the axes of the world: reports draw it.
    leads: bool = False

    @classmethod
    def tracking(
        cls, task: Tracking, kernel: str, *of: str, numbers: Numbers = (),
        also: tuple[Callable[[float], Target], ...] = (), **more: Any,
    ) -> Self:  # fmt: skip
        """Of a task with a ``target``."""
        return cls(kernel, of, numbers, (task.reference, *also), **more)


@final
@dataclass(frozen=True, eq=False)
class KnownMotion:
    """``numbers`` are what :mod:`wbc.stack.compiled.reference_kernel` says of the ``kind``; ``size`` is that of its
    value: of a pose 12, its rotation by rows and its position."""

    kind: int
    size: int
    numbers: Vec

    @classmethod
    def of(cls, motion: Any) -> KnownMotion | None:
        """What a motion says of itself; None where it has to be called."""
        known = getattr(motion, "known_motion", None)
        found: KnownMotion | None = None if known is None else known()
        return found

    @classmethod
    def piecewise(cls, starts: Sequence[float], motions: Sequence[Any]) -> Self | None:
        """One motion after another, where all are known.

        Raises:
            InvalidInput: known motions of several sizes.
        """
        found = [cls.of(motion) for motion in motions]
        known = [motion for motion in found if motion is not None]
        sizes = {motion.size for motion in known}
        if len(sizes) > 1:
            said = " and ".join(map(str, sorted(sizes)))
            raise InvalidInput(f"pieces give values of {said} numbers; they must all give as many")
        if len(known) < len(found):
            return None
        first = 1 + 3 * len(known)
        where = first + np.cumsum([0, *(len(motion.numbers) for motion in known[:-1])])
        table = [[len(known)], starts, [motion.kind for motion in known], where]
        return cls(PIECEWISE, known[0].size, np.concatenate([*table, *(motion.numbers for motion in known)]))


def kernel_rows_of(member: Any) -> KernelRows | None:
    """What a member says of its kernel; None where it, or a subclass, or the object, writes its own rows."""
    for names in (vars(member), *map(vars, type(member).__mro__)):
        if "kernel_rows" in names:
            found: KernelRows | None = member.kernel_rows()
            return found
        if "fill" in names:
            return None
    return None
