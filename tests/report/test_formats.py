"""The two formats: the same tables in both, one page that needs nothing else, text that can be compared."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from wbc.report import Report, Section, Table, Text
from wbc.report.document import formatted, readable
from wbc.report.html import html
from wbc.report.markdown import markdown


class Page(HTMLParser):
    """Collects what a page refers to, its cells and its headings."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.cells: list[str] = []
        self.headings: list[str] = []
        self._inside: str | None = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.references += [value for name, value in attrs if name in ("src", "href", "srcset", "action") and value]
        if tag in ("td", "h2"):
            self._inside = tag
            (self.cells if tag == "td" else self.headings).append("")

    def handle_endtag(self, tag):
        if tag == self._inside:
            self._inside = None

    def handle_data(self, data):
        if self._inside:
            (self.cells if self._inside == "td" else self.headings)[-1] += data


@pytest.fixture(scope="session")
def page(folder: Path) -> Page:
    """The written page, parsed."""
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def test_the_page_needs_no_other_address(folder: Path, page: Page):
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert "@import" not in text and '<link rel="stylesheet"' not in text
    assert all(reference.startswith(("data:", "#")) for reference in page.references)


def test_the_licences_of_the_libraries_in_the_page_stand_in_it(folder: Path):
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert "Leon Sorokin" in text and "three.js authors" in text and text.count("Permission is hereby granted") == 2


def test_every_picture_is_in_the_page(report: Report, page: Page):
    pictures = [reference for reference in page.references if reference.startswith("data:image/")]
    assert len(pictures) == len(report.figures) == 1


def test_every_link_within_the_page_leads_somewhere(folder: Path, page: Page):
    text = (folder / "report.html").read_text(encoding="utf-8")
    anchors = [reference[1:] for reference in page.references if reference.startswith("#")]
    assert len({anchor for anchor in anchors if not anchor.startswith("plot-")}) == len(page.headings)
    assert all(text.count(f'id="{anchor}"') == 1 for anchor in anchors)


def test_both_formats_have_the_same_sections_and_cells(report: Report, folder: Path, page: Page):
    text = (folder / "report.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", text, re.M) == page.headings == [section.title for section in report.sections]
    tables = [item for section in report.sections for item in section.items if isinstance(item, Table)]
    cells = [formatted(cell) for table in tables for row in table.rows for cell in row]
    assert page.cells == cells
    for cell in cells:
        assert cell.replace("|", "\\|") in text


def test_every_table_of_the_text_has_as_many_cells_in_each_row(folder: Path):
    text = (folder / "report.md").read_text(encoding="utf-8")
    blocks = re.findall(r"(?:^\|.*\n?)+", text, re.M)
    assert len(blocks) > 8
    for block in blocks:
        heading, rule, *rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in block.strip().splitlines()]
        assert all(re.fullmatch(r" (:--|--:) ", cell) for cell in rule)
        assert {len(row) for row in (heading, rule, *rows)} == {len(heading)}


def test_every_picture_of_the_text_is_there(folder: Path, report: Report):
    text = (folder / "report.md").read_text(encoding="utf-8")
    paths = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
    assert len(paths) == len(report.figures)
    assert all((folder / path).stat().st_size > 500 for path in paths)


def test_what_a_user_names_cannot_become_markup():
    nasty = "<script>alert('x')</script> | `a`"
    report = Report(nasty, nasty, False, [Section("S", [Text(nasty), Table((nasty,), [(nasty,)], nasty)])])
    assert "<script>" not in html(report)
    rows = [line for line in markdown(report).splitlines() if line.startswith("|")]
    assert all(len(re.split(r"(?<!\\)\|", row)) == 3 for row in rows)


def test_the_verdict_is_on_the_page_in_words():
    for ok, word in ((True, "passed"), (False, "failed")):
        report = Report("t", "s", ok, [])
        assert f">{word}</span>" in html(report) and f"**{word}**" in markdown(report)


def test_the_report_folder_is_small(folder: Path):
    assert sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) < 10e6


@pytest.mark.parametrize(("unit", "shown"), [("m", "mm"), ("rad", "mrad"), ("N m", "N m"), ("", "")])
def test_small_errors_are_shown_in_small_units(unit: str, shown: str):
    factor, text = readable(unit)
    assert text == shown and factor == (1e3 if shown != unit else 1.0)
