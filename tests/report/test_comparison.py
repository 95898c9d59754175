"""Runs on one page: what lies over what, what differs, and who is seen through."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import wbc
from wbc.control.recorder import Run
from wbc.errors import InvalidInput
from wbc.models.collision import Obstacle
from wbc.models.geometry import Sphere
from wbc.report import save_comparison
from wbc.report.comparison import came_out, comparison, demanded, was_set
from wbc.report.document import Plot, Table, Text
from wbc.sim.scenario import Check, ScenarioResult

from .browser import Browser, browser, installed
from .conftest import reaching_run, result_of, standing_run

CHROMIUM = installed()


@pytest.fixture(scope="module")
def results() -> dict[str, ScenarioResult]:
    """A humanoid that met its demand, and the same pushed harder for half as long, which did not."""
    robot, usual, hard = wbc.load("humanoid"), standing_run(), standing_run(60)
    hard.columns["push"] = 2.0 * hard["push"]
    hard.columns["error.CenterOfMass"] = 3.0 * hard["error.CenterOfMass"]
    hard.columns["plant.q"] = hard["plant.q"] + np.eye(1, robot.nq, 0)
    hard.meta["parameters"] = {"robot": robot.name, "push": 120}
    return {"usual": result_of(usual, robot), "hard": result_of(hard, robot, ok=False)}


def plots(results: dict[str, ScenarioResult]) -> dict[str, Plot]:
    return {item.name: item for item in comparison(results).items if isinstance(item, Plot)}


def test_every_curve_is_there_of_each_run_in_the_colour_of_the_run(results: dict[str, ScenarioResult]):
    plot = plots(results)["tracking.CenterOfMass"]
    assert [curve.label for curve in plot.curves] == [
        f"{axis}, {name}" for axis in "xyz" for name in ("usual", "hard")
    ]  # fmt: skip
    assert [curve.run for curve in plot.curves] == [0, 1] * 3 and [curve.dash for curve in plot.curves] == [
        0,
        0,
        1,
        1,
        2,
        2,
    ]
    for k, result in enumerate(results.values()):
        for axis, curve in enumerate(plot.curves[k::2]):
            np.testing.assert_array_equal(curve.values, 1e3 * result.run["error.CenterOfMass"][:, axis])
            x = plot.x if curve.x is None else curve.x
            assert len(x) == result.run.rows


def test_of_many_curves_those_that_were_largest_in_any_run_are_seen(changed: Callable[..., Run]):
    robot, one = wbc.load("arm"), reaching_run()
    v = one["v"].copy()
    v[5, 2] = 0.9 * robot.limits.v_max[2]  # in the second run alone
    pair = {"one": result_of(one, robot), "two": result_of(changed(one, v=v), robot)}
    shown = [curve.label for curve in plots(pair)["velocities"].curves if curve.shown]
    assert shown[:2] == [f"{robot.joint_names[2]}, one", f"{robot.joint_names[2]}, two"] and len(shown) == 6


def test_curves_that_no_run_shows_on_its_own_page_are_not_seen(results: dict[str, ScenarioResult]):
    shown = [curve.label for curve in plots(results)["tracking.Posture"].curves if curve.shown]
    of = wbc.load("humanoid").nj
    assert shown == [f"{what}, {name}" for what in (f"largest of {of}", "rms") for name in ("usual", "hard")]


def test_what_differs_is_said_and_nothing_else(results: dict[str, ScenarioResult]):
    (table,) = was_set({name: result.run for name, result in results.items()})
    assert isinstance(table, Table) and list(table.rows) == [["parameter push", None, "120"]]
    figures, same = came_out(results)
    assert isinstance(figures, Table) and isinstance(same, Table)
    rows = {str(row[0]): row[1:] for row in figures.rows}
    largest, worse = rows["CenterOfMass, largest [m]"]
    assert largest == pytest.approx(2**0.5 * 1e-3) and worse == pytest.approx(3.0 * 2**0.5 * 1e-3)
    assert rows["simulated [s]"] == [1.2, 0.6]
    assert not {row[0] for row in same.rows} & set(rows) and "Frame[left_hand], largest [m]" in {
        row[0] for row in same.rows
    }


def test_signals_that_are_missing_in_one_run_are_seen_and_no_setting(results: dict[str, ScenarioResult]):
    usual = results["usual"]
    run = Run(usual.run.columns, usual.run.meta | {"silent": {"observer": "ValueError: no state", "heat": "no"}})
    beside = {"whole": usual, "silent": replace(usual, run=run)}
    assert isinstance(was_set({name: result.run for name, result in beside.items()})[0], Text)
    table = came_out(beside)[0]
    assert isinstance(table, Table) and [list(row) for row in table.rows] == [
        ["not all recorded", None, "observer, heat"]
    ]


def test_a_run_beside_itself_differs_in_nothing(results: dict[str, ScenarioResult]):
    twice = {"first": results["usual"], "again": results["usual"]}
    assert [item.text for item in was_set({k: r.run for k, r in twice.items()}) if isinstance(item, Text)] == [
        "Every setting is the same in all runs."
    ]
    assert isinstance(came_out(twice)[0], Text)
    clock = comparison(twice).clock
    assert clock is not None and [event.label for event in clock.events if event.kind == "push"] == ["push"]


def test_a_demand_has_what_came_out_of_each_run_and_failed_ones_stand_first(results: dict[str, ScenarioResult]):
    table = demanded(results)
    assert [row[0] for row in table.rows] == ["stays | up"] and table.rows[0][1] == "≥ 0.5 m or ≥ 2 m"
    usual, hard = table.rows[0][2:]
    assert usual.ok and not hard.ok and usual.text == hard.text == "1"  # type: ignore[union-attr]
    met = ScenarioResult(standing_run(), True, {}, {}, [Check("a", 1.0, "<", 2.0), Check("b", 1.0, "<", 2.0)])
    not_met = ScenarioResult(standing_run(), False, {}, {}, [Check("b", 3.0, "<", 2.0), Check("c", 1.0, "<", 2.0)])
    rows = demanded({"met": met, "not met": not_met}).rows
    assert [row[0] for row in rows] == ["b", "a", "c"] and rows[1][3] is None and rows[2][2] is None


def test_the_second_robot_is_a_ghost_with_the_shapes_of_the_first(results: dict[str, ScenarioResult]):
    scene = comparison(results).scene
    assert scene is not None and len(scene.ghosts) == 1
    (ghost,) = scene.ghosts
    assert ghost["parts"] is None and len(ghost["links"]) == len(scene.content["links"])
    assert (scene.content["label"], ghost["label"]) == ("usual", "hard") and ghost["color"] != scene.content["color"]
    other = {"humanoid": results["usual"], "arm": result_of(reaching_run(), wbc.load("arm"))}
    mixed = comparison(other).scene
    assert mixed is not None and mixed.ghosts[0]["parts"]


def test_obstacles_are_drawn_on_the_page_of_two_runs(tmp_path: Path):
    runs = {"usual": standing_run(20), "again": standing_run(20)}
    pages = [
        save_comparison(runs, tmp_path / str(k), robot=wbc.load("humanoid"), obstacles=around).read_bytes()
        for k, around in enumerate(([], [Obstacle("post", Sphere(0.2), lambda _: pin.SE3.Identity())]))
    ]
    assert len(pages[1]) > len(pages[0])


def test_one_run_or_a_run_without_columns_is_refused(tmp_path: Path):
    with pytest.raises(InvalidInput, match="1 run is nothing to compare"):
        save_comparison({"one": reaching_run()}, tmp_path / "c")
    with pytest.raises(InvalidInput, match="has no dt"):
        save_comparison({"one": reaching_run(), "two": Run({"t": np.zeros(3)})}, tmp_path / "c")
    assert not (tmp_path / "c").exists()


@pytest.fixture(scope="module")
def tab(results: dict[str, ScenarioResult], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """The page of both in a browser."""
    assert CHROMIUM is not None
    page = save_comparison({name: result.run for name, result in results.items()}, tmp_path_factory.mktemp("c") / "c")
    with browser(CHROMIUM) as running:
        running.open(page)
        yield running


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed to look at the page with")
def test_both_robots_and_both_curves_follow_one_clock(tab: Browser):
    assert tab.errors == []
    tab.run("report.go(0.25)")
    first, second = (tab.run(f"document.querySelector('[data-scene]').at({k})") for k in (0, 1))
    apart = np.array(second) - np.array(first)
    assert apart[:, 0] == pytest.approx(1.0, abs=1e-6) and np.abs(apart[:, 1:]).max() < 1e-6
    data = tab.run(
        """(({u}) => [u.data[0].length, ...u.series.map((s, k) => k && s.value(u, u.data[k][25], k, 25))])(
        report.plots.find(p => report.data.plots[p.box.dataset.plot].name === "tracking.CenterOfMass"))"""
    )
    assert data[0] == 120 and float(data[2]) == pytest.approx(1.0, abs=1e-3)  # mm, at the top of the wave
    assert sorted(float(value) for value in data[2:]) == pytest.approx([0, 0, 1, 1, 3, 3], abs=1e-3)
    said = tab.run("document.body.innerText")
    assert "Why, usual, at 0.250 s" in said and "Why, hard, at 0.250 s" in said
    tab.run("report.go(1.0)")  # the second has ended: it stands where it did
    assert "Why, hard, at 0.590 s" in tab.run("document.body.innerText")


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed to look at the page with")
def test_a_legend_lists_what_is_seen_of_both_runs_first(tab: Browser):
    shown = tab.run(
        """report.plots.find(p => report.data.plots[p.box.dataset.plot].name === "tracking.Posture")
        .u.series.slice(1).map(s => s.show)"""
    )
    assert shown[:4] == [True] * 4 and not any(shown[4:])
    marks = tab.run(
        """report.plots.flatMap(({u}) => [...u.root.querySelectorAll('.u-series th')].slice(0, u.series.length).map(
        (head, k) => [(u.series[k].dash ?? []).join(" "),
                      head.querySelector("path")?.getAttribute("stroke-dasharray") ?? ""]))"""
    )
    assert len({dash for dash, _ in marks}) > 2 and all(dash == drawn for dash, drawn in marks)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed to look at the page with")
@pytest.mark.parametrize("width", [390, 940, 1400])
def test_the_page_of_two_runs_is_as_wide_as_the_window(tab: Browser, width: int):
    tab.call("Emulation.setDeviceMetricsOverride", width=width, height=844, deviceScaleFactor=1, mobile=width < 600)
    tab.settle()
    assert tab.run("document.documentElement.scrollWidth") == width
