"""How long a tick took."""

from __future__ import annotations

import numpy as np

from wbc.report import measure, style
from wbc.report.document import Figure, Section, Table, percent
from wbc.sim.scenario import ScenarioResult


def section(result: ScenarioResult) -> Section | None:
    """Histogram of the tick times with median, 99th percentile and maximum, and the share of the period they are."""
    run = result.run
    if "tick_us" not in run or not run.rows:
        return None
    tick = np.asarray(run["tick_us"], dtype=float)
    period = 1e6 * float(run.meta["dt"])
    rows = [
        (name, value, percent(value / period))
        for name, value in (
            ("median", float(np.median(tick))),
            ("mean", float(tick.mean())),
            ("99th percentile", float(np.percentile(tick, 99))),
            ("99.9th percentile", float(np.percentile(tick, 99.9))),
            ("largest", float(tick.max())),
        )
    ]
    late = int((tick > period).sum())
    note = (
        f"One tick of the controller, wall clock. {late} of {len(tick)} took longer than the period of {period:g} µs."
    )
    return Section("Tick time", [_figure(result), Table(("", "time [µs]", "of the period"), rows, note)])


def _figure(result: ScenarioResult) -> Figure:
    run = result.run
    tick = np.maximum(np.asarray(run["tick_us"], dtype=float), 1e-3)
    t = measure.times(run)
    times = measure.tick_times(run)
    low, high = float(tick.min()) / 1.15, float(tick.max()) * 1.15
    with style.Canvas(1, 2, height=2.7, widths=(1.15, 1)) as canvas:
        histogram, over_time = canvas.axes
        histogram.hist(tick, bins=list(np.geomspace(low, high, 70)), color=style.BLUE, linewidth=0)
        histogram.set_xscale("log")
        histogram.set_yscale("log")
        _plain_numbers(histogram.xaxis, low, high)
        histogram.set_xlabel("time of one tick [µs]")
        histogram.set_ylabel("ticks")
        histogram.set_ylim(bottom=0.7)
        _plain_numbers(histogram.yaxis, 1.0, float(run.rows))
        lines = (("median", times.median, style.INK), ("p99", times.p99, style.ORANGE), ("max", times.max, style.RED))
        for name, value, colour in lines:
            histogram.axvline(value, color=colour, linewidth=1.0, label=f"{name} {value:.0f} µs")
        histogram.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.985), ncols=3, columnspacing=1.0, handletextpad=0.5)
        style.curve(over_time, t, tick, color=style.BLUE, linewidth=0.7)
        over_time.set_yscale("log")
        _plain_numbers(over_time.yaxis, low, high)
        style.over_time(over_time, run, "Over the run", "time of one tick [µs]")
        return canvas.figure("tick_time", "Wall-clock time of every tick, on logarithmic axes.")


def _plain_numbers(axis: object, low: float, high: float) -> None:
    """Marks at powers of ten, and at 2 and 5 times those where there is room, written as plain numbers."""
    from matplotlib.axis import Axis
    from matplotlib.ticker import FixedLocator, NullLocator

    assert isinstance(axis, Axis), "an axis of a figure"
    steps = (1, 2, 5) if high < 200 * low else (1,)
    places = [m * 10.0**k for k in range(-3, 8) for m in steps if low <= m * 10.0**k <= high]
    axis.set_major_locator(FixedLocator(places))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(lambda x, _: f"{x:g}")
