"""Joint velocities and positions against their limits."""

from __future__ import annotations

import numpy as np

from wbc.report import measure
from wbc.report.document import Bar, Bound, Cell, Curve, Plot, Section, Table
from wbc.report.sections.use import LONG, WORST, short_names, use_plot, use_table
from wbc.sim.scenario import ScenarioResult


def section(result: ScenarioResult) -> Section | None:
    """Share of the velocity limit, and the range of positions each joint went through."""
    run = result.run
    if not run.meta["joint_names"] or not run.rows:
        return None
    _, velocity = measure.joint_state(run)
    low, high = (measure.limits(run)[name] for name in ("q_min", "q_max"))
    between = [_positions(result)] if np.any(np.isfinite(low) & np.isfinite(high)) else []
    share = measure.use(run)["velocity"]
    units = [f"{unit}/s" for unit in run.meta.get("joint_units", [])]
    return Section(
        "Joint velocities and positions",
        [
            use_plot(run, share, "velocities", "Speed in use, |v| / v_max"),
            *between,
            use_table(run, velocity, share, measure.limits(run)["v_max"], units, kind="velocity"),
            _table(result),
        ],
    )


def _positions(result: ScenarioResult) -> Plot:
    """Where each joint is between its limits, those nearest to one first."""
    run = result.run
    q, _ = measure.joint_state(run)
    low, high = (measure.limits(run)[name] for name in ("q_min", "q_max"))
    bounded = np.isfinite(low) & np.isfinite(high) & (high > low)
    share = 100.0 * (q - np.where(bounded, low, 0.0)) / np.where(bounded, high - low, np.nan)
    names = short_names(run.meta["joint_names"])
    nearest = np.argsort(np.nan_to_num(-np.abs(share - 50.0).max(axis=0), nan=0.0), kind="stable")
    curves = [Curve(names[i], share[:, i], shown=k < WORST) for k, i in enumerate(nearest) if bounded[i]]
    bounds = [Bound(0.0, "lower limit"), Bound(100.0, "upper limit")]
    return Plot("positions", "Positions between the limits", "%", measure.times(run), curves, bounds, wide=True)


def _table(result: ScenarioResult) -> Table:
    run = result.run
    q, _ = measure.joint_state(run)
    bound = measure.limits(run)
    units = run.meta.get("joint_units") or [""] * q.shape[1]
    columns = ("joint", "unit", "lowest", "highest", "lower limit", "upper limit", "smallest margin", "range")
    rows: list[tuple[Cell, ...]] = []
    for i, name in enumerate(run.meta["joint_names"]):
        lo, hi, low, high = (float(x) for x in (q[:, i].min(), q[:, i].max(), bound["q_min"][i], bound["q_max"][i]))
        shown: Cell = "no limit"
        if np.isfinite(low) and np.isfinite(high) and high > low:
            a, b, start = ((x - low) / (high - low) for x in (lo, hi, float(q[0, i])))
            within = np.clip([a, max(b, a + 0.01), start], 0.0, 1.0)
            shown = Bar(float(within[0]), float(within[1]), "", float(within[2]), a >= -1e-9 and b <= 1 + 1e-9)
        rows.append((name, units[i], lo, hi, low, high, min(lo - low, high - hi), shown))
    caption = "Positions of every joint. Bar: its range between its limits; the line is its first position."
    return Table(columns, rows, caption, len(rows) > LONG)
