"""How well each task was met over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wbc.report import measure, style
from wbc.report.document import Figure, Section, Table
from wbc.sim.scenario import ScenarioResult
from wbc.types import Vec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AXES = ("x", "y", "z")


def section(result: ScenarioResult) -> Section | None:
    """One plot of the error of each task and a table of rms and largest error."""
    run = result.run
    parts = [(task, unit, e) for task in measure.tasks(run) for unit, e in measure.errors(run, task).items()]
    if not parts:
        return None
    caption = (
        "Error of each task, target − actual; of a task with many rows, the largest and the rms over its rows."
        + style.shaded(run)
    )
    rows = []
    for task, unit, error in parts:
        factor, shown = style.readable(unit)
        norm = factor * np.linalg.norm(error, axis=1)
        rows.append((task, shown, float(np.sqrt(np.mean(norm**2))), float(norm.max()), float(norm[-1])))
    table = Table(
        ("task", "unit", "rms", "largest", "at the end"), rows, "Euclidean norm of the error over the whole run."
    )
    judged = [(task, value["rms"], value["max"]) for task, value in result.tracking.items()]
    judged_table = Table(
        ("task", "rms", "max"), judged, "As the scenario judges it (its own intervals and units).", folded=True
    )
    return Section("Tracking", [_figure(result, parts, caption), table, *([judged_table] if judged else [])])


def _figure(result: ScenarioResult, parts: list[tuple[str, str, Vec]], caption: str) -> Figure:
    columns = 1 if len(parts) == 1 else 2
    rows = -(-len(parts) // columns)
    with style.Canvas(rows, columns, height=0.3 + 1.85 * rows) as canvas:
        for axes, (task, unit, error) in zip(canvas.axes, parts, strict=False):
            factor, shown = style.readable(unit)
            _draw(axes, measure.times(result.run), factor * error)
            style.over_time(axes, result.run, task, f"error [{shown}]" if shown else "error")
            style.legend(axes)
        for axes in canvas.axes[len(parts) :]:
            axes.set_visible(False)
        for axes in canvas.axes[: max(0, len(parts) - columns)]:
            axes.set_xlabel("")
        return canvas.figure("tracking", caption)


def _draw(axes: Axes, t: Vec, error: Vec) -> None:
    k = error.shape[1]
    if k <= len(AXES):
        style.curves(axes, t, error, AXES[:k] if k > 1 else ("error",))
    else:
        style.curve(axes, t, np.abs(error).max(axis=1), color=style.BLUE, label=f"largest of {k}")
        style.curve(axes, t, np.sqrt((error**2).mean(axis=1)), color=style.ORANGE, label="rms")
