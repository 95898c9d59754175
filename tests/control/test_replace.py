"""controller.replace: another stack from the next tick on, and what both have goes on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from wbc.errors import Infeasible, InvalidInput, UnknownFrame
from wbc.stack.component import Component, Schedule
from wbc.tasks import (
    CenterOfMass,
    Damping,
    Frame,
    JointAccelerationLimits,
    JointJerkLimits,
    JointPositionLimits,
    JointVelocity,
    JointVelocityLimits,
    Orientation,
    Position,
    Posture,
    TorqueLimits,
    feet,
)

ARM, HUMANOID = wbc.load("arm"), wbc.load("humanoid")
DT = 1e-3
LEVELS = [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()]


class Memory(Component):
    """Counts what it is told."""

    def __init__(self) -> None:
        super().__init__(name="memory")
        self.prepared = self.resets = self.ticks = 0

    def prepare(self, model: Any) -> None:
        self.prepared += 1

    def reset(self, state: Any) -> None:
        self.resets += 1

    def after(self, state: Any, command: Any) -> None:
        self.ticks += 1


def run(controller: wbc.Controller, q: Any, v: Any, first: int, ticks: int) -> list[Any]:
    """Ticks from number ``first`` on that are followed exactly: commands."""
    commands = []
    for k in range(first, first + ticks):
        commands.append(controller.tick(k * DT, q, v))
        q, v = commands[-1].q, commands[-1].v
    return commands


def stacks(limits: list[Any]) -> dict[str, wbc.Stack]:
    """Stacks that ask for different motions of the arm."""
    target = np.array([0.4, 0.2, 0.5])
    return {
        "posture": wbc.Stack([Posture(ARM.q0 + 0.3)], subject_to=limits),
        "reach": wbc.Stack([Position("tool", target=target), Damping(weight=1e-3)], subject_to=limits),
        "levels": wbc.Stack([[Orientation("tool", target=np.eye(3))], [Posture(-ARM.q0)]], subject_to=limits),
        "away": wbc.Stack([Position("tool", target=-target)], subject_to=limits),
    }


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
@pytest.mark.parametrize("hierarchy", [wbc.Weighted(), wbc.Strict()], ids=lambda h: type(h).__name__)
@given(order=st.permutations(["posture", "reach", "levels", "away"]), when=st.integers(1, 40))
def test_the_command_changes_by_no_more_than_the_limits_allow(level: Any, hierarchy: Any, order: Any, when: int):
    most, jerk = 8.0, 400.0
    limits = [JointVelocityLimits(1.0), JointAccelerationLimits(most), JointJerkLimits(jerk)]
    if level.dynamics:
        limits.append(TorqueLimits())
    every = stacks(limits)
    controller = wbc.Controller(ARM, every[order[0]], level=level, hierarchy=hierarchy, dt=DT)
    commands = run(controller, ARM.q0, np.zeros(ARM.nv), 0, when)
    for i, name in enumerate(order[1:], start=1):
        controller.replace(every[name])
        assert controller.stack is every[name]
        commands += run(controller, commands[-1].q, commands[-1].v, i * when, when)
    assert all(command.status.ok for command in commands)
    v = np.array([np.zeros(ARM.nv), *(command.v for command in commands)])
    a = np.diff(v, axis=0) / DT
    assert np.abs(a).max() <= most * (1.0 + 1e-6)
    assert np.abs(np.diff(a, axis=0)).max(initial=0.0) <= jerk * DT * (1.0 + 1e-6)


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
def test_a_stack_that_replaces_itself_changes_nothing(level: Any):
    """The same commands as of a controller that was left alone; a new stack of the same members, too."""
    limits = [JointVelocityLimits(1.0), JointPositionLimits()]
    tasks = [Position("tool", target=[0.4, 0.2, 0.5]), Posture(ARM.q0, weight=1e-3)]

    def controller() -> wbc.Controller:
        return wbc.Controller(ARM, wbc.Stack(tasks, subject_to=limits), level=level, dt=DT)

    left, replaced = controller(), controller()
    q, v = ARM.q0, np.zeros(ARM.nv)
    for k in range(60):
        if k % 7 == 3:
            replaced.replace(wbc.Stack(tasks, subject_to=limits) if k % 2 else replaced.stack)
        command, same = left.tick(k * DT, q, v), replaced.tick(k * DT, q, v)
        np.testing.assert_allclose(same.v, command.v, rtol=1e-9, atol=1e-9)
        q, v = command.q, command.v


def test_limits_on_jerk_that_come_with_the_new_stack_count_from_the_last_acceleration():
    tasks, limits = [Posture(ARM.q0 + 0.3, kp=100.0)], [JointVelocityLimits(1.0)]
    controller = wbc.Controller(ARM, wbc.Stack(tasks, subject_to=limits), level=LEVELS[1], dt=DT)
    first = run(controller, ARM.q0, np.zeros(ARM.nv), 0, 5)[-1]
    assert np.abs(first.a).max() > 10.0
    controller.replace(wbc.Stack(tasks, subject_to=[*limits, JointJerkLimits(1000.0)]))
    then = run(controller, first.q, first.v, 5, 1)[-1]
    assert np.abs(then.a - first.a).max() <= 1000.0 * DT * (1.0 + 1e-9)


def test_the_active_set_is_guessed_from_rows_of_the_same_names():
    """A stack at its limits needs no more guesses after the change than before."""
    limits = [JointVelocityLimits(0.05), JointPositionLimits()]
    tasks = [Position("tool", target=[0.4, 0.2, 0.9]), Posture(ARM.q0, weight=1e-3)]
    controller = wbc.Controller(ARM, wbc.Stack(tasks, subject_to=limits), level=LEVELS[0], dt=DT)
    last = run(controller, ARM.q0, np.zeros(ARM.nv), 0, 20)[-1]
    assert controller.active_count >= 2
    controller.replace(wbc.Stack([*tasks, Damping(weight=1e-6)], subject_to=limits))
    run(controller, last.q, last.v, 20, 1)
    assert controller.iterations == 1


def test_contacts_of_the_same_name_stay_where_they_were_made_and_others_are_made_now():
    soles = feet(HUMANOID)
    level, posture = LEVELS[2], Posture(HUMANOID.q0, kp=100.0)
    com = HUMANOID.state().com + np.array([0.0, 0.0, -0.05])
    both = wbc.Stack([posture, CenterOfMass(target=com, kp=50.0)], contacts=soles)
    one = wbc.Stack([posture], contacts=[soles[0]])
    controller = wbc.Controller(HUMANOID, both, level=level, dt=DT)
    last = run(controller, HUMANOID.q0, np.zeros(HUMANOID.nv), 0, 50)[-1]
    made = [anchor.position.copy() for anchor in controller.plan.anchors]
    forces = last.forces
    controller.replace(one)
    assert set(last.f) == {sole.name for sole in soles}, "a command keeps the contacts that it was decided with"
    assert np.array_equal(np.concatenate([*last.f.values()]), forces)
    shifted = last.q.copy()
    shifted[0] += 0.01  # what is measured now does not move a contact that was made before
    after = controller.tick(50 * DT, shifted, last.v)
    np.testing.assert_array_equal(controller.plan.anchors[0].position, made[0])
    assert set(after.f) == {soles[0].name}
    controller.replace(both)
    controller.tick(51 * DT, shifted, last.v)
    np.testing.assert_array_equal(controller.plan.anchors[0].position, made[0])
    assert abs(controller.plan.anchors[1].position[0] - made[1][0] - 0.01) < 1e-3


@given(st.lists(st.sampled_from(["old", "new", "both", "none", "tick"]), min_size=1, max_size=8))
def test_a_component_that_stays_keeps_its_memory_and_others_begin(order: list[str]):
    """What is in the stack before and after ticks goes on; what was away, or never ticked, is prepared and reset."""
    members = {"old": Memory(), "new": Memory()}
    members["new"].__dict__["_name"] = "another memory"
    posture = Posture(ARM.q0)

    def stack(which: str) -> wbc.Stack:
        names = {"both": ["old", "new"], "none": []}.get(which, [which])
        return wbc.Stack([posture], components=[members[name] for name in names])

    controller = wbc.Controller(ARM, stack("old"), level=LEVELS[1], dt=DT)
    present, running, resets, prepared, tick = {"old"}, set[str](), {"old": 0, "new": 0}, {"old": 1, "new": 0}, 0
    for what in [*order, "tick"]:
        if what == "tick":
            controller.tick(tick * DT, ARM.q0, np.zeros(ARM.nv))
            tick += 1
            for name in present - running:
                resets[name] += 1
            running = set(present)
        else:
            controller.replace(stack(what))
            present = {"both": {"old", "new"}, "none": set()}.get(what, {what})
            for name in present - running:
                prepared[name] += 1
    assert {name: member.prepared for name, member in members.items()} == prepared
    assert {name: member.resets for name, member in members.items()} == resets
    assert controller.status.ok


class OnBothFeet(Schedule):
    """Keeps all contacts, and which command it was told was the last."""

    def __init__(self) -> None:
        super().__init__(name="on both feet")
        self.told: list[Any] = []

    def contact_sets(self) -> list[list[str]]:
        return [[sole.name for sole in feet(HUMANOID)]]

    def contacts(self, state: Any, last: Any) -> list[str]:
        self.told.append(last)
        return self.contact_sets()[0]


@pytest.mark.parametrize("others", [[], [Memory()]], ids=["alone", "with another"])
def test_a_schedule_that_stays_is_told_the_last_command_and_a_new_one_none(others: list[Component]):
    staying, new = OnBothFeet(), OnBothFeet()
    stacks = [
        wbc.Stack([Posture(HUMANOID.q0)], contacts=feet(HUMANOID), components=components)
        for components in ([*others, staying], [staying, *others], [new, *others], others, [staying])
    ]
    controller = wbc.Controller(HUMANOID, stacks[0], level=LEVELS[2], dt=DT)
    commands = [controller.tick(0.0, HUMANOID.q0, np.zeros(HUMANOID.nv))]
    for k, stack in enumerate(stacks[1:], start=1):
        controller.replace(stack)
        commands.append(controller.tick(k * DT, HUMANOID.q0, np.zeros(HUMANOID.nv)))
    assert staying.told == [None, commands[0], None] and new.told == [None]


@pytest.mark.parametrize(
    ("stack", "error"),
    [
        (None, InvalidInput),
        (wbc.Stack([Frame("nose", target=np.eye(4))]), UnknownFrame),
        (wbc.Stack([], subject_to=[JointVelocityLimits(0.1), JointVelocity(np.ones(ARM.nj)).exactly()]), Infeasible),
    ],
    ids=["None", "no such frame", "contradiction"],
)  # fmt: skip
def test_a_stack_that_makes_no_sense_leaves_the_one_before(stack: Any, error: type[Exception]):
    tasks = [Posture(ARM.q0 + 0.1)]
    left, asked = (wbc.Controller(ARM, wbc.Stack(tasks), level=LEVELS[0], dt=DT) for _ in range(2))
    q, v = ARM.q0, np.zeros(ARM.nv)
    for k in range(5):
        command, same = left.tick(k * DT, q, v), asked.tick(k * DT, q, v)
        assert np.array_equal(command.v, same.v)
        q, v = command.q, command.v
        with pytest.raises(error):
            asked.replace(stack)


@pytest.mark.parametrize("level", LEVELS)
def test_of_a_stack_without_a_tick_nothing_is_said(level: Any, tmp_path: Any):
    """Its problem is filled and not solved: it has no residuals, no active rows and no solution."""
    control = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0 + 0.1)]), level=level)
    said, kept = (control.tick(0.0, ARM.q0, np.zeros(ARM.nv)) for _ in range(2))
    certificate = str(said.certificate)
    control.replace(wbc.Stack([Posture(ARM.q0 - 0.1, name="other")]))
    assert control.explain() == "no tick yet with the stack that replaced the one before"
    with pytest.raises(InvalidInput, match="there is no tick yet with the stack"):
        control.explain(save=tmp_path / "none.npz")
    with pytest.raises(wbc.errors.WbcError, match="went on or began anew"):
        _ = kept.solution
    assert str(kept.certificate) == certificate, "of its own problem, whenever it is read"
    control.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    assert "other" in control.explain()
    control.reset()
    assert control.explain() == "no tick yet"


def test_the_log_counts_all_ticks_over_resets_and_other_stacks() -> None:
    robot = wbc.load("arm")
    stack = wbc.Stack([Posture(robot.q0)])
    controller = wbc.Controller(robot, stack, level=wbc.AccelerationLevel(), dt=1e-3)
    for renew in (controller.reset, lambda: controller.replace(stack), controller.reset):
        controller.tick(0.0, robot.q0, np.zeros(robot.nv))
        renew()
    controller.tick(0.0, np.full(robot.nq, np.nan), np.zeros(robot.nv))
    assert controller.fallbacks.log[-1].tick == 4
