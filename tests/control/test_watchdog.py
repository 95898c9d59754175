"""What goes wrong with time is seen within one tick, counted, and refused where that was asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

import wbc
from tests.reliability.faults import limited
from wbc.control.watchdog import Watch, Watchdog
from wbc.errors import InvalidInput
from wbc.types import Status

ARM = wbc.load("arm")
STILL = np.zeros(ARM.nv)
LEVEL = wbc.VelocityLevel()
DT = 1e-3


def controller(**settings: object) -> wbc.Controller:
    return wbc.Controller(ARM, limited(ARM, LEVEL), level=LEVEL, dt=DT, watchdog=Watchdog(**settings))  # type: ignore[arg-type]


def test_a_steady_clock_is_no_matter():
    control = controller(refuse=True)
    assert all(control.tick(k * DT, ARM.q0, STILL).status.ok for k in range(20))
    assert str(control.watch) == "0 backwards, 0 stale, 0 late (0 periods missed)"


@pytest.mark.parametrize("refuse", [False, True])
def test_a_clock_that_goes_back_is_seen_at_once(refuse: bool):
    control = controller(refuse=refuse)
    control.tick(1.0, ARM.q0, STILL)
    command = control.tick(0.5, ARM.q0, STILL)
    assert control.watch.backwards == 1
    assert command.status is (Status.INVALID_STATE if refuse else Status.SOLVED)
    if refuse:
        assert command.fallback_level == "hold" and "went back by 0.5 s" in control.explain()
    assert control.tick(0.501, ARM.q0, STILL).status.ok, "it goes on from there"


@pytest.mark.parametrize("refuse", [False, True])
def test_a_state_that_does_not_change_is_stale_after_two_ticks(refuse: bool):
    control = controller(refuse=refuse)
    statuses = [control.tick(0.0, ARM.q0, STILL).status for _ in range(5)]
    stale = Status.INVALID_STATE if refuse else Status.SOLVED
    assert statuses == [Status.SOLVED] * 3 + [stale] * 2
    assert control.watch.stale == 2
    assert control.tick(DT, ARM.q0, STILL).status.ok


def test_missed_periods_are_counted():
    control = controller()
    for t in (0.0, 1.0 * DT, 5.0 * DT, 6.0 * DT, 9.0 * DT):
        control.tick(t, ARM.q0, STILL)
    assert (control.watch.late, control.watch.missed) == (2, 5)


def test_ticks_over_budget_are_counted_and_written_down():
    def clock() -> Iterator[float]:
        now = 0.0
        for k in range(100):
            yield now
            now += 2e-3 if k % 10 == 0 else 1e-4

    ticking = clock()
    control = controller(budget=DT, clock=lambda: next(ticking))
    for k in range(50):
        control.tick(k * DT, ARM.q0, STILL)
    assert control.watch.over == 10
    assert control.watch.durations is not None and control.watch.durations.max == pytest.approx(2e-3)
    assert control.watch.periods is not None and control.watch.periods.mean == pytest.approx(DT)
    assert [event.why for event in control.fallbacks.log] == ["the tick took 2 ms of 1 ms"] * 10
    assert "10 over budget" in str(control.watch)


def raising() -> float:
    raise OSError("no such device")


@pytest.mark.parametrize(
    ("clock", "said"),
    [
        (raising, "OSError: no such device"),
        (lambda: float("nan"), "nan"),
        (lambda: float("inf"), "inf"),
        (lambda: "noon", "noon"),
        (lambda: None, "None"),
        (lambda: 1j, "1j"),
        (lambda: [1.0, 2.0], "[1.0, 2.0]"),
        (lambda: 1 << 5000, "must be a number, not 141"),
    ],
)
@pytest.mark.parametrize("from_tick", [0, 3])
def test_a_clock_that_fails_makes_no_tick_raise(clock: Callable[[], object], said: str, from_tick: int):
    """The command stands as it was decided, bounded; the status says that it was not timed, and why."""
    calls = iter(range(1000))
    control = controller(budget=DT, clock=lambda: clock() if next(calls) >= 2 * from_tick else 0.0)
    untimed = controller()
    for k in range(8):
        command, same = control.tick(k * DT, ARM.q0, STILL), untimed.tick(k * DT, ARM.q0, STILL)
        assert np.array_equal(command.v, same.v) and command.fallback_level == "solved"
        assert command.status.ok is (k < from_tick) and control.status is command.status
        assert ("clock" in control.why and said in control.why) is (k >= from_tick)
    assert control.watch.over == 0 and len(control.fallbacks.log) == 8 - from_tick
    assert control.watch.durations is None or control.watch.durations.max == 0.0


def test_a_clock_that_runs_backwards_within_a_tick_is_named():
    times = iter(np.arange(100.0, 0.0, -1.0))
    control = controller(budget=DT, clock=lambda: float(next(times)))
    assert not control.tick(0.0, ARM.q0, STILL).status.ok
    assert "clock" in control.why and "went back by 1 s" in control.why


def test_lateness_in_a_hundred_thousand_ticks_is_counted_exactly():
    rng = np.random.default_rng(0)
    kind = rng.choice(4, size=100_000, p=[0.97, 0.01, 0.01, 0.01])
    watch, t = Watch(Watchdog(stale_ticks=0), DT), 0.0
    watch.seen(t)
    for k in kind:
        t += (DT, 4.0 * DT, 0.0, -DT)[k]
        watch.seen(t)
    assert (watch.late, watch.stale, watch.backwards) == tuple((kind == k).sum() for k in (1, 2, 3))
    assert watch.missed == 3 * watch.late


def test_settings_that_make_no_sense_are_refused():
    for settings in ({"stale_ticks": -1}, {"late": 1.0}, {"budget": 0.0}, {"clock": 3}, {"late": np.nan}):
        with pytest.raises(InvalidInput, match=next(iter(settings))):
            Watchdog(**settings)  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="watchdog"):
        wbc.Controller(ARM, limited(ARM, LEVEL), level=LEVEL, watchdog=True)  # type: ignore[arg-type]
