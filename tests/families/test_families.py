"""A few random stacks on legs each week against an oracle that shares no solver with the library."""

from __future__ import annotations

import datetime

from tests.families.legs import run


def test_no_answer_on_legs_that_is_called_solved_is_wrong() -> None:
    year, week, _ = datetime.date.today().isocalendar()
    print(f"seed {100 * year + week}")
    table = run(12, 100 * year + week, ticks=1, verbose=True)
    assert not sum(row["wrong"] + row["uncertified"] for row in table.values()), table
    assert sum(row["right"] for row in table.values()) >= 1
