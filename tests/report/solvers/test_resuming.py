"""A comparison that is killed loses nothing: taken up again, it ends with the same data."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.qp.zoo import sequence
from wbc.errors import InvalidInput
from wbc.report.journal import Journal
from wbc.report.solvers import compare, resume
from wbc.report.solvers.data import read

PROGRAM = """
import sys
from tests.qp.zoo import sequence
from wbc.report.solvers import compare, resume
if sys.argv[2] == "anew":
    compare(
        sequence(6, n=8), solvers=["pdas", "daqp"], out=sys.argv[1], rounds=2, torture=False, growth=False,
    )
else:
    resume(sys.argv[1])
"""
ROOT = Path(__file__).parents[3]
UNTOUCHED = ("total_us", "rounds_us", "build_us", "solve_us")


def started(folder: Path, how: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", PROGRAM, str(folder), how], cwd=ROOT, stderr=subprocess.DEVNULL)


def without_times(data: dict[str, Any]) -> dict[str, Any]:
    measures = [{key: value for key, value in m.items() if key not in UNTOUCHED} for m in data["measures"]]
    return {**data, "measures": measures, "surroundings": None}


def lines(journal: Path) -> int:
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.deep), pytest.param(3, marks=pytest.mark.deep)])
def test_killed_at_any_moment_and_taken_up_it_gives_the_same_data(tmp_path: Path, seed: int):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert started(whole, "anew").wait() == 0
    journal = tmp_path / "broken.unfinished" / "journal.jsonl"
    process, moment = started(broken, "anew"), random.Random(seed).randrange(2, 26)  # of 32 lines
    while lines(journal) < moment and process.poll() is None:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not broken.exists() and lines(journal) >= moment, "it was killed in the middle of its work"
    kept = journal.read_text().splitlines()[1:moment]
    assert started(broken, "again").wait() == 0
    assert not journal.exists()
    one, other = read(whole / "data.json"), read(broken / "data.json")
    assert without_times(one) == without_times(other)
    first = next(found for found in map(json.loads, kept) if found["key"][-1] == 0)
    (_, _, solver, asked, mode, _, _), rows = first["key"], first["finding"]
    again = next(
        m for m in other["measures"] if (m["solver"], m["class"], m["mode"]) == (solver, asked, mode)
    )  # fmt: skip
    assert all(new <= row["us"][0] for row, new in zip(rows, again["total_us"], strict=True)), "what was timed stays"


def test_a_line_that_was_not_finished_is_cut_off(tmp_path: Path):
    first, second = ({"key": ["solve", name, 0], "finding": [1]} for name in "ab")
    journal = Journal.begin(tmp_path / "j", "key", {"x": 1})
    journal.add(first)
    with (tmp_path / "j").open("a") as file:
        file.write('{"key": ["solve", "b", 0], "find')
    again = Journal(tmp_path / "j", "key")
    assert again.header == {"x": 1} and again.findings == {("solve", "a", 0): first}
    again.add(second)
    assert Journal(tmp_path / "j", "key").findings == {("solve", "a", 0): first, ("solve", "b", 0): second}


def test_what_is_unfinished_is_not_begun_anew_by_accident(tmp_path: Path):
    folder = tmp_path / "report.unfinished"
    folder.mkdir()
    Journal.begin(folder / "journal.jsonl", "key", {})
    with pytest.raises(InvalidInput, match="--resume"):
        compare([], out=tmp_path / "report")


def test_there_must_be_something_to_take_up(tmp_path: Path):
    with pytest.raises(InvalidInput, match="no unfinished comparison"):
        resume(tmp_path / "report")


def test_other_versions_are_another_comparison(tmp_path: Path):
    folder = tmp_path / "report.unfinished"
    folder.mkdir()
    header = {"surroundings": {"versions": {"daqp": "0.0.1"}}, "request": {}}
    Journal.begin(folder / "journal.jsonl", "key", header)
    with pytest.raises(InvalidInput, match="daqp"):
        resume(tmp_path / "report")


def test_the_start_of_a_process_counts_as_progress(tmp_path: Path):
    told: list[float] = []
    compare(sequence(3, n=8), solvers=["pdas", "daqp"], out=tmp_path / "r", rounds=1, torture=False, growth=False,
            progress=lambda done, text="": told.append(done))  # fmt: skip
    first = told.index(0.0) + told.count(0.0)
    assert told == sorted(told) and told[-1] == 1.0
    assert told[first] > 0.4, "half of the time is over when one of two has started, though no solve took long"
