"""The page: made of the data alone, true to them from the first sentence on, and whole in a browser."""

from __future__ import annotations

import copy
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.report.solvers.conftest import CLASSES, Compared
from tests.report.test_formats import Page
from wbc.errors import InvalidInput
from wbc.qp import QP
from wbc.report.document import Report, Table
from wbc.report.html import html
from wbc.report.markdown import markdown
from wbc.report.solvers import redraw
from wbc.report.solvers.advice import advice
from wbc.report.solvers.data import read
from wbc.report.solvers.page import page

BROWSER = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), ""
)


@pytest.fixture(scope="module")
def report(compared: Compared) -> Report:
    return page(read(compared.folder / "data.json"))


def tables(report: Report, section: str) -> list[Table]:
    return [i for s in report.sections if s.title == section for i in s.items if isinstance(i, Table)]


def test_all_sections_are_there(report: Report):
    assert [section.title for section in report.sections] == [
        "Which solver", "ticks", "reach", "mixed", "In the closed loop", "Hierarchies", "Weights", "Torture",
        "Failures", "Settings", "Limits of this comparison",
    ]  # fmt: skip


def test_the_same_data_give_the_same_bits(compared: Compared, tmp_path: Path):
    redraw(compared.folder, tmp_path / "again")
    for name in ("report.html", "report.md", "data.json"):
        assert (tmp_path / "again" / name).read_bytes() == (compared.folder / name).read_bytes(), name
    for path in (compared.folder / "figures").iterdir():
        assert (tmp_path / "again" / "figures" / path.name).read_bytes() == path.read_bytes(), path.name


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
    assert re.match(r"Use (pdas|osqp) at (its default settings|tolerance 1e-\d)", report.summary)
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
    assert report.summary.startswith("No solver can be advised") and report.figures, "a page is drawn all the same"


def test_a_solver_with_which_the_robot_fails_is_not_advised_for_it(compared: Compared):
    data = copy.deepcopy(compared.data)
    use = advised(data)["reach"]
    for loop in data["loops"]:
        loop["ok"] = loop["solver"] != use
    assert {use, advised(data)["reach"]} == {"pdas", "osqp"}


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
    assert len(text) < 10e6 and "http:" not in text and "https:" not in text and "@import" not in text
    references = Page(text).references
    assert all(reference.startswith(("data:", "#")) for reference in references)
    pictures = [reference for reference in references if reference.startswith("data:image/svg+xml;base64,")]
    assert len(pictures) == len(report.figures) >= 7


def test_every_failure_can_be_taken_up(compared: Compared):
    text = (compared.folder / "report.md").read_text()
    files = set(re.findall(r"failures/[\w-]+\.npz", text))
    assert files == {f"failures/{path.name}" for path in (compared.folder / "failures").glob("*.npz")}
    for file in files:
        assert QP.load(compared.folder / file).n > 0


@pytest.mark.skipif(not BROWSER, reason="no chromium or chrome here; the parser tests above always run")
def test_a_browser_shows_it_whole_and_without_complaint(compared: Compared, report: Report, tmp_path: Path):
    """Every picture has a size, nothing was asked of a network, nothing was written to the console."""
    probe = (
        "<script>window.addEventListener('load', () => { const sizes = [...document.images].map(i => i.naturalWidth);"
        "document.title = JSON.stringify({pictures: sizes.length, empty: sizes.filter(w => !w).length,"
        "asked: performance.getEntriesByType('resource').filter(e => !e.name.startsWith('data:')).length,"
        "sections: document.querySelectorAll('section').length,"
        "wide: document.documentElement.scrollWidth > document.documentElement.clientWidth + 1}); });</script></head>"
    )
    text = (compared.folder / "report.html").read_text(encoding="utf-8")
    (tmp_path / "page.html").write_text(text.replace("</head>", probe, 1), encoding="utf-8")
    for width in (1280, 390):
        done = subprocess.run(
            [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--v=0",
             "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}",
             f"--window-size={width},900", "--dump-dom", f"file://{tmp_path / 'page.html'}"],
            capture_output=True, text=True, timeout=120, check=True,
        )  # fmt: skip
        seen = json.loads(re.search(r"<title>(.*?)</title>", done.stdout).group(1).replace("&quot;", '"'))
        assert seen == {
            "pictures": len(report.figures), "empty": 0, "asked": 0, "sections": len(report.sections), "wide": False,
        }  # fmt: skip
        assert "CONSOLE" not in done.stderr
