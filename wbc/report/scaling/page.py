"""The page of scaling curves, made of its data alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from wbc.report.document import Cell, Curve, Plot, Report, Section, Table, Text, number, percent
from wbc.report.scaling.slope import Slope, slope
from wbc.report.sections.settings import measured
from wbc.types import Vec

Row = dict[str, Any]

KINDS = {"chosen": "chosen form", "standard": "standard form"}
#: Two forms whose times differ by less are called equal.
_EQUAL = 0.05


def page(data: dict[str, Any]) -> Report:
    """Curves with exponents, where the chosen form stops paying, every number, and what is not shown."""
    rows: list[Row] = data["rows"]
    names = list(dict.fromkeys(row["axis"] for row in rows))
    sections = [
        Section("Curves", [*plots(rows, data["titles"], KINDS), exponents(rows, KINDS)]),
        Section("Gain of the chosen form", [Text(_payoff(rows, name)) for name in names]),
        Section("Numbers", [_table(rows)]),
        Section("Settings", [_settings(data)]),
        Section("Limits of these curves", [Text(sentence) for sentence in _limits(data)]),
    ]
    return Report("Time of a tick against size", _summary(rows, names), None, sections)


def curve(rows: Sequence[Row], name: str, kind: str) -> tuple[Vec, Vec]:
    """Sizes and median times [µs] along an axis, NaN where a tick was not solved."""
    own = [row for row in rows if (row["axis"], row["kind"]) == (name, kind)]
    times = [row["tick_us"] if row["solved"] and row["tick_us"] is not None else np.nan for row in own]
    return np.array([row["size"] for row in own], dtype=np.float64), np.array(times, dtype=np.float64)


def exponent(x: Vec, y: Vec) -> Slope | None:
    """Slope on logarithms over the larger half of the sizes, where fixed costs weigh least; at least three points.

    Example:
        >>> import numpy as np
        >>> from wbc.report.scaling.page import exponent
        >>> print(exponent(np.array([1.0, 2.0, 4.0, 8.0, 16.0]), np.array([9.0, 9.0, 16.0, 64.0, 256.0])))
        2.00 ± 0.01
    """
    last = max(3, (len(x) + 1) // 2)
    return slope(x[-last:], y[-last:])


def _summary(rows: Sequence[Row], names: Sequence[str]) -> str:
    parts = []
    for name in names:
        x, y = curve(rows, name, "chosen")
        good = np.isfinite(y)
        if good.sum() > 1:
            first, last = np.flatnonzero(good)[[0, -1]]
            parts.append(f"{x[first]:.0f} to {x[last]:.0f} {name}: {number(y[first])} to {number(y[last])} µs")
    return f"Median tick of a controller. {'; '.join(parts) or 'Fewer than two sizes were solved'}."


def plots(
    rows: Sequence[Row], titles: Mapping[str, str], kinds: Mapping[str, str], title: str = "median time of a tick"
) -> Iterator[Plot]:
    """The times of every kind, by its label, along each axis in ``titles``; sizes are logarithmic if none is zero."""
    for name, over in titles.items():
        found = {label: curve(rows, name, kind) for kind, label in kinds.items()}
        x = max((sizes for sizes, _ in found.values()), key=len)
        curves = [Curve(label, times) for label, (_, times) in found.items()]
        yield Plot(f"scaling-{name}", title, "µs", x, curves, over=over, log="xy" if x.min() > 0 else "y",
                   dots=True)  # fmt: skip


def exponents(rows: Sequence[Row], kinds: Mapping[str, str]) -> Table:
    """How the times of every kind grow along each axis."""
    found: list[list[Cell]] = []
    for name, (kind, label) in product(dict.fromkeys(row["axis"] for row in rows), kinds.items()):
        x, y = curve(rows, name, kind)
        finite = y[np.isfinite(y)]
        ends = [float(finite[0]), float(finite[-1])] if finite.size else [None, None]
        fitted = [None if fit is None else str(fit) for fit in (exponent(x, y), slope(x, y))]
        found.append([name, label, *fitted, *ends])
    columns = ("axis", "", "exponent, larger half", "exponent, all", "at the smallest [µs]",
               "at the largest [µs]")  # fmt: skip
    note = "Exponent p of time ∝ sizeᵖ by least squares on logarithms, with Student's 95 % interval; without size zero."
    return Table(columns, found, note)


def _payoff(rows: Sequence[Row], name: str) -> str:
    """How much faster the chosen form is, and where it is slower."""
    x, chosen = curve(rows, name, "chosen")
    _, standard = curve(rows, name, "standard")
    forms = ", ".join(dict.fromkeys(row["form"] for row in rows if row["axis"] == name and row["kind"] == "chosen"))
    gain = standard / chosen
    both = np.isfinite(gain)
    if not both.any():
        return f"{name}: no size was solved in both forms."
    if forms == "standard":
        return f"{name}: the standard form is the one that is chosen."
    slower = np.flatnonzero(both & (gain < 1.0 - _EQUAL))
    at = f"; it is slower at {', '.join(f'{x[i]:.0f}' for i in slower)}" if slower.size else ""
    span = f"{np.nanmin(gain):.2f} to {np.nanmax(gain):.2f}"
    return f"{name}: the chosen form ({forms}) is {span} times as fast as the standard form{at}."


def _form(row: Row) -> str:
    return f"{KINDS[row['kind']]}: {row['form']}" if row["kind"] == "chosen" else KINDS[row["kind"]]


def _table(rows: Sequence[Row]) -> Table:
    columns = ("axis", "size", "form", "tick, median [µs]", "p99 [µs]", "variables", "equalities", "rows", "active",
               "active set kept", "solved")  # fmt: skip
    cells = [
        (row["axis"], row["size"], _form(row), row["tick_us"], row["p99_us"], row["variables"], row["equalities"],
         row["rows"], row["active"], percent(row["guessed"]), row["solved"])
        for row in rows
    ]  # fmt: skip
    note = (
        "Every size in both forms. Variables, equalities and rows: of the QP in standard form. Active: rows of the "
        "last tick. Active set kept: share of the ticks at which the active set of the tick before was right."
    )
    return Table(columns, cells, note)


def _settings(data: dict[str, Any]) -> Table:
    where = data["surroundings"]
    measuring = {"date": where["date"], "load": where["load"], "clock governor": where["governor"]}
    settings = (data["settings"], measuring, where["machine"], where["versions"])
    return measured(*settings, caption="Where and how it was measured")


def _limits(data: dict[str, Any]) -> list[str]:
    settings = data["settings"]
    return [
        f"The smallest of {settings['repeats']} times of each of {settings['ticks']} ticks, warm, one thread, one "
        "machine. Ratios and exponents differ less between machines than times do.",
        "Robots, states and stacks are generated, with links of random mass. A tick includes the model update and the "
        "certificate. The time in Python does not grow with size and flattens the curves at small sizes.",
    ]
