"""How well each task was met over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.report import measure
from wbc.report.document import Curve, Item, Plot, Section, Table, readable
from wbc.sim.scenario import ScenarioResult
from wbc.types import Vec

AXES = ("x", "y", "z")


def section(result: ScenarioResult) -> Section | None:
    """One plot of the error of each task and a table of rms and largest error."""
    run, items = result.run, list[Item]()
    rows = []
    for task in measure.tasks(run):
        about = run.meta.get("tasks", {}).get(task, {})
        labels, units = about.get("labels") or (), about.get("units") or ()
        for k, (unit, error) in enumerate(measure.errors(run, task).items()):
            if not np.any(error):  # a task without a target, such as a gradient, has no error
                continue
            factor, shown = readable(unit)
            name = f"tracking.{task}" + (f".{unit}" if k else "")
            own = [label for label, of in zip(labels, units, strict=False) if label and of == unit]
            curves = _curves(factor * error, own if len(own) == error.shape[1] else ())
            items.append(Plot(name, task, shown, measure.times(run), curves))
            norm = factor * np.linalg.norm(error, axis=1)
            rows.append((task, shown, measure.rms(norm), float(norm.max()), float(norm[-1])))
    if not items:
        return None
    caption = (
        "Euclidean norm of the error of each task, target − actual, over the whole run. The plot of a task with many "
        "rows shows their largest value and their rms; the legend lists each row."
    )
    items.append(Table(("task", "unit", "rms", "largest", "at the end"), rows, caption))
    judged = [(task, value["rms"], value["max"]) for task, value in result.tracking.items()]
    if judged:
        columns = ("task", "rms [m or rad]", "max [m or rad]")
        items.append(Table(columns, judged, "Errors over the intervals that the scenario judges", folded=True))
    return Section("Tracking", items)


def _curves(error: Vec, labels: Sequence[str]) -> list[Curve]:
    k = error.shape[1]
    if k <= len(AXES):
        names = labels or (AXES[:k] if k > 1 else ("error",))
        return [Curve(name, values) for name, values in zip(names, error.T, strict=True)]
    names = labels or [f"row {i + 1}" for i in range(k)]
    return [
        Curve(f"largest of {k}", np.abs(error).max(axis=1)),
        Curve("rms", np.sqrt((error**2).mean(axis=1))),
        *(Curve(name, values, shown=False) for name, values in zip(names, error.T, strict=True)),
    ]
