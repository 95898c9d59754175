"""The runs of a folder in one table: who is in it, what it says of each, where it leads, and how it sorts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from wbc.errors import InvalidInput
from wbc.report import save_index
from wbc.report.document import Address, Figure, Marked, Table
from wbc.report.index import index
from wbc.report.record import judgement, write_run
from wbc.sim.scenario import Check, ScenarioResult

from .browser import browser, installed
from .conftest import reaching_run

CHROMIUM = installed()


def table(folder: Path) -> Table:
    """The table of runs."""
    (found,) = [item for item in index(folder).items if isinstance(item, Table) and item.sorts]
    return found


@pytest.fixture
def folder(tmp_path: Path, reaching: ScenarioResult) -> Path:
    """Three runs: one that failed, one that passed, and one that failed with a page and a run beside it."""
    for name, check, gain in (
        ("failed", Check("slip", 2.0, "<", 1.0), 10.0),
        ("passed", Check("up", 2.0, ">", 1.0), 9.0),
    ):
        run = reaching_run()
        run.meta["parameters"] = {"gain": gain, "same": 1.0}
        result = ScenarioResult(run, check.ok, {}, {}, [check], robot=reaching.robot)
        run.meta.update(judgement(result))
        run.save(tmp_path / "scenarios" / name)
    (tmp_path / "with").mkdir()
    one = ScenarioResult(
        reaching_run(), True, {}, {}, [], robot=reaching.robot, called="a", beside={"b": reaching_run()}
    )
    write_run(one, tmp_path / "with")
    (tmp_path / "compare").mkdir()
    (tmp_path / "compare" / "report.html").write_text("<title>a &amp; b</title>")
    return tmp_path


def test_every_run_is_there_once_with_what_came_of_it(folder: Path):
    found = table(folder)
    rows = {row[1].text if isinstance(row[1], Address) else row[1]: row for row in found.rows}
    assert list(rows) == ["scenarios/failed", "scenarios/passed", "with"]  # not the run beside another
    failed, passed = rows["scenarios/failed"], rows["scenarios/passed"]
    assert failed[2:4] == [Marked("failed", "bad"), "slip"] and passed[2:4] == [Marked("passed", "good"), None]
    assert isinstance(rows["with"][1], Address) and isinstance(rows["with"][0], Figure) and failed[0] is None
    gain = list(found.columns).index("gain")
    assert [row[gain] for row in rows.values()] == [10.0, 9.0, None]


@pytest.mark.parametrize("text", ["{", "[]", "3", '{"dt": "fast"}', '{"limits": [1]}', "[" * 100_000, '{"dt": -1.0}'])
def test_a_spoilt_run_costs_the_page_only_that_run(folder: Path, text: str):
    (folder / "scenarios" / "failed" / "meta.json").write_text(text)
    failed, passed, other = table(folder).rows
    assert failed[2] == Marked("unreadable", "bad") and "meta.json" in str(failed[3])
    assert passed[2] == Marked("passed", "good") and isinstance(other[1], Address)
    assert "unreadable" in save_index(folder).read_text(encoding="utf-8")


def test_a_run_that_fell_has_the_time_until_it_did(tmp_path: Path):
    for name, ended in (("fell", "fallen at t = 1.981 s"), ("stood", "complete")):
        run = reaching_run()
        run.meta |= {"duration": 4.0, "ended": ended}
        run.save(tmp_path / name)
    found = table(tmp_path)
    simulated = list(found.columns).index("simulated [s]")
    assert [row[simulated] for row in found.rows] == [1.981, 4.0]


def test_only_settings_that_differ_are_columns(folder: Path):
    columns = table(folder / "scenarios").columns
    assert columns == ("", "run", "verdict", "not met", "gain")
    (same,) = [item for item in index(folder / "scenarios").items if isinstance(item, Table) and not item.sorts]
    assert ("parameters.same", 1.0) in list(same.rows)


def test_a_setting_that_is_on_or_off_is_neither_good_nor_bad(tmp_path: Path):
    for name, fails in (("a", True), ("b", False)):
        run = reaching_run()
        run.meta["parameters"] = {"fails": fails}
        run.save(tmp_path / name)
    (made,) = [item for item in index(tmp_path).items if isinstance(item, Table) and item.sorts]
    assert [row[made.columns.index("fails")] for row in made.rows] == ["yes", "no"]


def test_links_lead_to_pages_that_are_there(folder: Path):
    text = save_index(folder).read_text(encoding="utf-8")
    links = re.findall(r'href="([^"#:]+)"', text)
    assert links == ["with/report.html", "compare/report.html"] and all((folder / link).is_file() for link in links)
    assert "compare: a &amp; b" in text and "2 have no page yet" in text
    assert save_index(folder).read_text(encoding="utf-8") == text  # its own page is written over


def test_a_folder_without_runs_and_a_page_of_others_are_refused(folder: Path, tmp_path: Path):
    with pytest.raises(InvalidInput, match="no folder of a run in it"):
        save_index(folder / "compare")
    with pytest.raises(InvalidInput, match="cannot be read"):
        save_index(tmp_path / "nowhere")
    (folder / "index.html").write_text("mine")
    with pytest.raises(InvalidInput, match="is another page"):
        save_index(folder)
    assert (folder / "index.html").read_text() == "mine"


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed to look at the page with")
def test_a_click_in_a_heading_sorts_numbers_as_numbers_and_gaps_last(folder: Path):
    assert CHROMIUM is not None
    page = save_index(folder)
    with browser(CHROMIUM) as tab:
        tab.open(page)
        column = table(folder).columns.index("gain")
        cells = f"[...document.querySelectorAll('[data-sorts] tbody tr')].map(r => r.cells[{column}].textContent)"
        orders = []
        for _ in range(2):
            tab.run(f"document.querySelectorAll('[data-sorts] th')[{column}].click()")
            orders.append(tab.run(cells))
        assert orders == [["9", "10", "–"], ["10", "9", "–"]]
        assert tab.run("document.querySelector('[aria-sort=descending]').textContent") == "gain"
        assert tab.errors == []
