"""What the solver did: statuses, iterations, active rows, certificates."""

from __future__ import annotations

import numpy as np

from wbc.report import measure
from wbc.report.document import Bound, Cell, Curve, Item, Plot, Section, Strip, Table, percent
from wbc.sim.scenario import ScenarioResult
from wbc.types import Status

#: The lowest residual on a logarithmic axis.
LEAST = 1e-18


def section(result: ScenarioResult) -> Section | None:
    """Tables of statuses and of solver statistics, and active rows, iterations and certificates over time."""
    run = result.run
    if "status" not in run or not run.rows:
        return None
    counts = measure.statuses(run)
    rows = [(name, n, percent(n / run.rows), _advice(name)) for name, n in counts.items()]
    items: list[Item] = [Table(("status", "ticks", "share", "meaning"), rows)]
    made = {name: ticks for name, ticks in measure.fallbacks(run).items() if ticks.any()}
    if len(made) > 1:
        often = [(name, int(ticks.sum()), percent(float(ticks.mean()))) for name, ticks in made.items()]
        items.append(Table(("fallback level", "ticks", "share"), often, "What made the command of each tick."))
    statistics = _statistics(result)
    if statistics:
        items.append(Table(("statistic", "value"), statistics, f"Solver {run.meta.get('solver')}, over all ticks."))
    distances = _distances(result)
    if distances:
        items.append(
            Table(
                ("task", "unit", "median", "largest", "ticks with a bound"), distances,
                "Bound on the distance of each task from its optimum, as the certificate of each tick proves it.",
            )
        )  # fmt: skip
    return Section("Solver", [*_plots(result), *items])


def _plots(result: ScenarioResult) -> list[Plot]:
    """Rows at a limit, iterations, and what certificates say, on every tick."""
    run, t = result.run, measure.times(result.run)
    drawn = [(name, label) for name, label in (("active", "Active rows"), ("iterations", "Iterations")) if name in run]
    plots = [
        Plot(name, label, "", t, [Curve(label.lower(), np.asarray(run[name], dtype=float))], zero=True)
        for name, label in drawn
    ]
    fallen = {name: ticks for name, ticks in measure.fallbacks(run).items() if name != "solved" and ticks.any()}
    if fallen:
        strips = [Strip(name, measure.intervals(run, ticks)) for name, ticks in fallen.items()]
        plots.append(Plot("fallbacks", "Ticks that a fallback level answered", "", t, strips=strips))
    if "certificate" in run:
        proof = np.maximum(np.asarray(run["certificate"], dtype=float), LEAST)
        curves = [Curve(name, values) for name, values in zip(("primal", "dual", "gap"), proof.T, strict=True)]
        caption = "Primal residual in the row's unit; dual residual and gap relative to the cost. 0 is drawn as 1e-18."
        bounds = [Bound(1e-6, "certified below")]
        plots.append(
            Plot("certificate", "Residuals of the certificate", "", t, curves, bounds, caption=caption, log="y")
        )
    return plots


def _statistics(result: ScenarioResult) -> list[tuple[str, Cell]]:
    run = result.run
    rows: list[tuple[str, Cell]] = []
    if "iterations" in run:
        n = np.asarray(run["iterations"], dtype=float)
        rows += [
            ("active set of the last tick was right (at most one iteration)", percent(float(np.mean(n <= 1)))),
            ("iterations, mean", float(n.mean())),
            ("iterations, largest", int(n.max())),
        ]
    if "active" in run:
        active = np.asarray(run["active"], dtype=float)
        changes = int(np.count_nonzero(np.diff(active)))
        rows += [
            ("active rows, mean", float(active.mean())),
            ("active rows, largest", int(active.max())),
            ("ticks at which the number of active rows changed", changes),
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
