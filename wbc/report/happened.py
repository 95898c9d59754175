"""What happened in a run and when: the marks of its clock, and how it came to the demand that failed first."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from wbc.report import measure
from wbc.report.document import Event
from wbc.report.why import held
from wbc.sim.scenario import ScenarioResult, failed_first
from wbc.types import Flags

#: How a disturbance says when it began, and perhaps ended.
SINCE = re.compile(r" from ([\d.e+-]+) s(?: to ([\d.e+-]+) s)?")
#: More marks than these hide one another: changes of contacts are left out.
MOST_EVENTS = 200
#: Of what happened at once: causes first.
ORDER = ("push", "fault", "row", "contact", "failed", "status", "end")
#: Without a disturbance before it, a failure is told from so long before it on [s].
BEFORE = 0.5


def events(result: ScenarioResult) -> list[Event]:
    """What happened in a run, and which demands failed when: the marks of its clock."""
    run = result.run
    end, disturbances = measure.seconds(run), [str(line) for line in run.meta.get("disturbances", [])]
    found = [Event(start, stop, "push", "push") for start, stop in measure.pushes(run)]
    for line in disturbances:
        said = None if line.startswith("push") else SINCE.search(line)
        if said and float(said[1]) < end:
            found.append(Event(float(said[1]), float(said[2] or end), line, "fault"))
    for name, standing in measure.standing(run).items():
        spans = measure.intervals(run, standing)
        found += [Event(start, start, f"{name} is loaded", "contact") for start, _ in spans if start > 0.0]
        found += [Event(stop, stop, f"{name} is unloaded", "contact") for _, stop in spans if stop < end]
    found = found if len(found) <= MOST_EVENTS else [event for event in found if event.kind != "contact"]
    for check in failed_first(result.verdict):
        at, part, plot = check.place
        if not check.ok and at is not None:
            found.append(Event(at, at, f"{check.text}{f', {part}' if part else ''}", "failed", plot))
    return found


def story(result: ScenarioResult) -> list[Event]:
    """What led to the demand that failed first, in the order of time; empty where none failed, or nobody knows when.

    From the last push or fault before that failure on: when each constraint or limit first had an active row, when each
    contact first carried nothing, the ticks without a certified answer, the demands that failed, and the end.
    """
    run, found = result.run, sorted(events(result))
    failed = [event for event in found if event.kind == "failed"]
    if not failed or not run.rows:
        return []
    first, end = failed[0].start, measure.seconds(run)
    causes = [event for event in found if event.kind in ("push", "fault") and event.start < first]
    begin = causes[-1].start if causes else max(first - BEFORE, 0.0)
    told = [event for event in causes[-1:] if event.kind != "push"] + _pushed(result, begin)
    told += [event._replace(label=f"not met: {event.label}") for event in failed]
    freed = [event for event in found if event.kind == "contact" and event.label.endswith("is unloaded")]
    told += list({event.label: event for event in reversed(freed) if event.start >= begin}.values())
    told += _held(result, begin)
    unsolved = measure.intervals(run, ~measure.solved(run) & (measure.times(run) >= begin))
    told += [_often("no certified solution", unsolved, "status")] if unsolved else []
    if str(run.meta.get("ended", "complete")) != "complete":
        told.append(Event(end, end, f"the run ended: {run.meta['ended']}", "end"))
    return sorted(told, key=lambda event: (event.start, ORDER.index(event.kind)))


def _pushed(result: ScenarioResult, begin: float) -> list[Event]:
    """The push that began at ``begin``, in the words of its disturbance."""
    for start, stop in measure.pushes(result.run):
        if start == begin:
            lines = [str(line) for line in result.run.meta.get("disturbances", []) if str(line).startswith("push")]
            said = next((line for line in lines if f" from {start:g} s" in line), "push")
            return [Event(start, stop, said.partition(" from ")[0], "push")]
    return []


def _held(result: ScenarioResult, begin: float) -> list[Event]:
    """From when to when the rows of each owner, a friction cone or a limit of a joint, were active, and how often."""
    run = result.run
    if "active.row" not in run:
        return []
    late, owners = measure.times(run) >= begin, dict[str, Flags]()
    for name, mask in held(run).items():
        owner = name.partition(": " if name.startswith("friction") else ", ")[0]
        owners[owner] = owners.get(owner, np.zeros(run.rows, dtype=bool)) | (mask & late)
    spans = {owner: measure.intervals(run, mask) for owner, mask in owners.items() if mask.any()}
    return [_often(f"{owner} is active", times, "row") for owner, times in spans.items()]


def _often(label: str, times: Sequence[tuple[float, float]], kind: str) -> Event:
    """From the first to the last of the intervals ``times`` [s], and how many there are."""
    return Event(times[0][0], times[-1][1], f"{label}{f', {len(times)} times' * (len(times) > 1)}", kind, "limits")
