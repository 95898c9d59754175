"""What a page's script reads: plots, maps and scenes as JSON, their numbers packed so that a page stays small."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from wbc.packing import differenced
from wbc.report.document import TIME, Curve, Map, Plot, Report, Scene
from wbc.report.why import Why
from wbc.types import Mat, Vec

#: A plot has at most about so many moments; a longer run keeps the extremes of every stretch.
MOMENTS = 12_000
#: Steps between the least and the largest value of a curve; the one above them is a gap.
STEPS = 65_534
#: Differences of steps are taken at most so often.
MOST = 3


def data(report: Report) -> dict[str, Any] | None:
    """Everything that the page's script draws; None where there is nothing."""
    plots = [item for item in report.items if isinstance(item, Plot)]
    maps = [item for item in report.items if isinstance(item, Map)]
    found = scenes(report)
    if not (plots or maps or found):
        return None
    arrays, clock, reaches = Arrays(), report.clock, _reaches(plots)
    return {
        "seconds": clock.seconds if clock else 0.0,
        "dt": clock.dt if clock else 1.0,
        "events": [event._asdict() for event in clock.events] if clock else [],
        "plots": [_plot(plot, arrays, report.names) | {"reach": reaches.get(plot.scale)} for plot in plots],
        "maps": [{key: arrays.exact(getattr(item, key)) for key in "txy"} for item in maps],
        "whys": [{"name": name, **_why(why, arrays)} for name, why in report.whys.items()],
        "scenes": [{**scene.content, "ghosts": scene.ghosts} for scene in found],
        "arrays": arrays.packed,
    }


def scenes(report: Report) -> list[Scene]:
    """The scenes of a report, the one beside the plots first."""
    return [*([report.scene] if report.scene else []), *(item for item in report.items if isinstance(item, Scene))]


def text(values: NDArray[Any]) -> str:
    """The bytes of an array, as a page can hold them."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


@final
class Arrays:
    """Packed arrays, each once; what is put in gives the number to find it by."""

    def __init__(self) -> None:
        self.packed: list[dict[str, Any]] = []
        self._known: dict[tuple[str, bytes], int] = {}

    def exact(self, values: Vec) -> int:
        """Values without gaps, to the bit."""
        values = np.asarray(values, dtype="<f8")
        return self._put("f64", values.tobytes(), lambda: {"f64": text(values)})

    def single(self, values: Vec) -> int:
        """Values with gaps to seven digits."""
        values = np.asarray(values, dtype="<f4")
        return self._put("f32", values.tobytes(), lambda: {"f32": text(values)})

    def stepped(self, values: Vec) -> int:
        """Values (N,) to a 65 534th of their range; what is not finite is a gap."""
        values = np.asarray(values, dtype="<f8")
        return self._put("u16", values.tobytes(), lambda: _stepped(values))

    def _put(self, kind: str, content: bytes, pack: Any) -> int:
        key = kind, content
        if key not in self._known:
            self._known[key] = len(self.packed)
            self.packed.append(pack())
        return self._known[key]


def kept(values: Mat, most: int = MOMENTS) -> NDArray[np.intp]:
    """Rows of values (N, k) to draw: all, or in every stretch those with the smallest and largest of each column."""
    n, k = values.shape
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, max(most // (2 * max(k, 1)), 2) + 1).astype(int)
    rows = {0, n - 1}
    for column in values.T:
        low, high = np.where(np.isnan(column), np.inf, column), np.where(np.isnan(column), -np.inf, column)
        for start, end in pairwise(edges):
            rows |= {start + int(low[start:end].argmin()), start + int(high[start:end].argmax())}
    return np.array(sorted(rows))


def _stepped(values: Vec) -> dict[str, Any]:
    finite = np.isfinite(values)
    low, high = (float(edge(values[finite])) for edge in (np.min, np.max)) if finite.any() else (0.0, 0.0)
    size = high - low if high > low else 1.0
    steps = np.where(finite, np.rint((np.where(finite, values, low) - low) / size * STEPS), STEPS + 1)
    stored, times = differenced(steps.astype("<u2").view("<i2"), most=MOST, sample=len(steps))
    return {"u16": text(stored), "times": times, "low": low, "high": high}


def _why(why: Why, arrays: Arrays) -> dict[str, Any]:
    """Every moment that a page holds, one in so many of a long run."""
    rows = slice(None, None, -(-len(why.t) // MOMENTS))

    def columns(values: Mat) -> list[int]:
        return [arrays.single(column[rows]) for column in values.T]

    codes = [arrays.stepped(column[rows]) for column in why.codes.T]  # whole numbers: a step is finer than they are

    return {
        "t": arrays.exact(why.t[rows]), "status": arrays.stepped(why.status[rows]), "statuses": why.statuses,
        "rows": why.rows, "codes": codes, "bounds": columns(why.bounds),
        "multipliers": columns(why.multipliers),
        "tasks": [
            {"task": part.task, "share": arrays.single(part.share[rows]),
             "error": [[arrays.single(values[rows]), unit] for unit, values in part.error.items()],
             "residual": [[arrays.single(values[rows]), unit] for unit, values in part.residual.items()]}
            for part in why.parts
        ],
    }  # fmt: skip


def _reaches(plots: Sequence[Plot]) -> dict[str, list[float]]:
    """The least and the largest value of what is shown at first, of all plots of one scale."""
    found: dict[str, list[float]] = {}
    for plot in plots:
        values = np.concatenate([np.zeros(0), *(curve.values for curve in plot.curves if curve.shown)])
        values = values[np.isfinite(values)]
        if plot.scale and values.size:
            low, high = found.get(plot.scale, [np.inf, -np.inf])
            found[plot.scale] = [min(low, float(values.min())), max(high, float(values.max()))]
    return found


def _plot(plot: Plot, arrays: Arrays, names: Sequence[str]) -> dict[str, Any]:
    """The curves over each x that they have, those of the plot's own x first."""
    over: dict[bytes, tuple[Vec, list[tuple[int, Curve]]]] = {plot.x.tobytes(): (plot.x, [])}
    for k, curve in enumerate(plot.curves):
        x = plot.x if curve.x is None else curve.x
        place = names.index(curve.label) if curve.label in names else k
        over.setdefault(x.tobytes(), (x, []))[1].append((place if curve.run is None else curve.run, curve))
    pack = arrays.single if "y" in plot.log else arrays.stepped  # steps of equal size are coarse near zero
    tables = []
    for x, mine in over.values():
        values = np.column_stack([curve.values for _, curve in mine]) if mine else np.zeros((len(x), 0))
        rows = kept(values)
        tables.append({
            "x": arrays.exact(x[rows]),
            "curves": [
                {"label": curve.label, "values": pack(curve.values[rows]), "shown": curve.shown,
                 "faint": curve.faint, "colour": colour, "dash": curve.dash}
                for colour, curve in mine
            ],
        })  # fmt: skip
    strips = [
        {"label": strip.label, "intervals": strip.intervals, "colour": k if strip.run is None else strip.run}
        for k, strip in enumerate(plot.strips)
    ]
    return {
        "name": plot.name, "tables": tables, "strips": strips, "over": plot.over,
        "bounds": [bound._asdict() for bound in plot.bounds if np.isfinite(bound.value)],
        "time": plot.over == TIME, "log": plot.log, "zero": plot.zero, "bars": plot.bars,
        "steps": plot.steps, "dots": plot.dots, "lines": plot.lines,
    }  # fmt: skip
