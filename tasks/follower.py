"""Follower: the memory of a point, and of a turn, that follow samples with bounded velocity, acceleration and jerk."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.types import Mat, Vec

from .compiled.follow import LAYOUT, RESTS, WAKES, follow

#: A cell of the filter is this share of the lag.
CELLS = 60


@final
class Follower:
    """Goes from ``place`` after samples: m linear axes, or these and a turn as a quaternion x y z w.

    ``place`` and samples are (m,) or (m + 4,), ``limits`` on velocity, acceleration and jerk (m, 3) or (m + 3, 3); see
    :mod:`tasks.compiled.follow`. ``place``, ``rate`` and ``second`` are written by :meth:`advance`.
    """

    __slots__ = ("_memory", "_moves", "_sample", "_time", "place", "rate", "second")

    def __init__(self, place: Vec, limits: Mat, lag: float) -> None:
        n = len(limits)
        turning = 3 if len(place) > n else 0
        self._moves, self._time = np.array([n - turning, turning, RESTS]), np.array([0.0, lag / CELLS, 3.0 / lag])
        self._sample, self.place = place.copy(), place.copy()
        memory = LAYOUT.arrays(
            self._moves, time=self._time, limits=limits, sample=self._sample, place=place.copy(), there=self.place
        )
        self.rate, self.second = memory.rate, memory.second
        self._memory = Memory(*memory)

    def take(self, sample: Vec) -> None:
        """From the next cell on, or from now on where it rests, follow another sample."""
        self._sample[:] = sample
        if self._moves[2] == RESTS:
            self._moves[2] = WAKES

    def advance(self, seconds: float) -> None:
        """Go on in time."""
        self._time[0] += seconds
        follow(self._memory.address)
