"""Watchdog: clocks that stand still or run backwards, ticks that come late or take too long.

All is counted, from two comparisons in a tick; ``refuse`` also answers a stale state and a clock that went back as a
state that is not to be believed, so with the last command or a stop.

    backwards   t < the t of the tick before
    stale       the same t for more than ``stale_ticks`` ticks in a row
    late        t more than ``late`` periods after the tick before; ``missed`` counts the periods in between
    over        the tick took more than ``budget`` seconds
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import isnan, nan
from time import perf_counter
from typing import NamedTuple, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.control.measured import NEVER

#: How many of the last durations, periods and latenesses statistics are made of.
KEPT = 10_000


@final
@dataclass(frozen=True, kw_only=True)
class Watchdog(metaclass=TellsArguments):
    """Settings.

    Args:
        stale_ticks: how many ticks may repeat a time before the state is stale.
        late: periods after which a tick is late.
        budget: time [s] a tick may take; None: ticks are not timed.
        refuse: whether to answer a stale state or a clock that went back with a fallback level instead of a solve.

    Raises:
        InvalidInput: a number out of range.
    """

    stale_ticks: int = 2
    late: float = 1.5
    budget: float | None = None
    refuse: bool = False

    def __post_init__(self) -> None:
        checks.number("stale_ticks", self.stale_ticks, low=0)
        checks.number("late", self.late, low=1.0, strict=True)
        if self.budget is not None:
            checks.number("budget", self.budget, low=0.0, strict=True)
        checks.truth("refuse", self.refuse)


class Times(NamedTuple):
    """Mean, standard deviation, 99th percentile and maximum [s]."""

    mean: float
    std: float
    p99: float
    max: float

    def __str__(self) -> str:
        return ", ".join(f"{name} {1000.0 * value:.3f}" for name, value in self._asdict().items()) + " ms"


@final
class Watch:
    """What a watchdog has seen of one controller, since it was made."""

    def __init__(self, settings: Watchdog, dt: float) -> None:
        self.settings, self._dt = settings, dt
        self.timed = settings.budget is not None
        self._most = settings.late * dt
        self.backwards = self.stale = self.late = self.missed = self.over = 0
        self._durations: deque[float] = deque(maxlen=KEPT)
        self.reset()

    def reset(self) -> None:
        """The next tick is the first; counts stay."""
        self._t = float("nan")
        self._repeats = 0

    def seen(self, t: float) -> str:
        """Take note of a tick at time t [s]; why its state is not to be believed, or nothing."""
        step = t - self._t
        self._t = t
        if 0.0 < step < self._most:
            self._repeats = 0
            return ""
        return self._odd(step)

    def _odd(self, step: float) -> str:
        if not abs(self._t) < NEVER:
            self._t = step = nan
        if isnan(step):
            return ""
        if step > 0.0:
            self._repeats = 0
            self.late += 1
            self.missed += round(step / self._dt) - 1
            return ""
        if step < 0.0:
            self.backwards += 1
            why = f"the clock went back by {-step:g} s"
        else:
            self._repeats += 1
            if self._repeats <= self.settings.stale_ticks:
                return ""
            self.stale += 1
            why = f"the state is stale: its time has been the same for {self._repeats + 1} ticks"
        return why if self.settings.refuse else ""

    def took(self, start: float) -> str:
        """Take note of how long a tick took that began at ``start``; what is wrong with that, or nothing."""
        seconds = perf_counter() - start
        self._durations.append(seconds)
        budget = self.settings.budget
        if budget is None or seconds <= budget:
            return ""
        self.over += 1
        return f"the tick took {1000.0 * seconds:.3g} ms of {1000.0 * budget:.3g} ms"

    @property
    def durations(self) -> Times | None:
        """How long the last ticks took; None where they are not timed."""
        return times(self._durations)

    def __str__(self) -> str:
        counts = f"{self.backwards} backwards, {self.stale} stale, {self.late} late ({self.missed} periods missed)"
        timed = self.durations
        if timed is None:
            return counts
        return f"{counts}, {self.over} over budget; ticks: {timed}"


def times(values: deque[float]) -> Times | None:
    """Statistics of these; None where there are none."""
    found = np.array(values)
    if not len(found):
        return None
    return Times(float(found.mean()), float(found.std()), float(np.percentile(found, 99)), float(found.max()))
