"""A report as Markdown: the same tables, one row a line, so that two reports can be compared; pictures are files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.report.document import Address, Cell, Figure, Item, Map, Plot, Report, Scene, Table, Text, formatted

FIGURES = "figures"


def markdown(report: Report) -> str:
    """The text of ``report.md``; pictures are expected in ``figures/`` beside it."""
    verdict = "" if report.ok is None else f"**{'passed' if report.ok else 'failed'}**: "
    lines = [f"# {report.title}", "", f"{verdict}{report.summary}", ""]
    if report.highlights:
        lines += [*table(Table(("", "value"), [tile[:2] for tile in report.highlights])), ""]
    for section in report.sections:
        lines += [f"## {section.title}", ""]
        for item in section.items:
            lines += [*_item(item), ""]
    return "\n".join(lines)


def picture_path(figure: Figure) -> str:
    """Where a picture lies, relative to the report."""
    return f"{FIGURES}/{figure.name}.{figure.kind}"


def table(data: Table) -> list[str]:
    """A pipe table; numbers are set to the right."""
    lines = [_row(data.columns), _row(["--:" if right else ":--" for right in data.numeric])]
    return lines + [_row([_cell(cell) for cell in row]) for row in data.rows]


def _cell(cell: Cell) -> str:
    return f"[{cell.text}]({cell.href})" if isinstance(cell, Address) else formatted(cell)


def _item(item: Item) -> list[str]:
    match item:
        case Text(text):
            return [text]
        case Table():
            return [*([item.caption, ""] if item.caption else []), *table(item)]
        case Figure():
            return [f"![{item.caption}]({picture_path(item)})", "", f"*{item.caption}*"]
        case Plot():
            return _curves(item)
        case Map():
            return [f"*{item.title}: drawn in the page.*"]
        case Scene():
            return [f"*{item.caption}*"]


def _curves(plot: Plot) -> list[str]:
    """What a plot shows in numbers: the range of each curve that is seen at first."""
    about = f"{plot.title} [{plot.unit}] over {plot.over}" if plot.unit else f"{plot.title} over {plot.over}"
    bounds = "".join(f"{(b.label and f'; {b.label}:') or ','} {formatted(b.value)}" for b in plot.bounds)
    rows: list[tuple[Cell, ...]] = []
    for curve in plot.curves:
        known = curve.values[np.isfinite(curve.values)]
        if curve.shown and known.size:
            rows.append((curve.label, float(known.min()), float(known.mean()), float(known.max())))
    if plot.strips:
        spent = [(strip.label, float(sum(end - start for start, end in strip.intervals))) for strip in plot.strips]
        return [f"{about}{bounds}", "", *table(Table(("", "time [s]"), spent))]
    return [f"{about}{bounds}", "", *table(Table(("curve", "lowest", "mean", "highest"), rows))]


def _row(cells: Sequence[Cell]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"
