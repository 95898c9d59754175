"""The report of a run: what is in it, in which order, and that it never needs what the run lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wbc.models import load
from wbc.report import Report, Table, Text, run_report
from wbc.report.build import highlights, summary
from wbc.report.document import Plot, formatted
from wbc.report.happened import story
from wbc.report.sections import SECTIONS, contacts, joints, solver, timing, tracking, verdict
from wbc.sim.scenario import Check, Place, ScenarioResult

from .conftest import reaching_run, result_of, standing_run


def test_the_sections_stand_in_the_order_in_which_they_are_read(report: Report):
    assert [section.title for section in report.sections] == [
        "Verdict", "Motion", "Tracking", "Active constraints", "Torques against limits",
        "Joint velocities and positions", "Smoothness", "Contact forces", "Centre of mass", "Tick time",
        "Solver", "Settings", "Limits of this run",
    ]  # fmt: skip


def test_every_section_says_something(report: Report):
    assert all(section.items for section in report.sections)
    assert len({figure.name for figure in report.figures}) == len(report.figures)


def test_a_report_ends_with_the_limits_of_its_run(report: Report):
    sentences = [item.text for item in report.sections[-1].items if isinstance(item, Text)]
    assert len(sentences) >= 4
    assert any("true state" in sentence for sentence in sentences)


def test_a_kinematic_run_has_no_torques_contacts_or_centre_of_mass(reaching: ScenarioResult):
    shown = {
        section.title for make in SECTIONS if make.__module__.split(".")[-1] != "motion" if (section := make(reaching))
    }
    assert shown == {
        "Verdict", "Tracking", "Joint velocities and positions", "Smoothness", "Tick time", "Solver", "Settings",
        "Limits of this run",
    }  # fmt: skip


def test_the_summary_says_who_did_what_and_how_it_ended(standing: ScenarioResult, reaching: ScenarioResult):
    assert summary(standing) == (
        "Humanoid ran made-up for 1.2 s at 100 Hz (inverse dynamics, Weighted(), pdas) under 1 disturbance; "
        "119 of 120 ticks solved and certified; every demand was met."
    )
    assert summary(reaching).endswith("every tick solved and certified; not met: 1 of 1 demands, first stays | up.")


def test_the_summary_says_when_a_run_ended_early():
    run = standing_run()
    run.meta["ended"] = "fallen at t = 0.500 s"
    assert "ended early (fallen at t = 0.500 s)" in summary(result_of(run, load("humanoid"), ok=False))


def test_the_first_figures_are_those_of_the_run(standing: ScenarioResult):
    tiles = {tile.what: tile.value for tile in highlights(standing)}
    assert tiles["ticks"] == "120" and tiles["peak torque"] == "40 %"


@pytest.mark.parametrize(("share", "mood"), [(0.5, ""), (1.0 + 1e-9, ""), (27.0, "doubtful")])
def test_a_limit_that_was_passed_is_seen_at_the_top_though_nobody_demands_it(share: float, mood: str):
    run = standing_run()
    run.columns["tau"][:] = 0.0
    run.columns["tau"][7, 0] = share * run.meta["limits"]["tau_max"][0]
    (tile,) = (tile for tile in highlights(result_of(run, None)) if tile.what == "peak torque")
    assert tile.mood == mood and tile.value == f"{round(100 * share)} %"


@pytest.mark.parametrize("torque", [1e35, np.inf])
def test_a_figure_beyond_all_measure_is_as_short_as_any(torque: float):
    run = standing_run()
    run.columns["tau"][7, 0] = torque
    (tile,) = (tile for tile in highlights(result_of(run, None)) if tile.what == "peak torque")
    assert tile.mood == "doubtful" and len(tile.value) < 12


@pytest.mark.parametrize("size", [2, 3, 4, 6])
def test_curves_of_a_task_in_two_units_have_the_names_of_their_rows(size: int):
    run = standing_run()
    names = [f"joint {k}" for k in range(2 * size)]
    error = run.columns["error.Posture"] = np.outer(np.ones(120), np.arange(1.0, 2 * size + 1.0))
    run.meta["tasks"]["Posture"] = {"units": ["m", "rad"] * size, "labels": names}
    section = tracking.section(result_of(run, load("humanoid")))
    assert section is not None
    plots = [item for item in section.items if isinstance(item, Plot) and item.title == "Posture"]
    drawn = {curve.label: curve.values[0] for plot in plots for curve in plot.curves if curve.label in names}
    assert len(plots) == 2 and drawn == {name: 1e3 * error[0, k] for k, name in enumerate(names)}


def test_the_curve_of_a_row_without_a_name_is_the_error():
    run = standing_run()
    run.columns["error.Posture"] = np.ones((120, 1))
    run.meta["tasks"]["Posture"] = {"units": ["m"], "labels": [""]}
    section = tracking.section(result_of(run, load("humanoid")))
    assert section is not None
    (plot,) = (item for item in section.items if isinstance(item, Plot) and item.title == "Posture")
    assert [curve.label for curve in plot.curves] == ["error"]


@pytest.mark.parametrize("rows", [1, 2])
def test_the_shortest_runs_can_be_drawn(rows: int):
    result = result_of(standing_run(rows), load("humanoid"))
    for make in (tracking, joints, contacts, timing, solver):
        assert make.section(result) is not None


def test_a_run_that_broke_down_can_be_drawn():
    run = standing_run()
    run.columns["certificate"][-1] = np.inf
    for name in ("tau", "error.CenterOfMass", "f.Sole[left_sole]", "plant.f.Sole[left_sole]"):
        run.columns[name][-1] = np.nan
    result = result_of(run, load("humanoid"), ok=False)
    for make in SECTIONS:
        if not make.__module__.endswith("motion"):
            assert make(result) is not None


def test_statistics_of_the_solver_are_those_of_the_run(standing: ScenarioResult):
    section = solver.section(standing)
    assert section is not None
    _, table, _ = (item for item in section.items if isinstance(item, Table))
    values = dict(table.rows)
    assert values["active set of the last tick was right (at most one iteration)"] == "100 %"
    assert values["active rows, largest"] == 5
    assert values["ticks at which the number of active rows changed"] == 2


def test_the_solver_section_says_how_far_each_task_can_be_from_its_optimum(standing: ScenarioResult):
    section = solver.section(standing)
    assert section is not None
    _, _, table = (item for item in section.items if isinstance(item, Table))
    assert table.columns == ("task", "unit", "median", "largest", "ticks with a bound")
    centre, metres, radians, posture = table.rows
    assert metres[:2] == ("Frame[left_hand]", "m/s²") and radians[:2] == ("Frame[left_hand]", "rad/s²")
    assert metres[2:4] == radians[2:4] == (2e-9, 2e-9)
    assert centre[:2] == ("CenterOfMass", "m/s²") and centre[2] == pytest.approx(7e-9) and centre[4] == "99.166 %"
    assert centre[3] == pytest.approx(1e-9 + 119e-10)
    assert posture[:2] == ("Posture", "rad/s²") and np.isnan(posture[2:4]).all() and posture[4] == "0 %"


def test_progress_runs_from_start_to_end(reaching: ScenarioResult):
    heard: list[float] = []
    run_report(result_of(reaching_run(), None), progress=lambda done, text="": heard.append(done))
    assert heard[0] == 0.0 and heard[-1] == 1.0 and heard == sorted(heard)


def test_the_verdict_names_the_side_and_puts_what_failed_first(standing: ScenarioResult):
    checks = [
        Check("met", 0.5, "<=", 1.0, "m"),
        Check("late", 3.0, "<", 1.0, "m", Place(0.9, "left_foot", "slip")),
        Check("early", 1.0, ">=", 2.0, "m", Place(0.2)),
    ]
    section = verdict.section(replace(standing, verdict=checks, ok=False))
    table = section.items[0]
    assert isinstance(table, Table)
    assert [(row[0], row[2], row[3], formatted(row[4])) for row in table.rows] == [
        ("early", "≥ 2 m", False, "t = 0.200 s"), ("late", "< 1 m", False, "t = 0.900 s, left_foot"),
        ("met", "≤ 1 m", True, ""),
    ]  # fmt: skip


def test_the_rows_of_one_constraint_in_conflict_stand_in_one_line(standing: ScenarioResult):
    conflict = (
        "3 rows cannot hold together:",
        "  left: x down by 2 m",
        "  left: y down by 3 m",
        "  right: x up by 1 m",
    )
    why = "\n".join(["tick 3 at t = 0.002 s: infeasible", *conflict])
    standing.run.meta["failure"] = {"t": 0.002, "why": why}
    section = verdict.section(standing)
    (told,) = (item for item in section.items if isinstance(item, Table) and "first tick" in item.columns[0])
    assert list(told.rows) == [
        ("tick 3 at t = 0.002 s", "infeasible"), ("3 rows cannot hold together", ""),
        ("left", "x down by 2 m, y down by 3 m"), ("right", "x up by 1 m"),
    ]  # fmt: skip


def test_a_limit_that_is_crossed_in_a_run_that_passed_is_explained(standing: ScenarioResult):
    for ok, worst in ((True, 0.02), (True, 1e-9), (False, 0.02)):
        made = verdict.section(replace(standing, ok=ok, violations={"joint velocity": (worst, "rad/s")}))
        (table,) = (item for item in made.items if isinstance(item, Table) and item.columns[0] == "limit")
        assert ("a push can move a joint" in table.caption) == (ok and worst > 1e-6)


def test_the_verdict_says_whose_signals_are_missing_and_why(standing: ScenarioResult):
    def told() -> list[Table]:
        return [i for i in verdict.section(standing).items if isinstance(i, Table) and i.columns[0] == "not recorded"]

    assert told() == []
    standing.run.meta["silent"] = {"observer": "ValueError: <no> state"}
    assert [list(table.rows) for table in told()] == [[("observer", "ValueError: <no> state")]]


def test_the_verdict_tells_what_led_to_the_first_failure(standing: ScenarioResult):
    slipped = Check("slip", 3.0, "<", 1.0, "mm", Place(0.45, "left_foot", "slip"))
    standing.run.meta["disturbances"] = ["push of (0, 60, 0) N at 'pelvis' from 0.3 s for 0.2 s"]
    told = story(replace(standing, verdict=[slipped], ok=False))
    assert [round(event.start, 9) for event in told] == sorted(round(event.start, 9) for event in told)
    labels = [event.label for event in told]
    assert labels[0] == "push of (0, 60, 0) N at 'pelvis'" and told[0].start == pytest.approx(0.3)
    assert "not met: slip, left_foot" in labels
    rows = [event for event in told if event.kind == "row"]
    assert rows and all(event.start == pytest.approx(0.3) and event.end == pytest.approx(0.5) for event in rows)
    assert all(event.label.endswith("is active") for event in rows)
    standing.run.columns["active.row"][40] = np.nan  # at 0.4 s nothing is active
    broken = [event for event in story(replace(standing, verdict=[slipped], ok=False)) if event.kind == "row"]
    assert broken and all(event.label.endswith("is active, 2 times") for event in broken)
    assert "no certified solution" not in labels  # of the tick long before the push
    standing.run.columns["status"][[40, 41, 50]] = 1
    (unsolved,) = (e for e in story(replace(standing, verdict=[slipped], ok=False)) if e.kind == "status")
    assert unsolved.label == "no certified solution, 2 times"
    assert (unsolved.start, unsolved.end) == (pytest.approx(0.4), pytest.approx(0.51))
    assert story(replace(standing, verdict=[replace(slipped, value=0.5)])) == []


@pytest.mark.parametrize("relation", ["<=", ">="])
@pytest.mark.parametrize("bound", [2.0, -1e-3])
@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_the_bar_of_a_demand_ends_on_its_own_side_of_the_bound(relation: str, bound: float, factor: float):
    check = Check("it", factor * bound, relation, bound)
    bar = verdict.margin(check)
    assert bar.mark is not None and bar.ok == check.ok
    assert (bar.end < bar.mark) == (check.value < bound)


@pytest.mark.parametrize("relation", ["<", "<=", "=", ">=", ">"])
@pytest.mark.parametrize("value", [-0.3, 0.0, 0.3])
def test_the_bar_of_a_demand_for_a_sign_ends_on_the_side_of_the_value(relation: str, value: float):
    bar = verdict.margin(Check("it", value, relation, 0.0))
    assert bar.mark is not None and np.sign(bar.end - bar.mark) == np.sign(value)


@pytest.mark.parametrize(("slow", "mood"), [(0, "good"), (1, "doubtful"), (60, "bad")])
def test_late_ticks_are_seen_at_the_top(slow: int, mood: str):
    run = standing_run()
    run.columns["tick_us"][:slow] = 2e4
    tile = next(tile for tile in highlights(result_of(run, None)) if "period" in tile.what)
    assert tile.mood == mood and "period 10000 µs" in tile.what and tile.value == ("yes" if not slow else str(slow))
