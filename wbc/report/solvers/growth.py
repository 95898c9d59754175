"""How the time of each solver grows with the problem: curves with their exponents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.report import style
from wbc.report.document import Cell, Figure, Item, Section, Table, Text
from wbc.report.solvers.data import Data
from wbc.report.solvers.drawing import look, side_legend
from wbc.report.solvers.problems import GROWTH
from wbc.report.solvers.statistics import TARGET, slope
from wbc.report.style import logarithmic
from wbc.types import Vec

#: What grows along an axis, in the table's letters.
_GROWS = {"variables": "n", "rows": "n_in", "active rows": "active"}


def section(data: Data) -> Section:
    """One plot an axis and the table of exponents."""
    axes = [about for about in data["sets"] if about["kind"] == "growth"]
    if not axes:
        return Section("Growth", [])
    text = (
        "Made problems with a known number of active rows, warm, each solver asked for 1e-6; a point is the median "
        "of the solves that reached it. Exponents p of time ∝ sizeᵖ are fitted to all points; below a few tens of "
        "microseconds they show fixed costs more than algorithms."
    )
    items: list[Item] = [Text(text), _figure(data, axes), _table(data, axes)]
    return Section("Growth", items)


def curve(data: Data, about: Data, solver: str) -> tuple[Vec, Vec]:
    """Sizes (k,) along the axis and the median warm time at each [µs], NaN where nothing was solved to 1e-6."""
    axis = about["name"].partition("/")[2]
    (entry,) = (
        m for m in data["measures"] if (m["set"], m["solver"], m["mode"]) == (about["name"], solver, "warm")
    )  # fmt: skip
    sizes = np.array([size[_GROWS[axis]] for size in GROWTH[axis]], dtype=np.float64)
    times = []
    for start, end in about["stretches"]:
        good = [
            entry["total_us"][i] for i in range(start + 1, end)
            if entry["total_us"][i] is not None and _within(entry, i)
        ]  # fmt: skip
        times.append(float(np.median(good)) if good else np.nan)
    return sizes, np.array(times)


def _within(entry: Data, i: int) -> bool:
    parts = (entry["primal"][i], entry["dual"][i], entry["gap"][i])
    return all(part is not None and part <= TARGET for part in parts)


def _figure(data: Data, axes: Sequence[Data]) -> Figure:
    with style.Canvas(1, len(axes), height=3.2) as canvas:
        for place, about in zip(canvas.axes, axes, strict=True):
            axis = about["name"].partition("/")[2]
            for k, solver in enumerate(data["solvers"]):
                sizes, times = curve(data, about, solver["name"])
                place.plot(sizes, times, marker="o", markersize=2.5, label=solver["name"], **look(k))
            if axis != "active rows":  # one of its points is zero
                logarithmic(place, "x")
                place.set_xticks(np.unique([size[_GROWS[axis]] for size in GROWTH[axis]]), minor=False)
                place.minorticks_off()
            if any(np.isfinite(curve(data, about, solver["name"])[1]).any() for solver in data["solvers"]):
                logarithmic(place, "y")
            place.set_xlabel(axis)
        canvas.axes[0].set_ylabel("time of a solve [µs]")
        side_legend(canvas.axes[-1])
        caption = (
            "Time of a warm solve over the number of variables (as many rows), of rows (40 variables), of active rows."
        )
        return canvas.figure("growth", caption)


def _table(data: Data, axes: Sequence[Data]) -> Table:
    rows: list[list[Cell]] = []
    for solver in data["solvers"]:
        row: list[Cell] = [solver["name"]]
        for about in axes:
            sizes, times = curve(data, about, solver["name"])
            finite = times[np.isfinite(times)]
            row += [slope(sizes, times), float(finite[-1]) if finite.size else None]
        rows.append(row)
    columns = ["solver"]
    for about in axes:
        axis = about["name"].partition("/")[2]
        columns += [f"exponent, {axis}", "at the largest [µs]"]
    return Table(columns, rows, "Exponents, and the time at the largest size that was solved.")
