"""What a run gives, what a sweep reports of many."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.report.test_formats import Page
from wbc.errors import InvalidInput
from wbc.report.document import Table
from wbc.report.html import html
from wbc.report.markdown import markdown
from wbc.sweep import Range, Sweep
from wbc.sweep.draw import RandomNoise
from wbc.sweep.lines import Lines, write
from wbc.sweep.summary import interval, summary
from wbc.sweep.trial import done

FLIP = f"{Path(__file__).with_name('flipping.py')}:flip"
REACH = f"{Path(__file__).parents[1] / 'report' / 'solvers' / 'reaching.py'}:reach"
HEADER = {
    "scenario": "flipping.py:flip", "sweep": "bias = 0:1", "runs": 60, "seed": 0, "date": "today", "machine": {},
    "versions": {}, "plan": "",
}  # fmt: skip


def test_a_run_is_one_line_of_json_and_the_same_again():
    trial = Sweep(FLIP, runs=5, vary={"bias": Range(0, 1)}).trial(3)
    one = done(trial)
    assert json.loads(json.dumps(one, allow_nan=False)) == one == done(trial)
    assert one["run"] == 3 and one["unsolved"] == 0 and set(one["tracking"]) == {"Height"}
    assert one["failed"] == ([] if one["ok"] else ["shows head"])


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
    lines = Lines.begin(tmp_path / "r", HEADER)
    for run in (4, 1, 4):
        lines.add({"run": run, "ok": True})
    with (tmp_path / "r").open("a") as file:
        file.write('{"run": 9, "o')
    again = Lines(tmp_path / "r")
    assert again.header == HEADER and again.in_order() == [{"run": 1, "ok": True}, {"run": 4, "ok": True}]
    again.add({"run": 2, "ok": False})
    write(tmp_path / "w", HEADER, Lines(tmp_path / "r").in_order())
    assert [r["run"] for r in Lines(tmp_path / "w").in_order()] == [1, 2, 4]
    (tmp_path / "x").write_text("no json\n")
    with pytest.raises(InvalidInput):
        Lines(tmp_path / "x")


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
    tables = {
        item.columns[:2]: item for section in report.sections for item in section.items if isinstance(item, Table)
    }
    assert tables["of", "value"].rows[0][2:4] == [60, good]
    assert {row[0]: row[1] for row in tables["why not", "runs"].rows} == {
        "not met: shows head": 59 - good,
        "error: KilledWorker: gone": 1,
    }
    heights = sorted(r["tracking"]["Height"] for r in results if "tracking" in r)
    row = next(row for row in tables["figure", "runs"].rows if row[0] == "Height, rms")
    assert row[1] == 59 and row[2] == heights[0] and row[4] == heights[29] and row[6] == heights[-1]
    assert html(report) == html(summary(HEADER, results)) and markdown(report) == markdown(summary(HEADER, results))
    pictures = [x for x in Page(html(report)).references if x.startswith("data:image/")]
    assert len(pictures) == len(report.figures) == 2
