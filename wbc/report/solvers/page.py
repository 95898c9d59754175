"""The page of a comparison: made from its data alone, so the same data give the same bits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from wbc.report.document import Cell, Item, Report, Section, Table, Text, Tile, formatted, percent, plural, short
from wbc.report.solvers import appendix, closing, growth, robustness, solving
from wbc.report.solvers.advice import Advice, advice, disturbances, overall, rounds_spread
from wbc.report.solvers.data import Data
from wbc.report.solvers.statistics import TARGET, percentiles

#: So many names of sets fit into a title.
_FEW = 3


def page(data: Data) -> Report:
    """The report: advice first, then every table and figure behind it."""
    sets = sorted((s for s in data["sets"] if s["kind"] != "growth"), key=lambda s: s["kind"] != "sequence")
    advised = [advice(data, about) for about in sets]
    sections = [section for section in _sections(data, sets, advised) if section.items]
    title = "QP solvers compared" + (f" · {', '.join(s['name'] for s in sets)}" if len(sets) <= _FEW else "")
    names = [solver["name"] for solver in data["solvers"]]
    return Report(title, overall(data, advised), None, sections, _tiles(data, advised), names=names)


def _sections(data: Data, sets: Sequence[Data], advised: list[Advice]) -> Iterator[Section]:
    """Robots first, then problems from files."""
    if advised:
        yield _answer(data, advised)
    for about in sets:
        yield solving.section(data, about)
    yield closing.section(data)
    yield robustness.section(data)
    yield growth.section(data)
    yield appendix.failures(data)
    yield appendix.settings(data)
    yield appendix.limits(data)


def _answer(data: Data, advised: list[Advice]) -> Section:
    use = "fastest" if disturbances(data) else "use"
    columns = (
        "problems",
        use,
        "at",
        f"solved to {short(TARGET)}",
        "median [µs]",
        "p99 [µs]",
        "second",
        "faster than the second",
    )
    rows: list[list[Cell]] = []
    for one in advised:
        if one.use is None:
            rows.append([one.name, "none", "", "0 %", None, None, "", ""])
            continue
        median, p99, _ = percentiles(one.use.times(TARGET))
        share, following = percent(one.use.share(TARGET)), "" if one.next is None else one.next.solver
        rows.append([one.name, one.use.solver, one.at, share, median, p99, following, one.sure])
    spread = rounds_spread(data)
    note = "Time of a whole solve: checks, conversion, back end, certificate." + (
        "" if spread is None else f" The slowest of {data['settings']['rounds']} rounds took {percent(spread - 1.0)} "
        "longer than the fastest, in the median of all measures."
    )  # fmt: skip
    items: list[Item] = [Table(columns, rows, note)]
    if len(advised) > 1:  # of one alone the summary says it
        items += [Text(f"{one.name}: {one.sentence}") for one in advised]
    return Section("Which solver", items)


def _tiles(data: Data, advised: list[Advice]) -> list[Tile]:
    disturbed, uses = disturbances(data), {one.use.solver for one in advised if one.use is not None}
    tiles = [Tile("use", "–" if disturbed else uses.pop())] if len(uses) == 1 else []
    rounds = data["settings"]["rounds"]
    mood = "bad" if disturbed else "good" if rounds > 1 else "doubtful"
    tiles.append(Tile(f"machine, {plural(rounds, 'round')}", "disturbed" if disturbed else "quiet", mood))
    tiles.append(Tile("solvers", str(len(data["solvers"]))))
    tiles.append(Tile("problems", str(sum(len(s["labels"]) for s in data["sets"] if s["kind"] != "growth"))))
    solves = sum(len(m["status"]) for m in data["measures"])
    tiles.append(Tile("solves judged", formatted(solves)))
    wrong = sum(m["status"].count("INACCURATE") for m in data["measures"] if m["class"] == "default")
    tiles.append(
        Tile(
            "wrong solutions, called solved or nearly solved, at default settings",
            str(wrong),
            "bad" if wrong else "good",
        )
    )
    return tiles
