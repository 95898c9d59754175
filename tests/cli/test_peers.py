"""Other libraries beside ours: scripts that print rows, environments that may be missing, and ratios."""

from __future__ import annotations

import json
import sys

import pytest

from tests.cli.test_bench import Counting, row
from wbc.cli import bench
from wbc.cli.peers import Peers
from wbc.errors import InvalidInput

ROW = {"peer": "placo", "workload": "count", "total_us": {"median": 5.0, "mean": 5.0, "p99": 6.0, "max": 7.0}}


@pytest.fixture
def folder(tmp_path):
    """Scripts of two libraries, an environment for one, and rows measured before for the other."""
    scripts, environments = tmp_path / "peers", tmp_path / "environments"
    scripts.mkdir()
    (scripts / "bench_placo.py").write_text(f"print('about to start')\nprint({json.dumps(json.dumps(ROW))})\n")
    (scripts / "bench_mink.py").write_text("raise SystemExit(1)\n")
    before = [dict(ROW, peer="mink", workload="W1", total_us=dict(ROW["total_us"], median=m)) for m in (9.0, 8.0)]
    (scripts / "results.json").write_text(json.dumps(before))
    python = environments / "vplaco" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.symlink_to(sys.executable)
    return scripts, environments


def test_a_peer_with_an_environment_is_run_now(folder):
    assert Peers(*folder).row("placo", "count", 1) == ROW


def test_a_peer_that_cannot_run_shows_its_best_row_from_before_and_says_so(folder):
    row = Peers(*folder).row("mink", "W1", 1)
    assert row["stored"] and row["total_us"]["median"] == 8.0
    assert Peers(*folder).row("mink", "W5", 1) == {"peer": "mink", "workload": "W5", "failed": True}


def test_libraries_are_asked_only_for_what_they_have(folder):
    assert list(Peers(*folder).names("W1")) == ["placo", "mink"]
    assert list(Peers(*folder).names("W5")) == ["placo"]


def test_the_table_shows_ratios_of_one_sitting(wbc, monkeypatch, folder, tmp_path):
    def timed(*given, **settings):
        split = dict.fromkeys(("update", "fill", "solve", "decode", "rest"), 1.0)
        counts = {"first": 7, "repaired": 0, "fallback": 0}
        more = {"peer": "wbc", "split_us": split, "counts": counts, "total_over_pinocchio": 2.0}
        return row(*given, **settings) | more

    monkeypatch.setattr(bench, "scenarios", lambda group: {"count": Counting()})
    monkeypatch.setattr(bench, "timed", timed)
    scripts, environments = folder
    answer = wbc("bench", "--peers", scripts, "--environments", environments, "--json", "rows.json")
    assert answer.code == 0 and "placo 0.25" in answer.out
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert {row["peer"] for row in rows} == {"wbc", "placo"} and rows[0]["ratio_to"] == {"placo": 0.25}


def test_a_folder_without_scripts_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match=r"holds no bench_\*\.py"):
        Peers(tmp_path)
