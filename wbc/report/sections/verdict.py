"""The verdict: each demand of the scenario, what came out, and what was broken."""

from __future__ import annotations

import numpy as np

from wbc.report.document import Bar, Event, Item, Link, Section, Table, Text, number, percent
from wbc.report.happened import story
from wbc.sim.scenario import Check, ScenarioResult, failed_first

#: Where the bound stands in the bar of a demand, in shares of its width.
BOUND = 0.6


def section(result: ScenarioResult) -> Section:
    """Tables of the scenario's checks, those that failed first, of the limits that were broken, and of its figures."""
    items: list[Item] = []
    if result.verdict:
        rows = [(c.text, c.value, bound(c), c.ok, _where(c), margin(c)) for c in failed_first(result.verdict)]
        columns = ("demanded", "came out", "bound", "holds", "where", "of the bound")
        caption = (
            "Bar: what came out, with a line at the bound. Where: when and in which part it was first broken, or came "
            "nearest to its bound."
        )
        items.append(Table(columns, rows, caption))
    if told := story(result):
        happened = [
            (Link(f"{one.start:.3f} s", one.plot or "limits", one.start), _until(one), one.label) for one in told
        ]
        caption = "What led to the first failure. Until: the last time at which it was so."
        items.append(Table(("from", "until", "what happened"), happened, caption))
    failure = result.run.meta.get("failure")
    if failure:
        items.append(Text("The first tick without an answer, in the controller's words:"))
        items += [Text(line.strip()) for line in str(failure["why"]).splitlines()]
    if result.violations:
        rows_broken = [(kind, worst, unit) for kind, (worst, unit) in result.violations.items()]
        caption = "By how much a limit was exceeded at worst; 0 where none ever was."
        items.append(Table(("limit", "exceeded by", "unit"), rows_broken, caption, folded=bool(result.verdict)))
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in result.figures.items()}
    figures = [(k, v) for k, v in plain.items() if isinstance(v, (bool, int, float, str))]
    if figures:
        items.append(Table(("figure", "value"), figures, "Other figures of this scenario, as recorded.", folded=True))
    return Section("Verdict", items)


def bound(check: Check) -> str:
    """What is demanded: the relation, the bound and its unit."""
    return f"{check.sign} {number(check.bound)} {check.unit}".rstrip()


def _since(event: Event) -> Link:
    return Link(f"{event.start:.3f} s", event.plot or "limits", event.start)


def _until(event: Event) -> str:
    return f"{event.end:.3f} s" if event.end > event.start else ""


def _where(check: Check) -> str | Link:
    at, _, plot = check.place
    return str(check.place) if at is None or not plot else Link(str(check.place), plot, at)


def margin(check: Check) -> Bar:
    """How far the value is on the way to its bound, or beyond it."""
    value, bound = float(check.value), float(check.bound)
    if bound == 0.0 or not np.isfinite(value) or not np.isfinite(bound):
        return Bar(0.0, BOUND if check.relation == "=" and check.ok else float(not check.ok), "", BOUND, check.ok)
    share = 1.0 + (value - bound) / abs(bound)
    text = percent(share) if share < 10.0 else f"{share:.0f} times"
    return Bar(0.0, min(max(BOUND * share, 0.0), 1.0), text if bound > 0.0 else "", BOUND, check.ok)
