"""Which constraints were active when, and the share of each task in the cost."""

from __future__ import annotations

import numpy as np

from wbc.report import measure
from wbc.report.document import Curve, Item, Plot, Section, Strip
from wbc.report.why import held, shares
from wbc.sim.scenario import ScenarioResult

#: More strips than these are one.
MOST = 14


def section(result: ScenarioResult) -> Section | None:
    """A strip for each row that was active, and the share of each task in the cost; nothing of an older record."""
    run = result.run
    if "active.row" not in run or not run.rows:
        return None
    t, items = measure.times(run), list[Item]()
    masks = held(run)
    names = list(masks)
    strips = [Strip(name, measure.intervals(run, masks[name])) for name in names[:MOST]]
    if names[MOST:]:
        others = np.any([masks[name] for name in names[MOST:]], axis=0)
        strips.append(Strip(f"{len(names) - MOST} other rows", measure.intervals(run, others)))
    if strips:
        caption = "Click to see the active constraints of that tick and their multipliers."
        items.append(
            Plot("limits", "When each constraint was active", "", t, strips=strips, caption=caption, wide=True)
        )
    costs = [Curve(task, share) for task, share in shares(run).items()]
    if len(costs) > 1:
        caption = "Share of each task in the cost ½ Σ wᵢ rᵢ² of the solution: the tasks that were not met."
        items.append(
            Plot("shares", "Share of each task in the cost", "%", t, costs, caption=caption, zero=True, wide=True)
        )
    return Section("Active constraints", items) if items else None
