"""The page of a comparison: made from its data alone, so the same data give the same bits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from wbc.report.document import Cell, Item, Report, Section, Table, Text, Tile, percent
from wbc.report.solvers import appendix, closing, growth, robustness, solving
from wbc.report.solvers.advice import Advice, advice, overall
from wbc.report.solvers.data import Data
from wbc.report.solvers.statistics import TARGET, percentiles
from wbc.report.style import short

#: So many names of sets fit into a title.
_FEW = 3


def page(data: Data) -> Report:
    """The report: advice first, then every table and figure behind it."""
    sets = sorted((s for s in data["sets"] if s["kind"] != "growth"), key=lambda s: s["kind"] != "sequence")
    advised = [advice(data, about) for about in sets]
    sections = [section for section in _sections(data, sets, advised) if section.items]
    title = "QP solvers compared" + (f" · {', '.join(s['name'] for s in sets)}" if len(sets) <= _FEW else "")
    return Report(title, overall(advised), None, sections, _tiles(data, advised))


def _sections(data: Data, sets: Sequence[Data], advised: list[Advice]) -> Iterator[Section]:
    """Robots first, then problems from files."""
    if advised:
        yield _answer(advised)
    for about in sets:
        yield solving.section(data, about)
    yield closing.section(data)
    yield from closing.levels(data)
    yield closing.ranked(data)
    yield robustness.section(data)
    yield growth.section(data)
    yield appendix.failures(data)
    yield appendix.settings(data)
    yield appendix.limits(data)


def _answer(advised: list[Advice]) -> Section:
    columns = ("problems", "use", "at", f"solved to {short(TARGET)}", "median [µs]", "p99 [µs]", "max [µs]")
    rows: list[list[Cell]] = []
    for one in advised:
        if one.use is None:
            rows.append([one.name, "none", "", "0 %", None, None, None])
            continue
        times = percentiles(one.use.times(TARGET))
        rows.append([one.name, one.use.solver, one.at, percent(one.use.share(TARGET)), *times])
    items: list[Item] = [Table(columns, rows, "Times are of a whole solve: checks, conversion, back end, certificate.")]
    if len(advised) > 1:  # of one alone the summary says it
        items += [Text(f"{one.name}: {one.sentence}") for one in advised]
    return Section("Which solver", items)


def _tiles(data: Data, advised: list[Advice]) -> list[Tile]:
    tiles = [Tile("solvers", str(len(data["solvers"])))]
    tiles.append(Tile("problems", str(sum(len(s["labels"]) for s in data["sets"] if s["kind"] != "growth"))))
    solves = sum(len(m["status"]) for m in data["measures"])
    tiles.append(Tile("solves judged", f"{solves:,}".replace(",", " ")))
    wrong = sum(_wrong(m) for m in data["measures"] if m["class"] == "default")
    tiles.append(Tile("wrongly called solved", str(wrong)))
    uses = {one.use.solver for one in advised if one.use is not None}
    if len(uses) == 1:
        tiles.insert(0, Tile("use", uses.pop()))
    return tiles


def _wrong(measure: Data) -> int:
    return int(np.sum([word == "INACCURATE" for word in measure["status"]]))
