"""The verdict: each demand of the scenario, what came out, and what was broken."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby

import numpy as np

from wbc.report.document import Bar, Event, Item, Link, Section, Table, neutral, number, percent, rounded
from wbc.report.happened import story
from wbc.report.sections.settings import figure_name
from wbc.sim.scenario import Check, ScenarioResult, failed_first
from wbc.tolerances import MET

#: Where the bound stands in the bar of a demand, in shares of its width.
BOUND = 0.6


def section(result: ScenarioResult) -> Section:
    """Tables of the scenario's checks, those that failed first, of the limits that were broken, and of its figures."""
    items: list[Item] = []
    if result.verdict:
        rows = [(c.text, c.value, bound(c), c.ok, _where(c), margin(c)) for c in failed_first(result.verdict)]
        columns = ("demand", "value", "bound", "met", "where", "share of bound")
        caption = (
            "Bar: the value; the line is the bound. Where: the time and the part at which the demand was first "
            "violated, or else came nearest to its bound."
        )
        items.append(Table(columns, rows, caption))
    if told := story(result):
        happened = [(_since(one), _until(one), one.label) for one in told]
        items.append(Table(("from", "until", "event"), happened, "What happened up to the first failure and after it."))
    failure = result.run.meta.get("failure")
    if failure:
        caption = "The text of Controller.explain(), the rows of one constraint together."
        items.append(Table(("first tick without a certified solution", ""), _explained(str(failure["why"])), caption))
    silent = result.run.meta.get("silent")
    if isinstance(silent, Mapping) and silent:
        caption = (
            "Signals of these components are missing in the record, in some ticks or in all. The commands were sent."
        )
        items.append(Table(("not recorded", "why, in the first of these ticks"), [*silent.items()], caption))
    if result.violations:
        rows_broken = [(kind, worst, unit) for kind, (worst, unit) in result.violations.items()]
        caption = "Largest violation of each limit"
        if result.ok and any(worst > MET for worst, _ in result.violations.values()):
            caption += (
                ". Velocities and positions are measured: a push can move a joint beyond its limit although every "
                "command keeps it. No demand of this scenario is about it."
            )
        items.append(Table(("limit", "exceeded by", "unit"), rows_broken, caption, folded=bool(result.verdict)))
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in result.figures.items()}
    figures = [(figure_name(k), neutral(v)) for k, v in plain.items() if isinstance(v, (bool, int, float, str))]
    if figures:
        items.append(Table(("figure", "value"), figures, "Other figures of this scenario", folded=True))
    return Section("Verdict", items)


def bound(check: Check) -> str:
    """What is demanded: the relation, the bound and its unit."""
    return f"{check.sign} {number(check.bound)} {check.unit}".rstrip()


def _explained(why: str) -> list[tuple[str, str]]:
    """The lines of an explanation, those of one constraint in one row: what it is about, and what is said of it."""
    parted = [line.strip().partition(": ") for line in why.splitlines()]
    owners = groupby(parted, key=lambda parts: parts[0])
    return [(owner.rstrip(":"), ", ".join(said for _, _, said in lines if said)) for owner, lines in owners]


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
        return Bar(0.0, BOUND if value == bound else float(not value < bound), "", BOUND, check.ok)
    share = 1.0 + (value - bound) / abs(bound)
    text = percent(share) if share < 10.0 else f"{rounded(share)} times"
    return Bar(0.0, min(max(BOUND * share, 0.0), 1.0), text if bound > 0.0 else "", BOUND, check.ok)
