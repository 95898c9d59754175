"""One stack, a plan for each set of its contacts: each is the plan of a stack that has only these, memory in common."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import ContactForce, Edge
from tests.stack.conftest import bounds_on, moving, standing
from wbc.errors import InvalidInput, UnknownName
from wbc.stack.stack import Stack

QUADRUPED = wbc.load("quadruped")
FEET = tuple(QUADRUPED.feet)
SETS = st.sets(st.sampled_from(FEET), min_size=2).map(frozenset)


class Named(wbc.Schedule):
    """Says what it is told to say; announces what it is told to announce."""

    def __init__(self, now: Iterable[str], announced: Iterable[Iterable[str]] = ()) -> None:
        super().__init__()
        self.now, self.announced = frozenset(now), [now, *announced]
        self.prepared = 0
        self.says: wbc.Overrides | None = None

    def prepare(self, model: Any) -> None:
        self.prepared += 1

    def before(self, state: Any, last: object, plan: Any) -> wbc.Overrides | None:
        return self.says

    def contact_sets(self) -> Iterable[Iterable[str]]:
        return self.announced

    def contacts(self, state: Any, last: object) -> frozenset[str]:
        return self.now


def stack_of(*components: wbc.Component, extra: tuple[Any, ...] = (), torques: bool = True) -> Stack:
    stack = standing(QUADRUPED, extra=extra)
    constraints = [constraint for constraint in stack.subject_to if torques or constraint.quantity != "torque"]
    return Stack(stack.levels, subject_to=constraints, contacts=stack.contacts, components=components)


def scheduled(schedule: Named, extra: tuple[Any, ...] = (), level: Any = None) -> wbc.Controller:
    level = level or wbc.InverseDynamics()
    return wbc.Controller(QUADRUPED, stack_of(schedule, extra=extra, torques=level.dynamics), level=level)


@given(first=SETS, second=SETS, seed=st.integers(0, 9))
@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()], ids=repr)
def test_after_any_change_the_answer_is_that_of_a_stack_with_these_contacts_alone(
    first: frozenset[str], second: frozenset[str], seed: int, level: Any
) -> None:
    schedule = Named(first, [second])
    controller = scheduled(schedule, level=level)
    q, v = moving(QUADRUPED, seed)
    controller.tick(0.0, q, v)
    schedule.now = second
    alone = stack_of(torques=level.dynamics).standing_on({f"Point[{foot}]" for foot in second})
    other = wbc.Controller(QUADRUPED, alone, level=level)
    for t in (0.001, 0.002):
        both, only = controller.tick(t, q, v), other.tick(t, q, v)
        assert both.status is only.status is wbc.Status.SOLVED
        np.testing.assert_allclose(both.v, only.v, atol=1e-8)
    # At the first tick DAQP may have answered one of them: it counts the base's regularisation, the dual form does not.
    np.testing.assert_allclose(both.tau, only.tau, atol=1e-6)
    for foot in FEET if level.dynamics else ():
        np.testing.assert_allclose(both.f[foot], only.f[foot] if foot in second else np.zeros(3), atol=1e-6)


def test_the_forces_of_all_contacts_keep_their_places() -> None:
    schedule = Named(FEET[1:])
    command = scheduled(schedule).tick(0.0, QUADRUPED.q0, np.zeros(QUADRUPED.nv))
    assert command.forces is not None and command.forces.shape == (12,) and not command.forces[:3].any()
    assert sum(command.f[foot][2] for foot in FEET) == pytest.approx(command.forces[2::3].sum())


def test_a_contact_that_stays_is_held_where_it_was_made_and_a_new_one_where_the_robot_is() -> None:
    schedule = Named(FEET[:3], [FEET])
    controller = scheduled(schedule)
    q, v = moving(QUADRUPED, 1)
    controller.tick(0.0, q, v)
    before = [controller.state.frame(foot).position.copy() for foot in FEET]
    schedule.now = frozenset(FEET)
    controller.tick(0.001, moving(QUADRUPED, 5)[0], v)
    now, plan = [controller.state.frame(foot).position.copy() for foot in FEET], controller.plan
    made = [
        anchor.position + np.array([0.0, 0.0, QUADRUPED.feet[foot].radius])
        for foot, anchor in zip(FEET, plan.anchors, strict=True)
    ]
    np.testing.assert_allclose(made, [*before[:3], now[3]], atol=1e-12)
    assert np.linalg.norm(np.subtract(now, before), axis=1).min() > 1e-3


def test_what_components_moved_and_what_they_remember_survives_a_change() -> None:
    schedule = Named(FEET, [FEET[1:]])
    controller = scheduled(schedule)
    q, v = moving(QUADRUPED, 2)
    controller.tick(0.0, q, v)
    schedule.says = wbc.Overrides(torque=bounds_on(3, 1.0, QUADRUPED.nj), normal_limits={FEET[1]: 7.0})
    controller.tick(0.0005, q, v)
    schedule.now = frozenset(FEET[1:])
    command = controller.tick(0.001, q, v)
    assert controller.plan.torque_bounds[1][3] == 1.0 and command.tau[3] <= 1.0 + 1e-8
    assert command.f[FEET[1]][2] <= 7.0 + 1e-8
    assert schedule.prepared == 1


@given(st.sampled_from(FEET), st.floats(0.5, 20.0), st.integers(0, 9))
def test_a_limit_on_the_normal_force_holds_and_moves_between_ticks(foot: str, limit: float, seed: int) -> None:
    schedule = Named(FEET)
    controller = scheduled(schedule)
    q, v = moving(QUADRUPED, seed)
    free = controller.tick(0.0, q, v).f[foot][2]
    for bound in (limit, 0.1 * limit, np.inf):
        schedule.says = wbc.Overrides(normal_limits={foot: bound})
        command = controller.tick(0.001, q, v)
        assert command.status.ok and command.f[foot][2] <= bound + 1e-7
    assert command.f[foot][2] == pytest.approx(free, rel=1e-6, abs=1e-6)


def test_a_set_nobody_announced_is_compiled_between_ticks_and_the_present_plan_holds_until_then() -> None:
    schedule = Named(FEET)
    controller = scheduled(schedule)
    rest = np.zeros(QUADRUPED.nv)
    controller.tick(0.0, QUADRUPED.q0, rest)
    schedule.now = frozenset(FEET[:2] + FEET[3:])
    held = [controller.tick(0.001 * k, QUADRUPED.q0, rest) for k in (1, 2)]
    assert all(command.f[FEET[2]][2] > 0.0 for command in held) and controller.plans.unplanned == 1
    assert (controller.compile_waiting(), controller.compile_waiting()) == (1, 0)
    assert controller.tick(0.003, QUADRUPED.q0, rest).f[FEET[2]][2] == 0.0
    schedule.now = frozenset(FEET)
    controller.tick(0.004, QUADRUPED.q0, rest)
    assert controller.plans.unplanned == 1


def test_a_wish_about_the_force_of_a_contact_waits_until_there_is_one() -> None:
    foot = FEET[0]
    press = ContactForce(foot, target=[0.0, 0.0, 60.0], weight=10.0)
    schedule = Named(FEET[1:], [FEET])
    controller = scheduled(schedule, extra=(press,))
    rest = np.zeros(QUADRUPED.nv)
    assert controller.tick(0.0, QUADRUPED.q0, rest).f[foot][2] == 0.0
    schedule.now = frozenset(FEET)
    assert controller.tick(0.001, QUADRUPED.q0, rest).f[foot][2] == pytest.approx(60.0, rel=1e-2)


def test_what_held_before_a_change_is_the_first_guess_after_it() -> None:
    schedule = Named(FEET, [FEET[1:]])
    controller = scheduled(schedule)
    q, v = moving(QUADRUPED, 3)
    controller.tick(0.0, q, v)
    schedule.says = wbc.Overrides(torque=bounds_on(slice(4, None), 3.0, QUADRUPED.nj))
    controller.tick(0.001, q, v)
    held = {row for row, _ in controller.plans.present.solver.named_working_set()}
    schedule.now = frozenset(FEET[1:])
    controller.plans.choose(schedule.now, controller.state)
    guessed = {row for row, _ in controller.plans.present.solver.named_working_set()}
    gone = {row for row in held if FEET[0] in row.owner}
    assert len(held) > 3 and guessed == held - gone


def test_a_run_starts_again_with_the_contacts_that_are_named_then() -> None:
    schedule = Named(FEET, [FEET[1:]])
    controller = scheduled(schedule)
    q, v = moving(QUADRUPED, 4)
    first = controller.tick(0.0, q, v)
    schedule.now = frozenset(FEET[1:])
    controller.tick(0.001, q, v)
    controller.reset()
    schedule.now = frozenset(FEET)
    np.testing.assert_allclose(controller.tick(0.0, q, v).tau, first.tau, atol=1e-9)


def test_two_contacts_on_one_frame_take_turns_by_name() -> None:
    first = FEET[0]
    edge = Edge(first, half_length=0.02, friction=0.5)
    stack = stack_of()

    def ticked(*names: str) -> wbc.Command:
        schedule = Named([*names, *FEET[1:]])
        both = Stack(stack.levels, subject_to=stack.subject_to, contacts=[*stack.contacts, edge], components=[schedule])
        return wbc.Controller(QUADRUPED, both, level=wbc.InverseDynamics()).tick(
            0.0, QUADRUPED.q0, np.zeros(QUADRUPED.nv)
        )

    on_point, on_edge = ticked(f"Point[{first}]"), ticked(edge.name)
    assert on_point.f[f"Point[{first}]"][2] > 0.0 == on_point.f[edge.name][2]
    assert on_edge.f[edge.name][2] > 0.0 == on_edge.f[f"Point[{first}]"][2]
    with pytest.raises(UnknownName, match=f"no contact '{first}'"):
        ticked(first)
    press = Stack([ContactForce(first, target=[0.0, 0.0, 60.0])], contacts=[*stack.contacts, edge])
    with pytest.raises(UnknownName, match=f"no contact '{first}'"):
        wbc.Controller(QUADRUPED, press, level=wbc.InverseDynamics())


@pytest.mark.parametrize("hierarchy", [wbc.Strict(), wbc.Scaled()], ids=lambda hierarchy: type(hierarchy).__name__)
def test_every_hierarchy_follows_a_schedule(hierarchy: Any) -> None:
    schedule, one = Named(FEET, [FEET[1:]]), stack_of()
    stack = Stack(
        [[task] for task in one.tasks], subject_to=one.subject_to, contacts=one.contacts, components=[schedule]
    )
    controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics(), hierarchy=hierarchy)
    for names in (FEET, FEET[1:], FEET):
        schedule.now = frozenset(names)
        command = controller.tick(0.0, QUADRUPED.q0, np.zeros(QUADRUPED.nv))
        assert command.status.ok
        assert [command.f[foot][2] > 0.0 for foot in FEET] == [foot in names for foot in FEET]


def test_schedules_that_make_no_sense_are_refused() -> None:
    second = Named(FEET)
    second._name = "other"
    with pytest.raises(InvalidInput, match="Named and other both schedule contacts"):
        wbc.Controller(QUADRUPED, stack_of(Named(FEET), second), level=wbc.InverseDynamics())
    with pytest.raises(UnknownName, match=r"no contact 'front_left_fot'; did you mean .*front_left_foot"):
        scheduled(Named(["front_left_fot"]))
