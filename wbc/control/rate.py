"""Rate: a loop in even periods, and how well it keeps them.

    deadline k   start + k dt, with start the first call; deadlines are never moved, so that no error adds up
    lateness     time at which a period begins, less its deadline: by how much the system woke up late, or the work
                 took too long
    late         calls that came after their deadline; they return at once
    missed       deadlines that had gone by then, one or more in each late call

After a late call the next deadline is the first one that is still ahead: what was missed is not made up for.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from math import floor
from typing import final

import numpy as np

from wbc import checks
from wbc.control.watchdog import KEPT, Times, times
from wbc.errors import InvalidInput


@final
class Rate:
    """Sleeps until the next period begins.

    Statistics are of the last 10 000 periods, counts and ``worst`` of all. What the system can keep is its own matter:
    a desktop wakes a process tens of microseconds late, and sometimes milliseconds.

    Args:
        dt: period [s].
        clock: seconds that never go back; another one makes runs repeatable.
        sleep: waits for about so many seconds of ``clock``; it is called again where it came back early.

    Raises:
        InvalidInput: a period that is not positive, a clock or sleep that cannot be called.

    Example:
        >>> import wbc
        >>> rate = wbc.Rate(1e-3)
        >>> for tick in range(5):
        ...     passed = rate.sleep()  # then measure, tick, send
        >>> rate.periods
        4
        >>> rate.lateness.max == rate.worst >= 0.0
        True
    """

    def __init__(
        self,
        dt: float,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self.dt = checks.number("dt", dt, low=0.0, strict=True)
        for name, given in (("clock", clock), ("sleep", sleep)):
            if not callable(given):
                raise InvalidInput(f"{name} is {given!r}; it must be a function of seconds")
        self._clock, self._sleep = clock, sleep
        self.periods = self.late = self.missed = 0
        #: The largest lateness of all [s].
        self.worst = 0.0
        self._lateness: deque[float] = deque(maxlen=KEPT)
        self._work: deque[float] = deque(maxlen=KEPT)
        self.reset()

    def reset(self) -> None:
        """The next call starts anew, as after a pause; counts and statistics stay."""
        self._start: float | None = None
        self._k = 0

    def sleep(self) -> int:
        """Wait for the next deadline; how many deadlines have gone by since the last call: 1, or more in a late call.

        The first call starts the periods, and returns 0 at once.
        """
        now = self._clock()
        if self._start is None:
            self._start = self._woke = now
            return 0
        self._work.append(now - self._woke)
        before = self._k
        self._k += 1
        due = self._start + self._k * self.dt
        if now > due:
            self._k += floor((now - due) / self.dt)
            self.late += 1
            self.missed += self._k - before
        while now < due:
            self._sleep(due - now)
            now = self._clock()
        self.periods += 1
        self._woke = now
        self._lateness.append(now - due)
        self.worst = max(self.worst, now - due)
        return self._k - before

    @property
    def lateness(self) -> Times | None:
        """How late periods began; None before the first."""
        return times(self._lateness)

    @property
    def work(self) -> Times | None:
        """Time from the beginning of a period to the next call: what the loop itself took; None before the first."""
        return times(self._work)

    def percentile(self, percent: float) -> float:
        """The lateness [s] that so many percent of the periods did not exceed; NaN before the first.

        Raises:
            InvalidInput: a number outside [0, 100].
        """
        percent = checks.number("percent", percent, low=0.0, high=100.0)
        return float(np.percentile(list(self._lateness), percent)) if self._lateness else float("nan")

    def __str__(self) -> str:
        counts = f"{self.periods} periods, {self.late} late ({self.missed} deadlines missed)"
        if self.lateness is None:
            return counts
        ms = ", ".join(f"{name} {1e3 * value:.3f}" for name, value in self.lateness._asdict().items())
        return f"{counts}, worst {1e3 * self.worst:.3f} ms; lateness [ms]: {ms}"
