"""How long a tick took."""

from __future__ import annotations

import numpy as np

from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, percent
from wbc.sim.scenario import ScenarioResult

BINS = 70


def section(result: ScenarioResult) -> Section | None:
    """Tick times over the run and as a histogram, and the share of the period they are."""
    run = result.run
    if "tick_us" not in run or not run.rows:
        return None
    tick = np.asarray(run["tick_us"], dtype=float)
    period = 1e6 * float(run.meta["dt"])
    figures = {
        "median": float(np.median(tick)), "mean": float(tick.mean()), "99th percentile": float(np.percentile(tick, 99)),
        "99.9th percentile": float(np.percentile(tick, 99.9)), "largest": float(tick.max()),
    }  # fmt: skip
    rows = [(name, value, percent(value / period)) for name, value in figures.items()]
    note = f"Wall-clock time of one tick. {measure.late(run)} of {len(tick)} ticks exceed the period of {period:g} µs."
    shown = np.maximum(tick, 1e-3)
    edges = np.geomspace(float(shown.min()) / 1.15, float(shown.max()) * 1.15, BINS + 1)
    counts = np.histogram(shown, bins=edges)[0].astype(float)
    marks = [
        Bound(figures["median"], "median", "x"), Bound(figures["99th percentile"], "p99", "x"),
        Bound(period, "period", "x"),
    ]  # fmt: skip
    found = Curve("ticks", np.where(counts > 0, counts, np.nan))
    t, late = measure.times(run), [Bound(period, "period")]
    plots = [
        Plot("ticks", "Time of every tick", "µs", t, [Curve("tick", shown)], late, log="y"),
        Plot("tick-histogram", "Number of ticks", "", edges[:-1], [found], marks, log="xy", bars=True,
             over="time of one tick [µs]"),
    ]  # fmt: skip
    return Section("Tick time", [*plots, Table(("", "time [µs]", "share of the period"), rows, note)])
