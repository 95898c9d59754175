"""Share of a limit in use: one figure and one table that torques and velocities have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wbc.report import measure, style
from wbc.report.document import Figure, Table
from wbc.types import Vec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wbc.control.recorder import Run

WORST = 5


def use_figure(run: Run, share: Vec, name: str, label: str, caption: str) -> Figure:
    """``share`` (N, nj) of a limit over time for the worst joints, and its peak and rms for all of them."""
    names = short_names(run.meta["joint_names"])
    peak, rms = share.max(axis=0), np.sqrt((share**2).mean(axis=0))
    worst = [int(i) for i in np.argsort(-peak)[:WORST]]
    top = max(1.06 * float(peak.max()), 0.1)
    with style.Canvas(1, 2, height=max(2.9, 0.9 + 0.155 * len(names)), widths=(1.5, 1)) as canvas:
        over_time, per_joint = canvas.axes
        _over_time(over_time, run, share, [(i, names[i]) for i in worst])
        over_time.set_ylabel(label)
        _per_joint(per_joint, names, peak, rms)
        per_joint.set_xlabel(label)
        for axes, is_x in ((over_time, False), (per_joint, True)):
            (axes.set_xlim if is_x else axes.set_ylim)(0, 1.08 if top > 0.5 else top)
            (axes.xaxis if is_x else axes.yaxis).set_major_formatter(lambda x, _: f"{100 * x:.3g} %")
            if top > 0.5:
                style.bound(axes, 1.0, "limit", vertical=is_x)
        return canvas.figure(name, caption)


def use_table(run: Run, values: Vec, share: Vec, bound: Vec, units: Sequence[str], kind: str) -> Table:
    """Every joint's largest absolute value, limit and share, the most used first."""
    order = np.argsort(-share.max(axis=0), kind="stable")
    names = run.meta["joint_names"]
    rows = [
        (names[i], units[i] if units else "", float(np.abs(values[:, i]).max()), float(bound[i]),
         f"{100 * share[:, i].max():.1f} %" if np.isfinite(bound[i]) and bound[i] > 0 else "–")
        for i in order
    ]  # fmt: skip
    return Table(
        ("joint", "unit", f"largest |{kind}|", "limit", "in use"), rows, f"{kind.capitalize()} of every joint.", True
    )


def short_names(names: Sequence[str]) -> list[str]:
    """Joint names without the word that all of them end with, for the axes of a figure."""
    return [name.removesuffix("_joint") for name in names] if all(n.endswith("_joint") for n in names) else list(names)


def _over_time(axes: Axes, run: Run, share: Vec, worst: Sequence[tuple[int, str]]) -> None:
    t = measure.times(run)
    style.shade(axes, measure.pushes(run))
    shown = {i for i, _ in worst}
    others = [i for i in range(share.shape[1]) if i not in shown]
    if others:
        style.curve(
            axes, t, share[:, others].max(axis=1), color=style.FAINT, label="largest of the others", linewidth=0.9
        )
    for k, (i, name) in enumerate(worst):
        style.curve(axes, t, share[:, i], color=style.CYCLE[k], label=name)
    axes.set_title("Most used")
    axes.set_xlabel("time [s]")
    axes.set_xlim(t[0], t[-1] if t[-1] > t[0] else t[0] + 1.0)
    axes.legend(loc="upper left", bbox_to_anchor=(0, -0.13), ncols=3, columnspacing=1.2)


def _per_joint(axes: Axes, names: Sequence[str], peak: Vec, rms: Vec) -> None:
    rows = np.arange(len(names))[::-1]
    colours = [style.RED if p > 1 + 1e-9 else style.BLUE for p in peak]
    axes.barh(rows, peak, height=0.62, color=[c + "55" for c in colours], linewidth=0, label="largest")
    axes.barh(rows, rms, height=0.62, color=colours, linewidth=0, label="rms")
    axes.set_yticks(rows, names, fontsize=7)
    axes.set_ylim(-0.7, len(names) - 0.3)
    axes.grid(axis="y", visible=False)
    axes.set_title("Every joint")
    axes.legend(loc="lower right", reverse=True)
