"""Joint velocities and positions against their limits."""

from __future__ import annotations

import numpy as np

from wbc.report import measure, style
from wbc.report.document import Figure, Item, Section, Table
from wbc.report.sections.use import name_joints, short_names, use_figure, use_table
from wbc.sim.scenario import ScenarioResult


def section(result: ScenarioResult) -> Section | None:
    """Share of the velocity limit, and the range of positions each joint went through."""
    run = result.run
    if not run.meta["joint_names"] or not run.rows:
        return None
    _, velocity = measure.joint_state(run)
    share = measure.use(run)["velocity"]
    caption = "Share of the velocity limit: the fastest joints over time, and largest and rms of every joint."
    units = [f"{unit}/s" for unit in run.meta.get("joint_units", [])]
    items: list[Item] = [
        use_figure(run, share, "velocities", "|v| / v_max", caption),
        use_table(run, velocity, share, measure.limits(run)["v_max"], units, kind="velocity"),
        _ranges(result),
        _position_table(result),
    ]
    return Section("Joint velocities and positions", items)


def _ranges(result: ScenarioResult) -> Figure:
    """A bar from the lowest to the highest position of every joint inside its own limits."""
    run = result.run
    q, _ = measure.joint_state(run)
    low, high = (measure.limits(run)[name] for name in ("q_min", "q_max"))
    bounded = np.isfinite(low) & np.isfinite(high) & (high > low)
    span = np.where(bounded, high - low, 1.0)
    reached = [(edge(q, axis=0) - np.where(bounded, low, 0.0)) / span for edge in (np.nanmin, np.nanmax)]
    start = (q[0] - np.where(bounded, low, 0.0)) / span
    names = short_names(run.meta["joint_names"])
    with style.Canvas(height=3.0) as canvas:
        axes = canvas.axes[0]
        for x, (lo, hi, at, ok) in enumerate(zip(*reached, start, bounded, strict=True)):
            axes.bar(x, 1.0, width=0.62, color=style.PAPER, linewidth=0)
            if not ok:
                axes.text(x, 0.5, "no limit", ha="center", va="center", fontsize=7, color=style.FAINT, rotation=90)
                continue
            colour = style.RED if lo < -1e-9 or hi > 1 + 1e-9 else style.BLUE
            axes.bar(x, max(hi - lo, 0.006), bottom=lo, width=0.62, color=colour, linewidth=0)
            axes.plot([x], [at], marker="_", color=style.ORANGE, markersize=7, markeredgewidth=1.6)
        name_joints(axes, names)
        axes.set_ylim(-0.03, 1.03)
        axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["lower limit", "25 %", "50 %", "75 %", "upper limit"])
        axes.set_title("Positions reached between the limits")
        caption = (
            "Blue: the range each joint went through, relative to its limits; red: beyond them. Orange: where it began."
        )
        return canvas.figure("positions", caption)


def _position_table(result: ScenarioResult) -> Table:
    run = result.run
    q, _ = measure.joint_state(run)
    bound = measure.limits(run)
    units = run.meta.get("joint_units") or [""] * q.shape[1]
    columns = ("joint", "unit", "lowest", "highest", "lower limit", "upper limit", "smallest margin")
    rows = []
    for i, name in enumerate(run.meta["joint_names"]):
        lo, hi, low, high = q[:, i].min(), q[:, i].max(), bound["q_min"][i], bound["q_max"][i]
        rows.append((name, units[i], float(lo), float(hi), float(low), float(high), float(min(lo - low, high - hi))))
    return Table(columns, rows, "Positions of every joint.", folded=True)
