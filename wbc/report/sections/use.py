"""Share of a limit in use: one plot and one table that torques and velocities have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wbc.report import measure
from wbc.report.document import Bar, Bound, Curve, Plot, Table, percent
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run

WORST = 4
#: A table of more joints is shown when asked for.
LONG = 14
#: Where the limit stands in the bar of a joint.
LIMIT = 0.8


def use_plot(run: Run, share: Vec, name: str, title: str) -> Plot:
    """``share`` (N, nj) of a limit over time: the worst joints, the largest of the others, and each of them."""
    names = short_names(run.meta["joint_names"])
    worst = list(np.argsort(-share.max(axis=0), kind="stable"))
    shown, others = worst[:WORST], worst[WORST:]
    curves = [Curve(names[i], 100.0 * share[:, i]) for i in shown]
    if others:
        curves.append(Curve("largest other", 100.0 * share[:, others].max(axis=1), faint=True))
        curves += [Curve(names[i], 100.0 * share[:, i], shown=False) for i in others]
    return Plot(name, title, "%", measure.times(run), curves, [Bound(100.0, "limit")], zero=True, wide=True)


def use_table(run: Run, values: Vec, share: Vec, bound: Vec, units: Sequence[str], *, kind: str) -> Table:
    """Every joint's largest absolute value, limit and share, the most used first."""
    order = np.argsort(-share.max(axis=0), kind="stable")
    names = run.meta["joint_names"]
    rows = [
        (names[i], units[i] if units else "", float(np.nanmax(np.abs(values[:, i]), initial=0.0)), float(bound[i]),
         _bar(share[:, i], float(bound[i])))
        for i in order
    ]  # fmt: skip
    columns = ("joint", "unit", "largest", "limit", "largest share")
    return Table(columns, rows, f"Largest |{kind}| of every joint. The line in a bar is the limit.", len(rows) > LONG)


def short_names(names: Sequence[str]) -> list[str]:
    """Joint names without the word that all of them end with."""
    return [name.removesuffix("_joint") for name in names] if all(n.endswith("_joint") for n in names) else list(names)


def _bar(share: Vec, bound: float) -> Bar | str:
    if not np.isfinite(bound) or bound <= 0:
        return "–"
    most = float(share.max())
    return Bar(0.0, min(LIMIT * most, 1.0), percent(most), LIMIT, most <= 1 + 1e-9)
