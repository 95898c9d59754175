"""``wbc report solvers`` and ``wbc sweep`` as a user types them."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

from tests.qp.zoo import random_qp
from tests.report.conftest import reaching_run
from wbc.control.recorder import Run
from wbc.report import save_report

HERE = Path(__file__).parents[1]
FLIP = f"{HERE / 'sweep' / 'flipping.py'}:flip"


@pytest.fixture
def problems(tmp_path: Path) -> Path:
    folder = tmp_path / "problems"
    folder.mkdir()
    for seed in range(3):
        random_qp(seed, 6, 1, 4).save(folder / f"{seed}.npz")
    return folder


def test_a_folder_of_problems_becomes_a_report_and_the_report_again(wbc, problems: Path, tmp_path: Path):
    quick = ("--rounds", "1", "--no-torture", "--no-growth", "--solver", "pdas", "--solver", "daqp")
    answer = wbc("report", "solvers", problems, "--out", "report", *quick)
    assert answer.code == 0, answer.err
    assert answer.out.startswith(("Use ", "No solver is recommended"))
    assert answer.out.strip().endswith("report/report.html")
    names = {path.name for path in (tmp_path / "report").iterdir()}
    assert names == {"report.html", "report.md", "data.json", "problems", "failures"}
    assert wbc("report", "solvers", "--from", "report", "--out", "again").code == 0
    assert (tmp_path / "again" / "report.md").read_bytes() == (tmp_path / "report" / "report.md").read_bytes()


@pytest.mark.parametrize("own", [False, True])
def test_an_interrupt_says_how_to_go_on_and_that_goes_on(wbc, problems: Path, own: bool, monkeypatch):
    """A scenario that is Python code has to be named again."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    reach = f"{Path(__file__).parent.with_name('report') / 'solvers' / 'reaching.py'}:reach"
    given = (reach, "--duration", "0.02", "--ticks", "2", "--no-loop") if own else (problems,)
    with monkeypatch.context() as stopped:
        stopped.setattr("wbc.report.solvers.comparison.work", interrupted)
        answer = wbc("report", "solvers", *given, "--solver", "pdas", "--rounds", "1", "--out", "my report")
    assert answer.code == 130 and "--resume --out 'my report'" in answer.err
    again = wbc(*shlex.split(answer.err.rsplit("stays: wbc ", 1)[1]))
    assert again.code == 0 and "report.html" in again.out, again.err


def test_a_sweep_becomes_results_and_a_report(wbc, tmp_path: Path):
    pytest.importorskip("distributed", reason="the extra sweep is not installed")
    answer = wbc("sweep", FLIP, "--runs", "6", "--vary", "bias=0:1", "--set", "faces=6", "--workers", "1", "--out", "s")
    assert answer.code == 0, answer.err
    assert "of 6 runs of flipping.py:flip" in answer.out.replace("\n", " ")
    header, *lines = map(json.loads, (tmp_path / "s" / "results.jsonl").read_text().splitlines())
    assert header["runs"] == 6 and [line["run"] for line in lines] == list(range(6))
    again = wbc("sweep", FLIP, "--repeat", "4", "--out", "s", "--json")
    assert json.loads(again.out)["report"] is None, "a coin has no joints to draw"
    assert json.loads(again.out)["parameters"] == lines[4]["parameters"] and again.code == 0
    assert np.all([line["parameters"]["faces"] == 6 for line in lines])


def test_a_run_of_a_sweep_has_a_page_when_it_is_asked_for(wbc, waving: str, tmp_path: Path):
    pytest.importorskip("distributed", reason="the extra sweep is not installed")
    answer = wbc("sweep", waving, "--runs", "2", "--workers", "1", "--out", "s", "--json")
    told = json.loads(answer.out)
    assert answer.code == 0 and told["runs"] == 2 and told["report"] == str(tmp_path / "s" / "report.html")
    answer = wbc("sweep", waving, "--repeat", "1", "--out", "s")
    assert answer.code == 0 and answer.out.endswith("s/run-1/report.html\n")
    assert (tmp_path / "s" / "run-1" / "run.npz").is_file()
    results = tmp_path / "s" / "results.jsonl"
    results.write_text(results.read_text().splitlines(keepends=True)[0])
    assert wbc("sweep", waving, "--repeat", "0", "--out", "s").code == 0, "of no result there is no page to write"


def test_the_report_of_a_record_is_opened_or_made_from_it(wbc, waving: str, tmp_path: Path, monkeypatch):
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert wbc("run", waving, "--out", "r").code == 0
    page = tmp_path / "r" / "report.html"
    first = page.read_bytes()
    page.write_bytes(b"mine")
    answer = wbc("report", "run", "r", "--open")
    assert (answer.code, answer.out, answer.err) == (0, f"report: {page}\n", "")
    assert opened == [page.as_uri()] and page.read_bytes() == b"mine"
    answer = wbc("report", "run", "r", "--again")
    assert answer.code == 0 and page.read_bytes() == first, "verdict, figures and motion are those of the run"
    assert opened == [page.as_uri()]
    page.unlink()
    assert wbc("report", "run", "r").code == 0 and page.read_bytes() == first


def test_a_record_of_an_unknown_robot_is_drawn_when_one_is_given(wbc, waving: str, tmp_path: Path):
    assert wbc("run", waving, "--out", "r").code == 0
    meta = json.loads((tmp_path / "r" / "meta.json").read_text())
    (tmp_path / "r" / "meta.json").write_text(json.dumps(meta | {"robot": "mine"}))
    page = tmp_path / "r" / "report.html"
    first = page.read_bytes()
    answer = wbc("report", "run", "r", "--again")
    assert answer.code != 0 and "shows the robot 'mine'" in answer.err and page.read_bytes() == first
    page.unlink()
    answer = wbc("report", "run", "r")
    assert answer.code == 0 and answer.err == (
        "note: the motion is not drawn: the run's robot cannot be loaded by its name; give --robot\n"
    )
    assert "## Motion" not in (tmp_path / "r" / "report.md").read_text()
    answer = wbc("report", "run", "r", "--robot", "arm")
    assert answer.code == 0 and not answer.err and "## Motion" in (tmp_path / "r" / "report.md").read_text()


@pytest.mark.parametrize(
    ("words", "about"),
    [(("nowhere",), "not the folder of a run"), (("problems",), "not the folder of a run"), ((), "'folder'")],
)
def test_a_folder_without_a_record_has_no_report(wbc, problems: Path, words, about):
    answer = wbc("report", "run", *words)
    assert answer.code == 2 and about in answer.err and answer.err.count("\n") == 1 and not answer.out


def test_recorded_runs_become_one_page(wbc, tmp_path: Path):
    for name in ("runs/a", "runs/b", "more/a"):
        reaching_run().save(tmp_path / name)
    answer = wbc("compare", "runs/a", "runs/b", "--out", "c")
    assert answer.code == 0 and answer.out.strip() == f"report: {tmp_path / 'c' / 'report.html'}"
    text = (tmp_path / "c" / "report.md").read_text(encoding="utf-8")
    assert text.startswith("# a · b") and "Every setting is the same" in text
    assert "1 names are given for 2 runs" in wbc("compare", "runs/a", "runs/b", "--name", "one").err
    assert "called the same" in wbc("compare", "runs/a", "runs/a").err
    assert "nothing to compare" in wbc("compare", "runs/a").err
    assert wbc("compare", "runs/a", "more/a", "--out", "c").code == 0
    save_report(reaching_run(), tmp_path / "runs" / "c")
    answer = wbc("compare", "runs/a", "runs/c", "--out", "runs/c")
    assert answer.code == 2 and "run.npz, which would be lost" in answer.err and Run.load(tmp_path / "runs" / "c").rows
    assert (tmp_path / "c" / "report.md").read_text(encoding="utf-8").startswith("# runs/a · more/a")
