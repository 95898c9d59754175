"""How the time of each solver grows with the problem: curves, and their exponents with an interval."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wbc.report.document import Section, Text
from wbc.report.scaling.page import exponents, plots
from wbc.report.solvers.data import Data
from wbc.report.solvers.statistics import TARGET


def section(data: Data) -> Section:
    """One plot an axis and the table of exponents."""
    axes = {about["name"].partition("/")[2]: about for about in data["sets"] if about["kind"] == "growth"}
    if not axes:
        return Section("Growth", [])
    rows = [row for axis, about in axes.items() for row in _rows(data, axis, about)]
    kinds = {solver["name"]: solver["name"] for solver in data["solvers"]}
    titles = {axis: about["source"] for axis, about in axes.items()}
    text = (
        "QPs of a controller whose problem grows, warm, at 1e-6. A point is the median of the solves that reached it. "
        "Below some tens of microseconds fixed costs dominate."
    )
    return Section("Growth", [Text(text), *plots(rows, titles, kinds, "time of a warm solve"), exponents(rows, kinds)])


def _rows(data: Data, axis: str, about: Data) -> Iterator[dict[str, Any]]:
    """The median warm time of each solver at each size along the axis [µs], not solved where none reached 1e-6."""
    for entry in data["measures"]:
        if (entry["set"], entry["mode"]) == (about["name"], "warm"):
            for size, (start, end) in zip(about["sizes"], about["stretches"], strict=True):
                good = [entry["total_us"][i] for i in range(start + 1, end) if _within(entry, i)]
                time = float(np.median(good)) if good else None
                yield {"axis": axis, "size": size, "kind": entry["solver"], "tick_us": time, "solved": bool(good)}


def _within(entry: Data, i: int) -> bool:
    parts = (entry["primal"][i], entry["dual"][i], entry["gap"][i])
    return entry["total_us"][i] is not None and all(part is not None and part <= TARGET for part in parts)
