"""Share of a limit in use: one figure and one table that torques and velocities have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wbc.report import measure, style
from wbc.report.document import Figure, Table, percent
from wbc.types import Vec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wbc.control.recorder import Run

WORST = 4


def use_figure(run: Run, share: Vec, name: str, label: str, caption: str) -> Figure:
    """``share`` (N, nj) of a limit over time for the worst joints, and its peak and rms for all of them."""
    names = short_names(run.meta["joint_names"])
    peak, rms = share.max(axis=0), np.sqrt((share**2).mean(axis=0))
    worst = [int(i) for i in np.argsort(-peak, kind="stable")[:WORST]]
    top = max(float(peak.max(initial=0.0)), 0.02)
    with style.Canvas(2, 1, height=5.0) as canvas:
        over_time, per_joint = canvas.axes
        _curves(over_time, run, share, [(i, names[i]) for i in worst])
        style.over_time(over_time, run, "Over time", label)
        _bars(per_joint, names, peak, rms)
        per_joint.set_ylabel(label)
        for axes in canvas.axes:
            axes.set_ylim(0.0, 1.12 * max(top, 1.0) if top > 0.5 else 1.08 * top)
            axes.yaxis.set_major_formatter(lambda x, _: f"{100 * x:.3g} %")
            style.legend(axes)
            if top > 0.5:
                style.bound(axes, 1.0, "limit")
        return canvas.figure(name, caption)


def use_table(run: Run, values: Vec, share: Vec, bound: Vec, units: Sequence[str], *, kind: str) -> Table:
    """Every joint's largest absolute value, limit and share, the most used first."""
    order = np.argsort(-share.max(axis=0), kind="stable")
    names = run.meta["joint_names"]
    rows = [
        (names[i], units[i] if units else "", float(np.nanmax(np.abs(values[:, i]), initial=0.0)), float(bound[i]),
         percent(float(share[:, i].max())) if np.isfinite(bound[i]) and bound[i] > 0 else "–")
        for i in order
    ]  # fmt: skip
    return Table(
        ("joint", "unit", f"largest |{kind}|", "limit", "in use"), rows, f"{kind.capitalize()} of every joint.", True
    )


def short_names(names: Sequence[str]) -> list[str]:
    """Joint names without the word that all of them end with, for the axes of a figure."""
    return [name.removesuffix("_joint") for name in names] if all(n.endswith("_joint") for n in names) else list(names)


def name_joints(axes: Axes, names: Sequence[str]) -> None:
    """One place on the x axis for each joint, its name upright below it where there are many."""
    many = len(names) > 8
    axes.set_xticks(range(len(names)), names, rotation=90 if many else 0, fontsize=7 if many else 8)
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.grid(axis="x", visible=False)


def _curves(axes: Axes, run: Run, share: Vec, worst: Sequence[tuple[int, str]]) -> None:
    t = measure.times(run)
    shown = {i for i, _ in worst}
    others = [i for i in range(share.shape[1]) if i not in shown]
    if others:
        style.curve(axes, t, share[:, others].max(axis=1), color=style.FAINT, label="largest other", linewidth=0.9)
    for k, (i, name) in reversed(list(enumerate(worst))):
        style.curve(axes, t, share[:, i], color=style.CYCLE[k], label=name)


def _bars(axes: Axes, names: Sequence[str], peak: Vec, rms: Vec) -> None:
    places = np.arange(len(names))
    colours = [style.RED if p > 1 + 1e-9 else style.BLUE for p in peak]
    axes.bar(places, peak, width=0.62, color=[c + "55" for c in colours], linewidth=0, label="largest")
    axes.bar(places, rms, width=0.62, color=colours, linewidth=0, label="rms")
    name_joints(axes, names)
    axes.set_title("Every joint")
