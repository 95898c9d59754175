"""Stamps: what is made of the times that states and samples come with. Counters wrap, and one stamp may be wild."""

from __future__ import annotations

import math

#: A stamp further from the last one [s] is wild, unless the next one goes on from it: the clock has jumped then.
FAR = 0.5


def unwrapped(stamp: float, near: float, wraps: float) -> float:
    """The time [s] that a counter means which starts again at 0 after ``wraps`` [s]: the nearest to ``near`` [s].

    Example:
        >>> from wbc.robots.stamps import unwrapped
        >>> unwrapped(0.25, 9.75, 10.0), unwrapped(9.75, 10.25, 10.0), unwrapped(0.25, float("nan"), 10.0)
        (10.25, 9.75, 0.25)
    """
    turns = (near - stamp) / wraps
    return stamp if math.isnan(turns) or math.isinf(wraps) else stamp + wraps * round(turns)


def is_wild(stamp: float, taken: float, heard: float) -> bool:
    """Whether a stamp [s] is far from the last one that was ``taken``, and does not go on from the last that was
    ``heard``, taken or not; NaN: there is none.

    Example:
        >>> from wbc.robots.stamps import is_wild
        >>> is_wild(1e6, 2.0, 2.0), is_wild(2.1, 2.0, 1e6), is_wild(7.1, 2.0, 7.0)
        (True, False, False)
    """
    return abs(stamp - taken) > FAR and not 0.0 < stamp - heard <= max(FAR, heard - taken)
