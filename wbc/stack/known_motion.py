"""KnownMotion: a motion of the library as numbers, which compiled ticks evaluate instead of calling it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.types import Vec

#: Kinds of motions; NONE is called, or stands still.
NONE, SINUSOID, MINIMUM_JERK, POSE, SAMPLES, PIECEWISE = -1, 0, 1, 2, 3, 4


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
