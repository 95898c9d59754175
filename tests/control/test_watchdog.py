"""What goes wrong with time is seen within one tick, counted, and refused where that was asked for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import wbc
from tests.reliability.faults import limited
from wbc.control.watchdog import Watch, Watchdog
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


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_a_tick_in_a_state_that_is_none_is_still_a_tick_in_time(bad: float):
    control = controller(refuse=True)
    for k in range(10):
        control.tick(k * DT, np.full(ARM.nq, bad) if k == 4 else ARM.q0, STILL)
    assert str(control.watch) == "0 backwards, 0 stale, 0 late (0 periods missed)"


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, -1e300])
def test_a_time_that_is_none_is_not_counted(bad: float):
    control = controller(refuse=True)
    statuses = [control.tick(bad if k == 4 else k * DT, ARM.q0, STILL).status for k in range(10)]
    assert statuses == [Status.INVALID_STATE if k == 4 else Status.SOLVED for k in range(10)]
    assert str(control.watch) == "0 backwards, 0 stale, 0 late (0 periods missed)"


def test_ticks_over_budget_are_counted_and_written_down(monkeypatch: pytest.MonkeyPatch):
    def clock() -> Iterator[float]:
        now = 0.0
        for k in range(100):
            yield now
            now += 2e-3 if k % 10 == 0 else 1e-4

    ticking = clock()
    for module in (wbc.control.controller, wbc.control.watchdog):
        monkeypatch.setattr(module, "perf_counter", lambda: next(ticking))
    control = controller(budget=DT)
    for k in range(50):
        control.tick(k * DT, ARM.q0, STILL)
    assert control.watch.over == 10
    assert control.watch.durations is not None and control.watch.durations.max == pytest.approx(2e-3)
    assert [event.why for event in control.fallbacks.log] == ["the tick took 2 ms of 1 ms"] * 10
    assert "10 over budget" in str(control.watch)


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
