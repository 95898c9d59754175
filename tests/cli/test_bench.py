"""``wbc bench``: rows from the workloads, a table for people, a file for programs."""

from __future__ import annotations

import json

import pytest
from wbc.tasks.workloads.workload import Certified


class Counting(Certified):
    """A scenario that is never run."""

    name, summary, group = "count", "counts to ten", "workloads"


class Recounting(Counting):
    """The same under another name."""

    name = "recount"


def row(scenario, ticks, repeats, *, solver, hierarchy, pause, progress):
    progress(0.5)
    times = {"median": 1.25, "mean": 1.5, "p99": 2.0, "max": 9.0}
    return {
        "workload": scenario.name, "variant": solver, "ticks": ticks, "repeats": repeats, "total_us": times,
        "solver_failures": 0,
    }  # fmt: skip


@pytest.fixture(autouse=True)
def two_workloads(monkeypatch):
    """Two registered workloads, and a row of each without its run."""

    class Point:
        value = "some.package:WORKLOADS"
        load = staticmethod(lambda: {"count": Counting(), "recount": Recounting()})

    monkeypatch.setattr("wbc.plugins.entry_points", lambda group: [Point])
    monkeypatch.setattr("wbc.cli.bench.timed", row)


def test_a_table_has_one_line_for_each_workload(wbc):
    answer = wbc("bench", "--repeats", 2)
    assert answer.code == 0 and answer.out.count("count") == 2 and "1.2" in answer.out and "9.0" in answer.out


def test_columns_stay_whole_in_a_narrow_terminal(wbc, monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes it for a terminal
    answer = wbc("bench", "count", "--repeats", 1)
    assert "\n  median: 1.2\n" in answer.out and "\n  failures: 0\n" in answer.out


def test_a_library_that_does_not_run_is_said_to_and_compared_with_nothing(wbc, tmp_path):
    (tmp_path / "bench_placo.py").touch()
    answer = wbc("bench", "count", "--peers", ".", "--repeats", 1)
    assert answer.code == 0 and "placo, did not run" in answer.out
    assert "ratio" not in answer.out and "inf" not in answer.out


def test_the_file_holds_every_row_whole(wbc, tmp_path):
    assert wbc("bench", "count", "--json", "rows.json", "--ticks", 7, "--repeats", 3, "--solver", "daqp").code == 0
    (row,) = json.loads((tmp_path / "rows.json").read_text())
    assert (row["ticks"], row["repeats"], row["variant"]) == (7, 3, "daqp")
    assert [path.name for path in tmp_path.iterdir()] == ["rows.json"]


def test_an_unknown_workload_is_named_with_its_neighbours(wbc):
    answer = wbc("bench", "recuont")
    assert answer.code == 2 and "there is no scenario 'recuont'; did you mean 'recount'" in answer.err


def test_a_file_that_cannot_be_written_is_refused_before_any_work(wbc, monkeypatch):
    monkeypatch.setattr("wbc.cli.bench.timed", lambda *words, **settings: pytest.fail("it ran"))
    answer = wbc("bench", "--json", "no/such/folder/rows.json")
    assert answer.code == 2 and "rows.json cannot be written" in answer.err
