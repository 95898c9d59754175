"""A few random stacks on legs each week against an oracle that shares no solver with the library."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

import wbc
from tests.families import legs, members, odd_robots, robots, twins
from tests.families.oracle import judge
from tests.seeds import SEED

#: What is drawn may be far out of reach, or have no contacts.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::wbc.models.plausible.{doubt}")
    for doubt in ("ImplausibleUnit", "NothingHoldsTheBase")
]


@pytest.mark.parametrize(
    ("drawn", "count", "ticks"), [(legs, 12, 1), (robots, 6, 4), (members, 30, 6), (odd_robots, 12, 8), (twins, 20, 2)]
)
def test_no_answer_that_is_called_solved_is_wrong(drawn: ModuleType, count: int, ticks: int) -> None:
    table = drawn.FAMILY.run(count, SEED, ticks=ticks, verbose=True)
    assert not sum(row["wrong"] + row["uncertified"] for row in table.values()), table
    assert sum(row["right"] for row in table.values()) >= 1


def test_a_share_is_held_by_a_limit_that_pushes_a_little() -> None:
    """26 limits hold the directions of the tasks; a wrist that one of them holds could give back 0.4 % of a share."""
    control, q, v, _ = legs.draw(1139003704)
    assert judge(control, control.tick(0.0, q, v)).word == "right"


def test_limits_that_differ_by_rounding_hold_one_direction_not_two() -> None:
    """A free sole on ice: two of its limits point opposite ways in the space of the posture. Without fused products
    rounding told them apart, pushes of 4e9 balanced along it, and a certified answer cost 2 % more than another."""
    control, q, v, _ = legs.draw(1131007710)
    for tick in range(2):
        command = control.tick(1e-3 * tick, q, v)
        assert command.status.ok and judge(control, command).word == "right"
        q, v = command.q, command.v


@pytest.mark.parametrize("case", [1131007710, 1161005006])
def test_no_tick_takes_more_problems_than_its_budget(case: int) -> None:
    """Levels are decided one by one, and once more where what was let go has to be held."""
    drawn, q, v, _ = legs.draw(case)
    for budget in range(2, 10):
        hierarchy = wbc.Strict(budget=budget)
        control = wbc.Controller(drawn.model, drawn.stack, level=drawn.level, hierarchy=hierarchy, dt=drawn.dt)
        control.tick(0.0, q, v)
        assert control.counts.total <= budget


@pytest.mark.parametrize(
    ("case", "tick"),
    [
        (1000014, 0),  # limits whose rows leave nothing but rounding in the space of a level
        (2000417, 14),  # a task on the centre of mass of a robot that nothing holds: its rows are rounding
        (2000563, 1),  # a point and a line at one place: their rows contradict each other by 3e-9 m/s
        (2000594, 2),
    ],
)
def test_what_is_rounding_decides_nothing(case: int, tick: int) -> None:
    """Called infeasible, solved 17,000 rad/s² from the optimum, or left to the weighted fallback."""
    control, decided = members.played(case, tick)
    assert decided.status.ok and judge(control, decided).word == "right"


def test_tasks_that_ask_for_almost_the_same_are_scaled_and_optimised() -> None:
    """What their directions differ by moves rows that are met by 2e-7 m/s², less than counts as met."""
    control, decided, _ = next(twins.ticked(1141003441, 1))
    assert decided.status.ok and judge(control, decided).word == "right"


def test_rows_that_all_but_do_not_push_leave_the_levels_below_free(tmp_path: Path) -> None:
    """A humanoid in a wild state under Scaled, most unknowns at bounds, and a tree under Strict: a push of a millionth
    of what is left of a level is none. Kept, two rows of the tree left its posture 3.5 rad/s² from its optimum."""
    control, q, v, _ = legs.draw(21000485)
    first = control.tick(0.0, q, v)
    second = control.tick(1e-3, first.q, first.v)
    assert judge(control, second).word != "wrong"
    control, q, v, _ = robots.draw(21000101, tmp_path)
    for tick in range(21):
        command = control.tick(1e-3 * tick, q, v)
        assert judge(control, command, optimum=tick % 10 == 0).word != "wrong"
        q, v = command.q, command.v


@pytest.mark.parametrize("case, ticks", [(21000100, 1), (21000645, 11)])
def test_a_joint_that_all_but_does_not_matter_to_a_level_is_held_by_what_it_does(
    case: int, ticks: int, tmp_path: Path
) -> None:
    """Links of a milligram beside the way to the hand, at their limits: they push by a billionth of what is left.

    Let go in one level and held in the next, they took the posture 1,000 and 6,000 rad/s² from its optimum.
    """
    control, q, v, _ = robots.draw(case, tmp_path)
    for tick in range(ticks):
        command = control.tick(1e-3 * tick, q, v)
        q, v = command.q, command.v
    assert command.status.ok
    assert judge(control, command, optimum=True).word != "wrong"


@pytest.mark.parametrize("case", [21000402, 21000723, 21000891, 1147003513])
def test_a_contact_that_all_but_does_not_matter_to_a_level_leaves_the_levels_below_free(case: int) -> None:
    """Feet in one line, or all but without friction: their pushes are as small as what rounding makes of them. The last
    one was wrong without fused multiply-adds, as on processors that have none."""
    control, q, v, _ = legs.draw(case)
    for tick in range(2):
        command = control.tick(1e-3 * tick, q, v)
        assert judge(control, command).word != "wrong"
        q, v = command.q, command.v


def test_a_mobile_base_that_nothing_limits_makes_no_tick_of_a_weak_arm_infeasible() -> None:
    """Its motors cannot stop the arm within its limits: called infeasible and held, though a point lay within all."""
    for control, decided, _ in odd_robots.ticked(6000034, 3):
        assert decided.status.ok
        assert odd_robots.judged(control, decided).word != "wrong"


def test_a_row_of_which_rounding_alone_is_left_takes_no_room_from_the_levels_below() -> None:
    """A quadruped on two edges, whose turn is determined by its direction alone. The row of its share took room all the
    same, and the centre of mass, of weight 1e-6, gave up 0.155 of what it asks for 0.140 of a linear program."""
    control, q, v, _ = legs.draw(1131004101)
    command = control.tick(0.0, q, v)
    assert command.status.ok and judge(control, command).word != "wrong"
    assert control.levels[3].residual == pytest.approx(8.08e-4, rel=2e-3)


@pytest.mark.parametrize("tick", [5, 10])
def test_a_push_that_is_rounding_of_a_level_holds_no_joint_for_it(tick: int) -> None:
    """Manipulability above a position: its gradient has 6e-16 where there is none, and held a joint at its bound."""
    for k, (control, command, _) in enumerate(odd_robots.ticked(1131003642, tick + 1)):
        if k == tick:
            assert command.status.ok and odd_robots.judged(control, command).word != "wrong"
