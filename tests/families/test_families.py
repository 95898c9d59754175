"""A few random stacks on legs each week against an oracle that shares no solver with the library."""

from __future__ import annotations

from pathlib import Path

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


def test_rows_that_all_but_do_not_push_leave_the_levels_below_free(tmp_path: Path) -> None:
    """A humanoid in a wild state under Scaled, most unknowns at bounds, and a tree under Strict: a push of a millionth
    of what is left of a level is none. Kept, two rows of the tree left its posture 3.5 rad/s² from its optimum."""
    control, q, v, kind = legs.draw(21000485)
    first = control.tick(0.0, q, v)
    second = control.tick(1e-3, first.q, first.v)
    assert legs.judge(control, second, kind.split()[0])[0] != "wrong"
    control, q, v, kind = robots.draw(21000101, tmp_path)
    for tick in range(21):
        command = control.tick(1e-3 * tick, q, v)
        assert robots.judge(control, command, optimum=tick % 10 == 0)[0] != "wrong"
        q, v = command.q, command.v
