"""Why the robot moved as it did, read from a record."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wbc.control.recorder import Run
from wbc.report.document import Plot
from wbc.report.sections import limits
from wbc.report.why import held, row_names, shares, why

from .conftest import reaching_run, result_of, standing_run


def test_rows_are_named_with_their_side_where_they_do_not_say_it():
    assert row_names(standing_run()) == ["TorqueLimits: left_knee, upper bound", "friction[left_sole]: fy <= mu fz"]


def test_a_task_without_a_target_has_no_error(changed: Callable[..., Run]):
    run = standing_run()
    found = why(changed(run, **{"error.Posture": np.zeros_like(run["error.Posture"])}))
    assert found is not None
    assert {part.task: list(part.error) for part in found.parts} == {
        "CenterOfMass": ["m"], "Frame[left_hand]": ["m", "rad"], "Posture": [],
    }  # fmt: skip


def test_shares_of_the_cost_are_those_of_the_ticks_that_cost_something():
    found = shares(standing_run())
    assert {task: share[40] for task, share in found.items()} == {
        "CenterOfMass": 25.0, "Frame[left_hand]": 50.0, "Posture": 25.0,
    }  # fmt: skip
    assert np.isnan(found["Posture"][0])


def test_a_strip_covers_the_ticks_on_which_its_row_was_active():
    run = standing_run()
    assert all(np.array_equal(mask, run["push"][:, 1] > 0) for mask in held(run).values())
    section = limits.section(result_of(run, None))
    assert section is not None
    strips, costs = (item for item in section.items if isinstance(item, Plot))
    assert [[round(x, 9) for x in span] for span in strips.strips[0].intervals] == [[0.3, 0.5]]
    assert [curve.label for curve in costs.curves] == ["CenterOfMass", "Frame[left_hand]", "Posture"]


def test_more_rows_than_can_be_told_apart_are_one_strip():
    run = standing_run()
    run.meta["active_rows"] = [
        {"owner": "TorqueLimits", "label": f"joint {k}", "unit": "N m", "side": "upper"} for k in range(20)
    ]
    run.columns["active.row"][:20, 0] = np.arange(20)
    section = limits.section(result_of(run, None))
    assert section is not None and isinstance(section.items[0], Plot)
    assert section.items[0].strips[-1].label == "6 other rows" and len(section.items[0].strips) == limits.MOST + 1


def test_an_older_record_says_nothing_of_its_reasons():
    run = reaching_run()
    assert why(run) is None and limits.section(result_of(run, None)) is None
