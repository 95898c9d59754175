"""The page: made of the data alone, true to them from the first sentence on, and whole in a browser."""

from __future__ import annotations

import copy
import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.report.browser import browser, installed
from tests.report.solvers.conftest import CLASSES, Compared
from tests.report.solvers.strange import Careless, Lying
from tests.report.test_formats import Page
from wbc.errors import InvalidInput
from wbc.qp import QP
from wbc.qp.solvers import by_name
from wbc.report.document import Marked, Plot, Report, Table
from wbc.report.html import html
from wbc.report.markdown import markdown
from wbc.report.packed import data as data_of
from wbc.report.solvers import compare, redraw
from wbc.report.solvers.advice import advice
from wbc.report.solvers.data import read
from wbc.report.solvers.loop import closed_loop
from wbc.report.solvers.page import page
from wbc.report.solvers.problems import ProblemSet


@pytest.fixture(scope="module")
def report(compared: Compared) -> Report:
    return page(read(compared.folder / "data.json"))


def tables(report: Report, section: str) -> list[Table]:
    return [i for s in report.sections if s.title == section for i in s.items if isinstance(i, Table)]


@pytest.mark.slow
def test_all_sections_are_there(report: Report):
    assert [section.title for section in report.sections] == [
        "Which solver", "ticks", "reach", "mixed", "In the closed loop", "Torture", "Failures", "Settings",
        "Limits of this comparison",
    ]  # fmt: skip


def test_the_same_data_give_the_same_bits(compared: Compared, tmp_path: Path):
    redraw(compared.folder, tmp_path / "again")
    for name in ("report.html", "report.md", "data.json"):
        assert (tmp_path / "again" / name).read_bytes() == (compared.folder / name).read_bytes(), name


def test_pages_that_are_written_over_leave_the_problems_where_they_are(compared: Compared, tmp_path: Path):
    def files(folder: Path) -> dict[str, bytes]:
        return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}

    folder = shutil.copytree(compared.folder, tmp_path / "comparison")
    redraw(folder / "data.json", folder)
    assert files(folder) == files(compared.folder)


def test_data_of_something_else_are_refused(tmp_path: Path):
    for text in ("no json", "[]", '{"format": 99}'):
        (tmp_path / "data.json").write_text(text)
        with pytest.raises(InvalidInput):
            redraw(tmp_path, tmp_path / "out")


def good_times(data: dict[str, Any], name: str, solver: str, asked: str) -> tuple[np.ndarray, int]:
    """Times of a solver in a class where its answer is good to 1e-6, from the raw data; and out of how many."""
    about = next(s for s in data["sets"] if s["name"] == name)
    mode = "cold" if about["kind"] == "files" else "warm"
    first = {start for start, _ in about["stretches"]} if mode == "warm" else set()
    (m,) = (
        m for m in data["measures"]
        if (m["set"], m["solver"], m["class"], m["mode"]) == (name, solver, asked, mode)
    )  # fmt: skip
    times = []
    for i in range(len(about["labels"])):
        kkt = [m[part][i] for part in ("primal", "dual", "gap")]
        if i not in first and None not in kkt and max(kkt) <= 1e-6:
            times.append(m["total_us"][i])
    return np.array(times), len(about["labels"]) - len(first)


def test_the_first_screen_says_what_to_use_and_that_is_true(compared: Compared, report: Report):
    data = compared.data
    assert re.search(r"(pdas|osqp) at (its default settings|tolerance 1e-\d)", report.summary)
    (advised,) = tables(report, "Which solver")
    assert [row[0] for row in advised.rows] == ["ticks", "reach", "mixed"]
    for name, use, at, share, median, *_ in advised.rows:
        asked = "default" if at == "its default settings" else at.removeprefix("tolerance ")
        times, count = good_times(data, name, use, asked)
        assert share == "100 %" and len(times) == count
        np.testing.assert_allclose(median, np.median(times), rtol=1e-12)
        others = [good_times(data, name, other, a) for other in ("pdas", "osqp") if other != use for a in CLASSES]
        complete = [np.log(found).mean() for found, count in others if len(found) == count]
        assert np.log(times).mean() <= min(complete) + np.log(1.5), (
            "no other is faster by more than the default may cost"
        )


def advised(data: dict[str, Any]) -> dict[str, str | None]:
    """The solver advised for each set."""
    found = [advice(data, about) for about in data["sets"]]
    return {one.name: None if one.use is None else one.use.solver for one in found}


def test_the_advice_follows_the_data(compared: Compared):
    """Where the fast solver stops solving, the other one is advised; where nobody solves, nobody is."""
    data = copy.deepcopy(compared.data)
    use = advised(data)["mixed"]
    for m in data["measures"]:
        if (m["set"], m["solver"]) == ("mixed", use):
            m["dual"][0] = 1e-2
    assert {use, advised(data)["mixed"]} == {"pdas", "osqp"}
    for m in data["measures"]:
        m["dual"] = [None] * len(m["dual"])
    assert set(advised(data).values()) == {None}
    report = page(data)
    assert report.summary.startswith("No solver can be advised") and report.items, "a page is drawn all the same"


def test_a_solver_with_which_the_robot_fails_is_not_advised_for_it(compared: Compared):
    data = copy.deepcopy(compared.data)
    use = advised(data)["reach"]
    for loop in data["loops"]:
        loop["ok"] = loop["solver"] != use
    assert {use, advised(data)["reach"]} == {"pdas", "osqp"}


def test_a_solver_that_is_right_only_when_it_is_refined_is_told_so(ticks: ProblemSet):
    data = compare(ticks, solvers=["pdas", Careless()], classes={"default": None}, rounds=1)
    assert all(set(one["status"]) == {"SOLVED"} for one in data["measures"])
    report = page(data)
    solved = next(table for table in tables(report, "ticks") if "lost" in table.columns)
    assert [str(row[1]) for row in solved.rows] == ["100 %", "100 % (0 % by itself)"]
    alone = compare(ticks, solvers=[Careless()], classes={"default": None}, rounds=1)
    said = advice(alone, alone["sets"][0]).sentence
    assert "7 of its own solutions were not that good before the library refined them" in said


def test_ticks_that_another_solver_solved_are_said(compared: Compared):
    """The controller goes on with its fallback where a solver fails, and the robot meets every demand."""
    reach = f"{Path(__file__).with_name('reaching.py')}:reach"
    way, how = (
        {"way": 0.25, "good": True, "robot": "arm"},
        {"plant": "integrator", "hierarchy": "weighted", "duration": 0.02},
    )
    loops = [closed_loop(reach, way, how, solver) for solver in (by_name("daqp"), Lying())]
    assert [loop["ok"] for loop in loops] == [True, True]
    assert loops[0]["helped"] == 0.0 and loops[1]["helped"] > 0.5
    data = copy.deepcopy(compared.data)
    for loop in data["loops"]:
        loop["helped"] = 0.25 * (loop["solver"] == "osqp")
    text = page(data).items
    assert any("another solver had to solve ticks of osqp" in getattr(item, "text", "") for item in text)
    (table, *_) = tables(page(data), "In the closed loop")
    told = {row[0]: row[table.columns.index("by another")] for row in table.rows}
    assert told == {"pdas": "0 %", "osqp": Marked("25 %", "bad")}


@pytest.mark.parametrize("period", [5e-4, 2e-3, None])
def test_solves_are_compared_with_the_period_of_the_controller(compared: Compared, period: float | None):
    data = quiet(compared)
    about = next(s for s in data["sets"] if s["name"] == "reach")
    about["period"] = period
    for m in data["measures"]:
        m["total_us"] = [t and 1500.0 for t in m["total_us"]]
    said = "75 % of a period of 2 ms" if period == 2e-3 else f"misses a period of {1e3 * (period or 1e-3):g} ms"
    assert said in advice(data, about).sentence
    table = next(t for t in tables(page(data), "reach") if "compared on" in t.columns)
    late = table.rows[0][table.columns.index(f"over {1e3 * (period or 1e-3):g} ms")]
    assert (late == 0) is (period == 2e-3)


def quiet(compared: Compared, rounds: list[float] | None = None) -> dict[str, Any]:
    """The data as a quiet machine would give them: every round as fast as the first, or slower by these factors."""
    data = copy.deepcopy(compared.data)
    data["surroundings"] |= {"load": [0.2, 0.2, 0.2], "load_after": [1.0, 1.0, 1.0], "machine": {"cores": 2}}
    for m in data["measures"]:
        m["rounds_us"] = [[t and factor * t for t in m["total_us"]] for factor in rounds or [1.0, 1.1]]
    return data


def test_a_recommendation_says_how_sure_it_is(compared: Compared):
    use = advised(quiet(compared))["ticks"]
    report = page(quiet(compared))
    (table,) = tables(report, "Which solver")
    assert report.summary.startswith("Use ") and table.columns[1] == "use"
    assert table.rows[0][-1].startswith("in each of 2 rounds, ")
    once = page(quiet(compared, [1.0]))
    assert "--rounds 3 shows" in once.summary and tables(once, "Which solver")[0].rows[0][-1].mood == "doubtful"
    data = quiet(compared)
    for m in data["measures"]:
        if (m["set"], m["solver"]) == ("ticks", use):
            m["rounds_us"][1] = [t and 1000.0 * t for t in m["total_us"]]
    report = page(data)
    assert "The rounds do not agree" in report.summary
    assert tables(report, "Which solver")[0].rows[0][-1].text == "faster in 1 of 2 rounds"


@pytest.mark.parametrize(("what", "said"), [
    ({"load": [11.28, 5.0, 2.0]}, "load 11.28 on 2 cores when it began"),
    ({"load_after": [2.5, 1.0, 1.0]}, "load 2.5 on 2 cores when it ended"),
    (None, "rounds differ by a factor of 1.40"),
])  # fmt: skip
def test_nothing_is_recommended_where_the_machine_was_disturbed(
    compared: Compared, what: dict[str, Any] | None, said: str
):
    data = quiet(compared) if what else quiet(compared, [1.0, 1.4, 1.2])
    data["surroundings"] |= what or {}
    report = page(data)
    assert (
        report.summary.startswith("No solver is recommended: other work disturbed the times") and said in report.summary
    )
    assert tables(report, "Which solver")[0].columns[1] == "fastest"
    assert not any(tile.what == "use" and tile.value != "–" for tile in report.highlights)


def test_a_solver_has_one_colour_on_the_whole_page(compared: Compared, report: Report):
    assert report.names == ["pdas", "osqp"]
    seen = {}
    for plot in data_of(report)["plots"]:
        for curve in (curve for table in plot["tables"] for curve in table["curves"]):
            seen.setdefault(curve["label"], set()).add(curve["colour"])
    assert seen["pdas"] == {0} and seen["osqp"] == {1}


def test_the_accuracy_is_the_certificates_bound_of_each_task_in_its_unit(compared: Compared, report: Report):
    table = next(t for t in tables(report, "reach") if t.caption.startswith("Accuracy of all solutions"))
    rows = {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert {"limits exceeded [rad/s]", "Position[tool] [m/s]", "Posture [rad/s]"} <= set(rows)
    (entry,) = (
        m for m in compared.data["measures"]
        if (m["set"], m["solver"], m["mode"], m["class"]) == ("reach", "pdas", "warm", "default")
    )  # fmt: skip
    firsts = {start for start, _ in compared.data["sets"][1]["stretches"]}
    worst = max(b for i, b in enumerate(entry["bounds"]["Position[tool]"]) if i not in firsts)
    told = rows["Position[tool] [m/s]"]["pdas"]
    assert told == "< 1e-12" if worst < 1e-12 else float(told) == pytest.approx(worst, rel=0.1)


def test_no_figure_is_negative_or_not_a_number(report: Report):
    for section in report.sections:
        for table in (i for i in section.items if isinstance(i, Table)):
            for row in table.rows:
                for column, cell in zip(table.columns, row, strict=True):
                    assert not (isinstance(cell, float) and (np.isnan(cell) or cell < 0)), (section.title, column, row)


def test_raw_data_are_strict_json(compared: Compared):
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    json.loads((compared.folder / "data.json").read_text(), parse_constant=refuse)


def test_text_and_page_hold_the_same_tables(report: Report):
    text, cells = markdown(report), Page(html(report)).cells
    assert sum(len(row) for s in report.sections for i in s.items if isinstance(i, Table) for row in i.rows) == len(
        cells
    )
    assert all(cell.replace("|", "\\|") in text for cell in cells)


def test_the_page_is_small_and_needs_nothing_else(compared: Compared, report: Report):
    text = (compared.folder / "report.html").read_text(encoding="utf-8")
    assert len(text) < 1e6 and "@import" not in text
    references = Page(text).references
    assert all(reference.startswith(("data:", "#")) for reference in references)
    plots = [item for item in report.items if isinstance(item, Plot)]
    assert text.count("data-plot=") == len(plots) >= 6


def test_every_failure_can_be_taken_up(compared: Compared):
    text = (compared.folder / "report.md").read_text()
    files = set(re.findall(r"failures/[\w-]+\.npz", text))
    assert files == {f"failures/{path.name}" for path in (compared.folder / "failures").glob("*.npz")}
    for file in files:
        assert QP.load(compared.folder / file).n > 0


@pytest.mark.skipif(installed() is None, reason="no chromium or chrome here; the parser tests above always run")
def test_a_browser_shows_it_whole_and_without_complaint(compared: Compared, report: Report):
    """Everything is drawn, nothing was asked of a network, and no table leaves the page."""
    with browser(installed()) as tab:
        for width in (1280, 390):
            tab.open(compared.folder / "report.html", width=width)
            assert not tab.errors and all(address.startswith(("file:", "data:")) for address in tab.requests)
            drawn = tab.run("document.querySelectorAll('.uplot canvas').length")
            assert drawn == sum(isinstance(item, Plot) for item in report.items)
            assert tab.run("document.documentElement.scrollWidth") <= width
