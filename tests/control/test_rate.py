"""A rate keeps its deadlines in place, and every one that was missed is counted; time here is made up."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from wbc.tasks import Posture

DT = 2.0**-10  # sums of it are exact


class Time:
    """A clock that only work and sleep move on; sleep comes back ``late`` seconds late, or early where negative."""

    def __init__(self, late: float = 0.0) -> None:
        self.now, self.late, self.asked = 5.0, late, list[float]()

    def clock(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.asked.append(seconds)
        self.now += max(seconds + self.late, DT / 64)

    def rate(self) -> wbc.Rate:
        return wbc.Rate(DT, clock=self.clock, sleep=self.sleep)


def test_the_first_call_starts_and_does_not_wait():
    time = Time()
    rate = time.rate()
    assert rate.sleep() == 0 and not time.asked
    assert rate.lateness is None and rate.work is None and np.isnan(rate.percentile(50))
    assert str(rate) == "0 periods, 0 late (0 deadlines missed)"


def test_periods_begin_on_their_deadlines_whatever_the_work_in_between():
    time = Time()
    rate = time.rate()
    rate.sleep()
    for k in range(1, 20):
        time.now += DT * (k % 4) / 4
        assert rate.sleep() == 1
        assert time.now == 5.0 + k * DT
    assert (rate.periods, rate.late, rate.missed, rate.worst) == (19, 0, 0, 0.0)
    assert rate.work is not None and rate.work.max == 0.75 * DT


def test_a_sleep_that_comes_back_early_is_asked_again():
    time = Time(late=-DT / 8)
    rate = time.rate()
    rate.sleep()
    rate.sleep()
    assert time.now >= 5.0 + DT and len(time.asked) > 1


def test_a_system_that_wakes_late_is_late_every_time_but_does_not_add_up():
    time = Time(late=DT / 4)
    rate = time.rate()
    for _ in range(101):
        rate.sleep()
    assert rate.lateness is not None and rate.lateness.mean == rate.worst == rate.percentile(0) == DT / 4
    assert time.now == 5.0 + 100.25 * DT and rate.missed == 0


def test_a_long_tick_misses_the_deadlines_in_it_and_the_next_one_is_ahead():
    time = Time()
    rate = time.rate()
    rate.sleep()
    time.now += 3.5 * DT
    assert rate.sleep() == 3 and not time.asked and time.now == 5.0 + 3.5 * DT
    assert (rate.periods, rate.late, rate.missed, rate.worst) == (1, 1, 3, 2.5 * DT)
    assert rate.sleep() == 1 and time.now == 5.0 + 4.0 * DT
    assert rate.percentile(100) == 2.5 * DT and rate.percentile(0) == 0.0
    assert "2 periods, 1 late (3 deadlines missed), worst 2.441 ms" in str(rate)


def test_after_a_reset_a_pause_is_not_lateness():
    time = Time()
    rate = time.rate()
    rate.sleep()
    time.now += 100.0
    rate.reset()
    assert rate.sleep() == 0 and rate.sleep() == 1
    assert (rate.periods, rate.late, rate.worst) == (1, 0, 0.0)


@given(st.lists(st.integers(0, 400), max_size=60), st.integers(0, 30))
def test_every_deadline_is_waited_for_or_missed(work: list[int], late: int):
    """Deadlines that have gone by, by the clock, are those that were kept and those that were missed."""
    time = Time(late=late * DT / 64)
    rate = time.rate()
    rate.sleep()
    passed = 0
    for ticks in work:
        time.now += ticks * DT / 64
        began = time.now
        step = rate.sleep()
        passed += step
        assert step >= 1 and time.now >= began
        assert passed == (time.now - 5.0) // DT, "the period we are in is the one the clock is in"
    assert passed == rate.missed + (rate.periods - rate.late)
    assert rate.periods == len(work)


class Dry:
    """A dry tick that takes ``seconds`` of a clock that moves on by itself a little whenever it is read."""

    def __init__(self, time: Time, seconds: float) -> None:
        self.time, self.seconds, self.begun = time, seconds, list[float]()

    def __call__(self) -> None:
        self.begun.append(self.time.now)
        self.time.now += self.seconds

    def clock(self) -> float:
        self.time.now += DT / 4096
        return self.time.now

    def rate(self, monkeypatch: pytest.MonkeyPatch) -> wbc.Rate:
        monkeypatch.setattr("wbc.control.rate.Twin", lambda controller: self)
        robot = wbc.load("arm")
        controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel())
        rate = wbc.Rate(DT, clock=self.clock, sleep=self.time.sleep, warm=controller)
        self.begun.clear()
        return rate


@pytest.mark.parametrize("late", [0.0, DT / 32])
def test_a_dry_tick_ends_shortly_before_each_deadline(monkeypatch: pytest.MonkeyPatch, late: float):
    time = Time(late)
    dry = Dry(time, DT / 8)
    rate = dry.rate(monkeypatch)
    rate.sleep()
    start = time.now
    for k in range(1, 60):
        time.now += DT / 4  # the work
        assert rate.sleep() == 1
        assert time.now - (start + k * DT) < DT / 100
        left = start + k * DT - dry.begun[-1] - dry.seconds
        assert 0.0 < left < DT / 2  # at first it is taken to be slower
    assert rate.dry == len(dry.begun) == 59 and rate.late == 0
    assert left < DT / 16


def test_where_there_is_no_time_for_it_there_is_no_dry_tick_and_no_delay(monkeypatch: pytest.MonkeyPatch):
    time = Time()
    dry = Dry(time, DT / 2)
    rate = dry.rate(monkeypatch)
    rate.sleep()
    for _ in range(20):
        time.now += 0.7 * DT
        assert rate.sleep() == 1
    assert rate.late == rate.dry == 0 and rate.worst < DT / 100
