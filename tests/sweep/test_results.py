"""What a run gives, what a sweep reports of many."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.report.test_formats import Page
from wbc.errors import InvalidInput
from wbc.report.document import Address, Plot, Table, formatted
from wbc.report.html import html
from wbc.report.journal import Journal
from wbc.report.markdown import markdown
from wbc.sweep import Range, Sweep
from wbc.sweep.draw import RandomNoise
from wbc.sweep.run import in_order, read
from wbc.sweep.summary import figures, interval, summary
from wbc.sweep.trial import done

FLIP = f"{Path(__file__).with_name('flipping.py')}:flip"
REACH = f"{Path(__file__).parents[1] / 'report' / 'solvers' / 'reaching.py'}:reach"
#: Parts of a result that its report only prints, whatever they are.
TOLD = ("solver", "hierarchy", "disturbances", "ended", "seconds", "ticks", "solved", "late")
HEADER = {
    "scenario": "flipping.py:flip", "sweep": "bias = 0:1", "runs": 60, "seed": 0, "date": "today", "machine": {},
    "versions": {}, "plan": "",
}  # fmt: skip


def test_a_run_is_one_line_of_json_and_the_same_again():
    trial = Sweep(FLIP, runs=5, vary={"bias": Range(0, 1)}).trial(3)
    one = done(trial)
    assert json.loads(json.dumps(one, allow_nan=False)) == one == done(trial)
    assert one["run"] == 3 and one["solved"] == one["ticks"] and set(one["tracking"]) == {"Height"}
    assert [d["demand"] for d in one["demands"] if not d["ok"]] == ([] if one["ok"] else ["shows head"])


def test_disturbances_join_a_run_whose_scenario_knows_none():
    quiet = done(Sweep(REACH, runs=1, duration=0.1).trial(0))
    noisy = done(Sweep(REACH, runs=1, duration=0.1, disturbances=(RandomNoise(Range(0.1, 0.1)),)).trial(0))
    assert quiet["disturbances"] == [] and "noise" in noisy["disturbances"][0]
    assert quiet["error"] is None and noisy["error"] is None
    loud = Sweep(REACH, runs=1, duration=0.1, solvers=("highs",)).trial(0)
    assert "offline" in done(loud)["error"]


def test_a_bug_in_a_run_is_the_result_of_that_run():
    assert (
        done(Sweep(FLIP, runs=1, fixed={"bug": True}).trial(0))["error"] == "ZeroDivisionError: a bug of the scenario"
    )


def test_results_are_read_back_and_no_run_counts_twice(tmp_path: Path):
    lines = Journal.begin(tmp_path / "r", "run", HEADER)
    for run in (4, 1, 4):
        lines.add({"run": run, "ok": True})
    with (tmp_path / "r").open("a") as file:
        file.write('{"run": 9, "o')
    again = read(tmp_path / "r")
    assert again.header == HEADER and in_order(again) == [{"run": 1, "ok": True}, {"run": 4, "ok": True}]
    again.add({"run": 2, "ok": False})
    again.write(tmp_path / "w", in_order(read(tmp_path / "r")))
    assert [r["run"] for r in in_order(read(tmp_path / "w"))] == [1, 2, 4]
    for text in ("no json\n", '{"runs": 3}\n', "[]\n"):
        (tmp_path / "x").write_text(text)
        with pytest.raises(InvalidInput):
            read(tmp_path / "x")


def test_a_result_of_another_kind_is_refused_by_name_and_what_a_run_gives_is_not(tmp_path: Path):
    result = done(Sweep(FLIP, runs=2, vary={"bias": Range(0, 1)}).trial(0))
    spoilt = [{**result, key: value} for key in result for value in ("text", [1], {"a": "b"}, 3) if key not in TOLD]
    spoilt += [{**result, "demands": [{**demand, key: ["x"]}]} for demand in result["demands"] for key in demand]
    refused = 0
    for line in [result, *spoilt]:
        Journal.begin(tmp_path / "r", "run", HEADER)
        with (tmp_path / "r").open("a") as file:
            file.write(json.dumps(line) + "\n")
        try:
            results = in_order(read(tmp_path / "r"))
        except InvalidInput as cause:
            assert line is not result and str(tmp_path / "r") in str(cause)
            refused += 1
            continue
        markdown(summary(HEADER, results))
        figures(HEADER, results)
    assert refused > len(spoilt) / 2


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_an_interval_holds_its_share_and_stays_a_share(counts: tuple[int, int]):
    low, high = interval(*counts)
    assert 0.0 <= low <= counts[0] / counts[1] <= high <= 1.0
    assert high - low < 1.96 / counts[1] ** 0.5 + 4 / counts[1]


def test_the_report_counts_as_one_counts():
    results = [done(Sweep(FLIP, runs=60, vary={"bias": Range(0, 1)}).trial(i)) for i in range(60)]
    results[7] = {"run": 7, "solver": "pdas", "ok": False, "error": "KilledWorker: gone"}
    report = summary(HEADER, results)
    good = sum(r["ok"] for r in results)
    assert report.summary.startswith(f"{good} of 60 runs of flipping.py:flip went well")
    tables = {item.columns[:2]: item for item in report.items if isinstance(item, Table)}
    assert tables["of", "value"].rows[0][2:4] == [60, good]
    assert {formatted(row[0]): row[1] for row in tables["why not", "runs"].rows} == {
        "shows head": 59 - good,
        "error: KilledWorker: gone": 1,
    }
    heights = sorted(r["tracking"]["Height"] for r in results if "tracking" in r)
    row = next(row for row in tables["figure", "runs"].rows if row[0] == "Height, rms [m]")
    assert row[1] == 59 and row[2] == heights[0] and row[4] == heights[29] and row[6] == heights[-1]
    assert html(report) == html(summary(HEADER, results)) and markdown(report) == markdown(summary(HEADER, results))


def pushed(run: int, force: float, error: float) -> dict[str, Any]:
    """A result as a robot that is pushed gives it: an error that grows with the force, and what only rounding made."""
    value = {"demand": "error", "value": error, "relation": "<", "bound": 0.05, "unit": "m", "ok": error < 0.05}
    same = {"demand": "rounding", "value": 1e-12 * run, "relation": "<", "bound": 1.0, "unit": "N", "ok": True}
    return {
        "run": run, "parameters": {"push": 10.0 + run, "robot": "go2"}, "solver": "pdas", "hierarchy": "weighted",
        "disturbances": [], "axes": {"push at base [N]": force}, "ok": value["ok"], "error": None,
        "demands": [value, same], "tracking": {"Com": error}, "units": {"Com": "m"}, "violations": {},
        "figures": {"com_rms_m": error, "slip_m": 0.1 * force}, "tick_us": None,
    }  # fmt: skip


@pytest.fixture
def forces() -> list[dict[str, Any]]:
    return [pushed(i, 20.0 + 5.0 * i, 0.01 * i) for i in range(8)]


def test_what_was_drawn_is_an_axis_with_its_unit(forces: list[dict[str, Any]]):
    plots = [item for item in summary(HEADER, forces).items if isinstance(item, Plot)]
    assert [plot.over for plot in plots if plot.name.startswith("share")] == ["push at base [N]", "parameter push"]
    scatter = next(plot for plot in plots if plot.name == "value-0")
    assert scatter.title == "error" and scatter.unit == "m" and [b.value for b in scatter.bounds] == [0.05]
    met, missed = (curve.values for curve in scatter.curves)
    assert (
        np.isfinite(met).tolist() == [True] * 5 + [False] * 3 and np.isnan(missed).tolist() == [True] * 5 + [False] * 3
    )


def test_a_bound_that_differs_from_run_to_run_is_each_runs_own(forces: list[dict[str, Any]]):
    """Of a demand such as "rms < 3 % of the way"; a value that is no number is not met."""
    for result in forces:
        error = result["demands"][0]
        error["bound"] = 1e-2 * result["run"] + (5e-3 if result["run"] % 2 else -5e-3)
        error["ok"] = error["value"] < error["bound"]
    forces[1]["demands"][0] |= {"value": None, "ok": False}
    report = summary(HEADER, forces)
    (row,) = (row for i in report.items if isinstance(i, Table) and i.columns[0] == "demand" for row in i.rows[:1])
    assert row[:2] == ["error", "< -0.005 to 0.075 m"] and row[2].text == "37.5 %" and row[5] == 0.07
    scatter = next(i for i in report.items if isinstance(i, Plot) and i.name == "value-0")
    met, missed, bound = (np.isfinite(curve.values).tolist() for curve in scatter.curves)
    odd = [bool(k % 2) for k in range(8)]
    assert met == [on and k > 1 for k, on in enumerate(odd)] and missed == [not on for on in odd] and all(bound)
    assert not scatter.bounds and figures(HEADER, forces)["demands"][0]["bound"] is None
    assert not next(i for i in report.items if isinstance(i, Plot) and i.name == "demand-0").bounds


def test_nothing_stands_twice_and_rounding_is_no_picture(forces: list[dict[str, Any]]):
    report = summary(HEADER, forces)
    shown = [item for item in report.items if isinstance(item, Plot) and item.name.startswith("demand")]
    assert [plot.title for plot in shown] == ["error"]
    assert np.nansum(shown[0].curves[0].values) == len(forces), "every run is in a bar"
    others = next(item for item in report.items if isinstance(item, Table) and item.columns[0] == "figure")
    assert [row[0] for row in others.rows] == ["slip [m]"], "both others are the demand's own values"


def test_the_worst_run_stands_first_and_leads_to_its_page_or_says_how_to_make_it(
    forces: list[dict[str, Any]], tmp_path: Path
):
    folder = tmp_path / "my sweep"
    (folder / "run-6").mkdir(parents=True)
    (folder / "run-6" / "report.html").write_text("")
    report = summary(HEADER, forces, folder)
    rows = next(i for i in report.items if isinstance(i, Table) and i.columns[0] == "run").rows
    assert [row[0] for row in rows] == [7, 6, 5]
    assert rows[0][3] == f"wbc sweep --repeat 7 --out '{folder}'" and rows[1][3] == Address(
        "replay", "run-6/report.html"
    )
    assert "error: 0.07, must be < 0.05 m" in rows[0][1] and "push at base [N] = 55" in rows[0][2]
    assert "run-6/report.html" in Page(html(report)).references
    assert "[replay](run-6/report.html)" in markdown(report)


def test_the_page_in_figures_for_programs(forces: list[dict[str, Any]]):
    told = figures(HEADER, forces)
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert (told["runs"], told["good"], told["worst"]) == (8, 5, [7, 6, 5])
    assert told["reasons"] == {"error": 3}
    assert told["demands"][0] == {
        "demand": "error", "relation": "<", "bound": 0.05, "unit": "m", "met": 5, "least": 0.0, "median": 0.035,
        "largest": 0.07,
    }  # fmt: skip


@given(st.lists(st.floats(0.0, 0.3), min_size=2, max_size=60))
def test_every_run_is_in_a_bar(errors: list[float]):
    plots = [item for item in summary(HEADER, [pushed(i, 20.0, e) for i, e in enumerate(errors)]).items
             if isinstance(item, Plot) and item.name.startswith("demand")]  # fmt: skip
    for plot in plots:
        assert np.nansum(plot.curves[0].values) == len(errors) and np.all(np.diff(plot.x) > 0)


@pytest.mark.parametrize("bound", [0.2, 2.0, 200.0, -200.0])
def test_a_bar_of_a_demand_is_as_wide_wherever_the_bound_is(bound: float):
    results = [
        {"run": k, "ok": True, "error": None, "figures": {}, "tracking": {}, "units": {}, "parameters": {},
         **dict.fromkeys(TOLD), "demands": [{"demand": "error", "value": 0.1 * k, "relation": "<", "bound": bound,
                                             "unit": "m", "ok": True}]}
        for k in range(1, 13)
    ]  # fmt: skip
    report = summary(HEADER, results)
    plot = next(one for section in report.sections for one in section.items if isinstance(one, Plot))
    ends = min(*plot.x, bound), max(*plot.x, bound)
    assert np.diff(plot.x) == pytest.approx((ends[1] - ends[0]) / (len(plot.x) - 1))
    assert np.nansum(plot.curves[0].values) == 12
