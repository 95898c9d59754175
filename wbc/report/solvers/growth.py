"""How the time of each solver grows with the problem: curves, and their exponents with an interval."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from wbc.report.document import Cell, Curve, Item, Plot, Section, Table, Text
from wbc.report.solvers.data import Data
from wbc.report.solvers.problems import slug
from wbc.report.solvers.statistics import TARGET, slope
from wbc.types import Vec


def section(data: Data) -> Section:
    """One plot an axis and the table of exponents."""
    axes = {about["name"].partition("/")[2]: about for about in data["sets"] if about["kind"] == "growth"}
    if not axes:
        return Section("Growth", [])
    text = (
        "QPs of a controller whose problem grows, warm, at 1e-6. A point is the median of the solves "
        "that reached it. The exponent p of time ∝ sizeᵖ is fitted to all points, with Student's 95 % interval. "
        "Below some tens of microseconds fixed costs dominate."
    )
    items: list[Item] = [Text(text), *_plots(data, axes), _table(data, axes)]
    return Section("Growth", items)


def curve(data: Data, about: Data, solver: str) -> tuple[Vec, Vec]:
    """Sizes (k,) along the axis and the median warm time at each [µs], NaN where nothing was solved to 1e-6."""
    (entry,) = (
        m for m in data["measures"] if (m["set"], m["solver"], m["mode"]) == (about["name"], solver, "warm")
    )  # fmt: skip
    times = []
    for start, end in about["stretches"]:
        good = [
            entry["total_us"][i] for i in range(start + 1, end)
            if entry["total_us"][i] is not None and _within(entry, i)
        ]  # fmt: skip
        times.append(float(np.median(good)) if good else np.nan)
    return np.array(about["sizes"], dtype=np.float64), np.array(times)


def _within(entry: Data, i: int) -> bool:
    parts = (entry["primal"][i], entry["dual"][i], entry["gap"][i])
    return all(part is not None and part <= TARGET for part in parts)


def _plots(data: Data, axes: dict[str, Data]) -> Iterator[Plot]:
    for axis, about in axes.items():
        found = {solver["name"]: curve(data, about, solver["name"]) for solver in data["solvers"]}
        x = next(iter(found.values()))[0]
        curves = [Curve(name, times) for name, (_, times) in found.items()]
        log = "y" if x.min() <= 0.0 else "xy"
        yield Plot(
            f"growth-{slug(axis)}", "time of a warm solve", "µs", x, curves, over=about["source"], log=log, dots=True
        )


def _table(data: Data, axes: dict[str, Data]) -> Table:
    rows: list[list[Cell]] = []
    for solver in data["solvers"]:
        row: list[Cell] = [solver["name"]]
        for about in axes.values():
            sizes, times = curve(data, about, solver["name"])
            finite, found = times[np.isfinite(times)], slope(sizes, times)
            row += [None if found is None else str(found), float(finite[-1]) if finite.size else None]
        rows.append(row)
    columns = ["solver", *_columns(list(axes))]
    return Table(columns, rows, "Exponents, and the time at the largest size that was solved.")


def _columns(axes: Sequence[str]) -> Iterator[str]:
    for axis in axes:
        yield from (f"exponent, {axis}", "largest [µs]")
