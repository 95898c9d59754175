"""Torques, velocities and positions of joints against their limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wbc.report import measure
from wbc.report.document import Bar, Bound, Cell, Curve, Item, Plot, Section, Table, percent
from wbc.sim.scenario import ScenarioResult
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run

WORST = 4
#: A table of more joints is folded.
LONG = 14
#: Where the limit stands in the bar of a joint.
LIMIT = 0.8


def torques(result: ScenarioResult) -> Section | None:
    """Share of the torque limit over time and per joint."""
    run = result.run
    share, tau = measure.use(run).get("torque"), measure.torques(run)
    if share is None or tau is None or not share.size:
        return None
    units = ["N m" if unit == "rad" else "N" for unit in run.meta.get("joint_units", [])]
    plot = _use_plot(run, share, "torques", "Torque in use, |τ| / τ_max")
    return Section("Torques against limits", [plot, _use_table(run, "torque", tau, share, units)])


def section(result: ScenarioResult) -> Section | None:
    """Share of the velocity limit, and the range of positions each joint went through."""
    run = result.run
    if not run.meta["joint_names"] or not run.rows:
        return None
    low, high = (measure.limits(run)[name] for name in ("q_min", "q_max"))
    share, units = measure.use(run)["velocity"], [f"{unit}/s" for unit in run.meta.get("joint_units", [])]
    items: list[Item] = [_use_plot(run, share, "velocities", "Speed in use, |v| / v_max")]
    items += [_positions(result)] if np.any(np.isfinite(low) & np.isfinite(high)) else []
    items += [_use_table(run, "velocity", measure.joint_state(run)[1], share, units), _table(result)]
    return Section("Joint velocities and positions", items)


def short_names(names: Sequence[str]) -> list[str]:
    """Joint names without the word that all of them end with."""
    return [name.removesuffix("_joint") for name in names] if all(n.endswith("_joint") for n in names) else list(names)


def _use_plot(run: Run, share: Vec, name: str, title: str) -> Plot:
    """``share`` (N, nj) of a limit over time: the worst joints, the largest of the others, and each of them."""
    names = short_names(run.meta["joint_names"])
    worst = list(np.argsort(-share.max(axis=0), kind="stable"))
    shown, others = worst[:WORST], worst[WORST:]
    curves = [Curve(names[i], 100.0 * share[:, i]) for i in shown]
    if others:
        curves.append(Curve("largest other", 100.0 * share[:, others].max(axis=1), faint=True))
        curves += [Curve(names[i], 100.0 * share[:, i], shown=False) for i in others]
    return Plot(name, title, "%", measure.times(run), curves, [Bound(100.0, "limit")], zero=True, wide=True)


def _use_table(run: Run, kind: str, values: Vec, share: Vec, units: Sequence[str]) -> Table:
    """Every joint's largest absolute value, limit and share, the most used first."""
    names, bound = run.meta["joint_names"], measure.limits(run)["tau_max" if kind == "torque" else "v_max"]
    largest = np.nanmax(np.abs(values), axis=0, initial=0.0)
    rows = [
        (names[i], units[i] if units else "", float(largest[i]), float(bound[i]), _bar(share[:, i], float(bound[i])))
        for i in np.argsort(-share.max(axis=0), kind="stable")
    ]
    columns = ("joint", "unit", "largest", "limit", "largest share")
    return Table(columns, rows, f"Largest |{kind}| of every joint. The line in a bar is the limit.", len(rows) > LONG)


def _bar(share: Vec, bound: float) -> Bar | str:
    if not np.isfinite(bound) or bound <= 0:
        return "–"
    most = float(share.max())
    return Bar(0.0, min(LIMIT * most, 1.0), percent(most), LIMIT, most <= 1 + 1e-9)


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
