"""Rate: a loop in even periods, and how well it keeps them.

    deadline k   start + k dt, with start the first call; deadlines are never moved, so that no error adds up
    lateness     time at which a period begins, less its deadline: by how much the system woke up late, or the work
                 took too long
    late         calls that came after their deadline; they return at once
    missed       deadlines that had gone by then, one or more in each late call

After a late call the next deadline is the first one that is still ahead: what was missed is not made up for.

With ``warm`` the end of each wait is spent on a dry tick (:mod:`wbc.control.twin`), and what is left after it without
sleep: the tick that follows finds its code in the processor's caches. It begins as long before the deadline as dry
ticks took lately, and a quarter of it, and is left out where there is no time for it.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable
from math import floor
from typing import final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.control.controller import Controller
from wbc.control.twin import Twin
from wbc.control.watchdog import KEPT, Times, times

#: How much earlier than it takes a dry tick begins; how many of the last ones are looked at.
_SPARE, _LAST = 1.25, 16


@final
class Rate(metaclass=TellsArguments):
    """Sleeps until the next period begins.

    Statistics are of the last 10 000 periods, counts and ``worst`` of all. The operating system decides how even the
    periods are: a desktop wakes a process tens of microseconds late, and sometimes milliseconds.

    Args:
        dt: period [s].
        clock: seconds that never go back; another one makes runs repeatable.
        sleep: waits for about so many seconds of ``clock``; it is called again where it came back early.
        warm: a controller to keep warm; it does not notice. None: the whole wait is sleep.

    Raises:
        InvalidInput: a period that is not positive, a clock or sleep that cannot be called, no controller.

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
        warm: Controller | None = None,
    ) -> None:
        self.dt = checks.number("dt", dt, low=0.0, strict=True)
        for name, given in (("clock", clock), ("sleep", sleep)):
            checks.function(name, given, "a function of seconds")
        if warm is not None:
            checks.instance("warm", warm, Controller, "a controller")
        self._clock, self._sleep = clock, sleep
        self._dry = None if warm is None else Twin(warm)
        #: Dry ticks that were made.
        self.dry = 0
        # What the last dry ticks took and by how much the system woke up late [s]; after a sleep it is some three times
        # what it is now.
        took = 0.0 if self._dry is None else 3.0 * min(self._timed(self._dry) for _ in range(5))
        self._took, self._woke_late = deque([took] * _LAST, _LAST), deque([0.0] * _LAST, _LAST)
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
        if self._dry is not None:
            now = self._warmed(self._dry, now, due)
        while now < due:
            self._sleep(due - now)
            now = self._clock()
        self.periods += 1
        self._woke = now
        self._lateness.append(now - due)
        self.worst = max(self.worst, now - due)
        return self._k - before

    def _warmed(self, dry: Callable[[], None], now: float, due: float) -> float:
        """Sleep, make a dry tick and wait for the deadline, if there is time for it; the time then."""
        takes = _usual(self._took)
        wake = due - _SPARE * takes - _usual(self._woke_late)
        if now < wake:
            self._sleep(wake - now)
            now = self._clock()
            self._woke_late.append(max(now - wake, 0.0))
        if now + takes > due:
            self._took.append(min(self._took))  # else what was slow once would be believed for good
            return now
        self._took.append(self._timed(dry))
        self.dry += 1
        now = self._clock()
        while now < due:  # a sleep, however short, would have the caches lost again
            now = self._clock()
        return now

    def _timed(self, dry: Callable[[], None]) -> float:
        start = self._clock()
        dry()
        return self._clock() - start

    @property
    def lateness(self) -> Times | None:
        """Statistics of the delays with which periods began; None before the first period."""
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
        return f"{counts}, worst {1000.0 * self.worst:.3f} ms; lateness: {self.lateness}"


def _usual(last: Iterable[float]) -> float:
    """What all but two of the last did not exceed: once in a while the system does something else."""
    return sorted(last)[-3]
