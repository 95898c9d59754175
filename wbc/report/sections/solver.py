"""What the solver did: statuses, iterations, active rows, certificates."""

from __future__ import annotations

import numpy as np

from wbc.report import measure, style
from wbc.report.document import Cell, Item, Section, Table, percent
from wbc.sim.scenario import ScenarioResult
from wbc.types import Status


def section(result: ScenarioResult) -> Section | None:
    """Tables of statuses and of solver statistics, and active rows and iterations over time."""
    run = result.run
    if "status" not in run or not run.rows:
        return None
    counts = measure.statuses(run)
    rows = [(name, n, percent(n / run.rows), _advice(name)) for name, n in counts.items()]
    items: list[Item] = [Table(("status", "ticks", "share", "meaning"), rows)]
    statistics = _statistics(result)
    if statistics:
        items.append(Table(("statistic", "value"), statistics, f"Solver {run.meta.get('solver')}, over all ticks."))
    distances = _distances(result)
    if distances:
        items.append(
            Table(
                ("task", "unit", "median", "largest", "ticks with proof"), distances,
                "How far each task can be from its optimum: at most this, as the certificate proves it in each tick.",
            )
        )  # fmt: skip
    drawn = [(name, label) for name, label in (("active", "active rows"), ("iterations", "iterations")) if name in run]
    if drawn:
        with style.Canvas(1, len(drawn), height=2.2) as canvas:
            for axes, (name, label) in zip(canvas.axes, drawn, strict=True):
                style.curve(
                    axes, measure.times(run), np.asarray(run[name], dtype=float), color=style.BLUE, linewidth=0.8
                )
                style.over_time(axes, run, label.capitalize(), label)
                axes.set_ylim(bottom=0)
            items.append(canvas.figure("solver", "Rows at a limit, and iterations of the solver, on every tick."))
    return Section("Solver", items)


def _statistics(result: ScenarioResult) -> list[tuple[str, Cell]]:
    run = result.run
    rows: list[tuple[str, Cell]] = []
    if "iterations" in run:
        n = np.asarray(run["iterations"], dtype=float)
        rows += [
            ("first guess right (at most one iteration)", percent(float(np.mean(n <= 1)))),
            ("iterations, mean", float(n.mean())),
            ("iterations, largest", int(n.max())),
        ]
    if "active" in run:
        active = np.asarray(run["active"], dtype=float)
        changes = int(np.count_nonzero(np.diff(active)))
        rows += [
            ("active rows, mean", float(active.mean())),
            ("active rows, largest", int(active.max())),
            ("ticks on which their number changed", changes),
        ]
    if "certificate" in run:
        names = ("primal residual [unit of the row]", "dual residual", "complementarity gap")
        worst = np.nanmax(np.asarray(run["certificate"], dtype=float), axis=0, initial=0.0)
        rows += [(f"{name}, largest", float(value)) for name, value in zip(names, worst, strict=True)]
    return rows


def _distances(result: ScenarioResult) -> list[tuple[Cell, ...]]:
    """Of each task and unit of its rows: the median and the largest bound, and the share of the ticks that have one."""
    rows: list[tuple[Cell, ...]] = []
    for task, bound in result.run.matching("distance.").items():
        proved = bound[np.isfinite(bound)]
        median, largest = (np.median(proved), proved.max()) if proved.size else (np.nan, np.nan)
        for unit in result.run.meta.get("distances", {}).get(task, "").split(", "):
            rows.append((task, unit, float(median), float(largest), percent(proved.size / result.run.rows)))
    return rows


def _advice(name: str) -> str:
    try:
        return Status[name.upper().replace(" ", "_")].value
    except KeyError:
        return ""
