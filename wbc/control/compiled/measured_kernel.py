"""Whether numbers can be the state of a robot."""

from __future__ import annotations

from wbc.compiled import carray, entry, floats, integers
from wbc.tolerances import HUGE, ROUNDING

#: A quaternion whose norm differs from one by no more than this is rounded, and is normalised.
_ROUNDED = 1e-3


@entry
def spoilt(at: int) -> bool:
    """Whether a number of q and v is NaN or huge, or the quaternion of the base is none; a rounded one is normalised.

    At ``at``: sizes (nq + nv, whether q[3:7] is a quaternion), q and v (nq + nv,).
    """
    memory = carray(integers(at), 2)
    sizes = carray(integers(memory[0]), 2)
    moment = carray(floats(memory[1]), sizes[0])
    sound = 0
    for i in range(len(moment)):
        sound += int(abs(moment[i]) < HUGE)
    if sound < len(moment):
        return True
    if sizes[1]:
        square = 0.0
        for i in range(3, 7):
            square += moment[i] ** 2
        if abs(square - 1.0) > 2.0 * _ROUNDED:
            return True
        if abs(square - 1.0) > ROUNDING:
            for i in range(3, 7):
                moment[i] /= square**0.5
    return False
