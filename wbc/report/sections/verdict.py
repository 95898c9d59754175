"""The verdict: each demand of the scenario, what came out, and what was broken."""

from __future__ import annotations

import numpy as np

from wbc.report.document import Item, Section, Table
from wbc.sim.scenario import ScenarioResult


def section(result: ScenarioResult) -> Section:
    """Tables of the scenario's checks, of the limits that were broken, and of its own figures."""
    items: list[Item] = []
    if result.verdict:
        rows = [(c.text, c.value, c.bound, c.unit, bool(c.ok)) for c in result.verdict]
        items.append(Table(("demanded", "came out", "bound", "unit", "holds"), rows))
    if result.violations:
        rows_broken = [(kind, worst, unit) for kind, (worst, unit) in result.violations.items()]
        caption = "By how much a limit was exceeded at worst; 0 where none ever was."
        items.append(Table(("limit", "exceeded by", "unit"), rows_broken, caption))
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in result.figures.items()}
    figures = [(k, v) for k, v in plain.items() if isinstance(v, (bool, int, float, str))]
    if figures:
        items.append(
            Table(("figure", "value"), figures, "What this scenario measures besides.", folded=len(figures) > 8)
        )
    return Section("Verdict", items)
