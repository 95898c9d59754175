"""A few random stacks on legs each week against an oracle that shares no solver with the library."""

from __future__ import annotations

import pytest

from tests.families import legs, robots
from tests.seeds import SEED


def test_no_answer_on_legs_that_is_called_solved_is_wrong() -> None:
    table = legs.run(12, SEED, ticks=1, verbose=True)
    assert not sum(row["wrong"] + row["uncertified"] for row in table.values()), table
    assert sum(row["right"] for row in table.values()) >= 1


def test_no_answer_on_random_trees_of_joints_that_is_called_solved_is_wrong() -> None:
    table = robots.run(6, SEED, ticks=4, verbose=True)
    assert not sum(row["wrong"] + row["uncertified"] for row in table.values()), table
    assert sum(row["right"] for row in table.values()) >= 1


@pytest.mark.xfail(
    strict=True,
    reason="a row that pushes in a level by 1e-8 to 1e-6 of what is left there is kept in all levels below, and the "
    "certificate of these takes that for granted: a share is 0.143 from its optimum, and solved",
)
def test_rows_that_all_but_do_not_push_leave_the_levels_below_free() -> None:
    """A humanoid in a wild state under Scaled, where most unknowns stand at bounds."""
    control, q, v, kind = legs.draw(21000485)
    first = control.tick(0.0, q, v)
    second = control.tick(1e-3, first.q, first.v)
    assert legs.judge(control, second, kind.split()[0])[0] == "right"
