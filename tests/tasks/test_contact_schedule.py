"""A schedule names what its timeline says, and the loads it lets through come and go on ramps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import wbc
from tasks import ContactSchedule, JointCoupling
from tests.stack.conftest import Saying, standing
from wbc.stack.stack import Stack

QUADRUPED = wbc.load("quadruped")
FEET = tuple(QUADRUPED.feet)
DT = 1e-3

#: Timelines in ticks, so that times are never in doubt.
SETS = st.sets(st.sampled_from("abc")).map(frozenset)
TICKS = st.lists(st.integers(0, 60), min_size=1, max_size=6, unique=True).map(sorted)
TIMELINES = TICKS.flatmap(lambda ticks: st.tuples(*(st.tuples(st.just(DT * k), SETS) for k in ticks))).filter(
    lambda timeline: any(names for _, names in timeline)
)
PERIODS = st.none() | st.integers(61, 90).map(lambda k: DT * k)


class Clock:
    """A state of which only the time is looked at."""

    def __init__(self, t: float) -> None:
        self.t = t


def said(timeline: Any, period: float | None, tick: int) -> frozenset[str]:
    """What holds at a tick, looked up."""
    if period is not None:
        tick %= round(period / DT)
    begun = [names for start, names in timeline if round(start / DT) <= tick]
    return begun[-1] if begun else timeline[0 if period is None else -1][1]


def controller(*components: wbc.Component, contacts: Any = (), **standing_settings: Any) -> wbc.Controller:
    """Of a quadruped that stands."""
    stack = standing(QUADRUPED, **standing_settings)
    stack = Stack(
        stack.levels, subject_to=stack.subject_to, contacts=[*stack.contacts, *contacts], components=components
    )
    return wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics())


@given(TIMELINES, PERIODS, st.lists(st.integers(0, 200), min_size=1, max_size=12))
def test_the_set_is_that_of_the_timeline_at_every_tick_and_wherever_the_clock_jumps(
    timeline: Any, period: float | None, jumps: Any
) -> None:
    schedule = ContactSchedule(timeline, period=period)
    announced = schedule.contact_sets()
    for at in (range(200), jumps):
        schedule.reset(Clock(0.0))
        held = [schedule.contacts(Clock(DT * k), None) for k in at]
        assert held == [said(timeline, period, k) for k in at] and set(held) <= set(announced)


@pytest.mark.parametrize("back", [1.2, 0.5])
def test_a_foot_that_stands_keeps_its_load_when_the_clock_goes_back(back: float) -> None:
    opens = FEET[0]
    schedule = ContactSchedule([(0.0, FEET), (1.0, FEET[1:]), (1.1, FEET)], force_rate=np.inf)
    control = controller(schedule, shift=0.0)
    times = [0.0, 1.05, *np.arange(1.1, 2.0, DT), back, back + DT]
    loads = [control.tick(t, QUADRUPED.q0, np.zeros(QUADRUPED.nv)).f[opens][2] for t in times]
    assert loads[1] == 0.0 < 10.0 < loads[-3]
    assert loads[-2:] == pytest.approx(loads[-3:-2] * 2, rel=1e-6)


@given(TIMELINES, PERIODS, st.randoms(use_true_random=False))
def test_with_a_sensor_a_contact_is_made_when_it_touches_and_broken_when_the_timeline_says(
    timeline: Any, period: float | None, random: Any
) -> None:
    feels = {name: False for name in "abc"}
    schedule = ContactSchedule(timeline, period=period, touching=lambda name: feels[name], early=0.005)
    schedule.reset(Clock(0.0))
    announced, before = schedule.contact_sets(), schedule.contacts(Clock(0.0), None)
    assert before == said(timeline, period, 0)
    for tick in range(1, 200):
        feels = {name: random.random() < 0.3 for name in "abc"}
        held = schedule.contacts(Clock(DT * tick), None)
        assert held in announced
        soon = [said(timeline, period, tick + k) for k in range(6)]
        for name in "abc":
            if name in held - before:
                assert feels[name] and any(name in names for names in soon)
            if name in before - held:
                assert name not in soon[0]
            if name in soon[0] - held:
                assert not feels[name]
        before = held


def test_feet_that_land_together_may_touch_one_after_the_other_without_surprise() -> None:
    timeline = [(0.0, FEET), (0.1, FEET[:2]), (0.2, FEET)]
    announced = set(ContactSchedule(timeline, touching=lambda name: True).contact_sets())
    assert {frozenset((*FEET[:2], foot)) for foot in FEET[2:]} <= announced
    assert len(ContactSchedule(timeline).contact_sets()) == 2


@pytest.mark.parametrize("count", [8, 9, 16])
def test_of_many_feet_with_sensors_not_all_sets_are_announced(count: int) -> None:
    """But those of the timeline, each with one foot early or late too."""
    feet = [f"foot {k}" for k in range(count)]
    timeline = [(0.0, feet[::2]), (0.5, feet[1::2])]
    announced = ContactSchedule(timeline, period=1.0, touching=lambda name: True).contact_sets()
    assert len(set(announced)) == len(announced) == (256 if count == 8 else 2 + 2 * count)
    for _, names in timeline:
        assert frozenset(names) in announced
        assert all(frozenset(names) ^ {foot} in announced for foot in feet)


@given(st.floats(0.01, 0.1), st.sampled_from(FEET))
def test_the_normal_force_of_a_contact_comes_and_goes_no_faster_than_the_ramp(ramp: float, foot: str) -> None:
    others = [name for name in FEET if name != foot]
    schedule = ContactSchedule([(0.0, FEET), (0.15, others), (0.2, FEET)], ramp=ramp)
    loop, rest = controller(schedule), np.zeros(QUADRUPED.nv)
    forces, limits = [], []
    for k in range(350):
        command = loop.tick(DT * k, QUADRUPED.q0, rest)
        assert command.status.ok
        forces.append(command.f[foot][2])
        limits.append(schedule.signals()["limits"][schedule.names.index(foot)])
    step = 1e3 * ramp * QUADRUPED.mass * DT
    assert np.abs(np.diff(forces)).max() <= step * (1 + 1e-6)
    assert not any(forces[150:200]) and forces[149] <= 0.1 * step + 1e-9 and forces[200] <= 0.1 * step + 1e-9
    assert forces[0] > 10.0 * step and forces[349] == pytest.approx(forces[0], rel=1e-6)
    assert (np.array(forces) <= np.array(limits) + 1e-7).all()


def jolted(schedule: ContactSchedule, seed: int) -> tuple[wbc.Controller, np.ndarray]:
    """Normal forces (ticks, feet) of a robot whose base gets another velocity in every tick, and one foot goes."""
    loop, rng = controller(schedule), np.random.default_rng(seed)
    forces = []
    for k in range(80):
        v = np.zeros(QUADRUPED.nv)
        v[:6] = 0.05 * rng.normal(size=6)
        command = loop.tick(DT * k, QUADRUPED.q0, v)
        assert command.status.ok
        forces.append([command.f[foot][2] for foot in FEET])
    return loop, np.array(forces)


@pytest.mark.parametrize("steeper", [1.0, 3.0])
@given(seed=st.integers(0, 2**32 - 1), rate=st.floats(0.02, 0.2))
@settings(max_examples=5, phases=[Phase.generate])  # nothing to learn from shrinking states
def test_while_a_contact_goes_no_normal_force_moves_faster_than_the_force_rate(
    seed: int, rate: float, steeper: float
) -> None:
    timeline = [(0.0, FEET), (0.04, FEET[1:]), (0.07, FEET)]
    most = 1e3 * rate * QUADRUPED.mass * DT
    loop, forces = jolted(ContactSchedule(timeline, ramp=steeper * rate, force_rate=rate), seed)
    assert np.abs(np.diff(forces, axis=0)).max() <= most + 1e-6
    assert not loop.fallbacks.counts
    _, free = jolted(ContactSchedule(timeline, ramp=rate, force_rate=np.inf), seed)
    assert np.abs(np.diff(free, axis=0)).max() > most, "without the bound they would"


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=5, phases=[Phase.generate])
def test_while_a_contact_is_open_the_force_rate_holds_whatever_the_ramp(seed: int) -> None:
    timeline = [(0.0, FEET), (0.01, FEET[1:])]
    _, forces = jolted(ContactSchedule(timeline, ramp=1e6), seed)
    assert np.abs(np.diff(forces[11:], axis=0)).max() <= 1e3 * 0.05 * QUADRUPED.mass * DT + 1e-6


@pytest.mark.parametrize("stood", [FEET[:2], ()], ids=["on other feet", "in the air"])
@pytest.mark.filterwarnings("ignore::wbc.models.plausible.NothingHoldsTheBase")
def test_a_contact_that_the_former_stack_had_not_begins_without_force(stood: tuple[str, ...]) -> None:
    stack, rest = standing(QUADRUPED), np.zeros(QUADRUPED.nv)
    contacts = [contact for contact in stack.contacts if contact.frame in stood]
    former = Stack(stack.levels, subject_to=stack.subject_to, contacts=contacts)
    loop = wbc.Controller(QUADRUPED, former, level=wbc.InverseDynamics())
    assert loop.tick(0.0, QUADRUPED.q0, rest).status.ok
    schedule = ContactSchedule([(0.0, FEET), (0.02, FEET[1:])])
    loop.replace(Stack(stack.levels, subject_to=stack.subject_to, contacts=stack.contacts, components=[schedule]))
    most = 1e3 * schedule.force_rate * QUADRUPED.mass * DT
    for k in (1, 2):
        command = loop.tick(DT * k, QUADRUPED.q0, rest)
        assert command.status.ok and not loop.why
        assert all(command.f[name][2] <= k * most + 1e-6 for name in FEET if name not in stood)


def test_a_robot_may_be_in_the_air_from_beginning_to_end() -> None:
    loop = controller(ContactSchedule([(0.0, [])]))
    command = loop.tick(0.0, QUADRUPED.q0, np.zeros(QUADRUPED.nv))
    assert command.status.ok and not any(wrench.any() for wrench in command.f.values())
    state = QUADRUPED.state()
    np.testing.assert_allclose((state.M @ command.a + state.h)[:6], 0.0, atol=1e-6, err_msg="nothing holds the base")


def test_a_robot_that_stands_may_change_its_forces_as_fast_as_it_has_to() -> None:
    with_rate, without = (
        jolted(ContactSchedule([(0.0, FEET), (10.0, FEET[1:])], force_rate=rate), seed=0)[1] for rate in (0.05, np.inf)
    )
    np.testing.assert_array_equal(with_rate, without)


@given(seed=st.integers(0, 2**32 - 1), rate=st.floats(0.02, 0.2))
@settings(max_examples=5, phases=[Phase.generate])
def test_a_standing_rate_bounds_the_normal_forces_of_a_robot_on_all_its_feet(seed: int, rate: float) -> None:
    timeline = [(0.0, FEET), (10.0, FEET[1:])]
    loop, forces = jolted(ContactSchedule(timeline, standing_rate=rate), seed)
    steps = np.abs(np.diff(forces, axis=0)) / (1e3 * QUADRUPED.mass * DT)
    assert steps.max() == pytest.approx(rate, rel=1e-6), "it is reached, and not exceeded"
    assert not loop.fallbacks.counts


def test_a_schedule_may_name_a_part_of_the_mechanism_which_has_no_normal_force() -> None:
    gear = JointCoupling(QUADRUPED.joint_names[0], to={QUADRUPED.joint_names[3]: 1.0}).with_reaction()
    schedule = ContactSchedule([(0.0, [*FEET, gear.name]), (0.02, [*FEET[1:], gear.name])])
    loop, rest = controller(schedule, contacts=[gear]), np.zeros(QUADRUPED.nv)
    assert all(loop.tick(DT * k, QUADRUPED.q0, rest).status.ok for k in range(30))


def test_force_rates_are_relaxed_first_and_why_says_so() -> None:
    """From standing to falling in one tick: with torques that small, no force can be kept where it was."""
    saying = Saying()
    loop = controller(ContactSchedule([(0.0, FEET), (0.04, FEET[1:])]), saying)
    rest = np.zeros(QUADRUPED.nv)
    for k in range(20):
        assert loop.tick(DT * k, QUADRUPED.q0, rest).status.ok
    before = loop.last
    assert before is not None
    saying.now = wbc.Overrides(torque=(-0.5, 0.5))
    command = loop.tick(DT * 20, QUADRUPED.q0, rest)
    assert command.fallback_level == "relaxed" and command.certificate.ok
    assert loop.why.startswith("relaxed: force[") and np.abs(command.tau).max() <= 0.5 + 1e-6


def test_a_run_that_starts_again_starts_on_its_feet() -> None:
    schedule = ContactSchedule([(0.0, FEET), (0.01, FEET[1:])])
    loop, rest = controller(schedule), np.zeros(QUADRUPED.nv)
    first = [loop.tick(DT * k, QUADRUPED.q0, rest).tau for k in range(20)]
    loop.reset()
    again = [loop.tick(DT * k, QUADRUPED.q0, rest).tau for k in range(20)]
    np.testing.assert_allclose(again, first, atol=1e-9)
    assert schedule.signals()["contacts"].tolist() == [float(name != FEET[0]) for name in schedule.names]
