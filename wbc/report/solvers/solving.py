"""The section of one set of problems: who solves it, how well, how fast."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from wbc.files import slug
from wbc.report.document import Bound, Cell, Curve, Item, Marked, Plot, Section, Table, Text, percent, plural, short
from wbc.report.solvers.data import Data
from wbc.report.solvers.statistics import (
    TARGET,
    Measure,
    best_classes,
    between_rounds,
    insoluble,
    main_mode,
    measures,
    percentiles,
    period_of,
    profile,
    ratio,
    tolerance_of,
    wins,
)
from wbc.types import Vec

#: So many problems without a solution are named.
_NAMED = 5
#: What is drawn of a profile [times the fastest], and of accuracy.
_SLOWEST, _FINEST, _COARSEST = 1e3, 1e-16, 1.0


def section(data: Data, about: Data) -> Section:
    """Profiles, shares solved, times, accuracy in the tasks' units; behind folds pairs, cold solves, every class."""
    mode = main_mode(about)
    found = measures(data, about["name"], mode)
    chosen = _ranked(best_classes(found))
    order = {m.solver: i for i, m in enumerate(chosen)}
    found = sorted(found, key=lambda m: order[m.solver])  # the sort is stable: classes stay in order
    none = [about["labels"][i] for i in insoluble(data, about["name"])]
    items: list[Item] = [Text(_about(about) + _without(none)), _profile(about, chosen), _reached(about, chosen)]
    items += [_success(data, found, mode), _times(about, chosen, mode), _accuracy(about, chosen)]
    items += [_pairs(chosen)] if len(chosen) > 1 else []
    items += [_cold_against_warm(data, about, chosen)] if mode == "warm" else []
    return Section(about["name"], [*items, _every_class(data, found), _accuracy_of_classes(about, found)])


def _ranked(chosen: Sequence[Measure]) -> list[Measure]:
    """By share solved, then by median time."""
    return sorted(chosen, key=lambda m: (-m.share(TARGET), percentiles(m.times(TARGET))[0] or np.inf))


def _about(about: Data) -> str:
    n = [shape[0] for shape in about["shapes"]]
    rows = [shape[1] + shape[2] for shape in about["shapes"]]
    sizes = f"variables: {_span(n)}, rows: {_span(rows)}"
    if about["kind"] == "files":
        return f"{plural(len(n), 'problem')} from files, each solved alone ({sizes})."
    return (
        f"{plural(len(n), 'QP')} of a closed loop in {plural(len(about['stretches']), 'part')} of consecutive ticks "
        f"({sizes}), {about['source']}. Warm: one session goes through a part; its first problem is not counted."
    )


def _without(labels: Sequence[str]) -> str:
    """Of the problems that are proven to have no solution."""
    shown = ", ".join(labels[:_NAMED]) + ", …" * (len(labels) > _NAMED)
    return f" Not counted, because they are proven to have no solution: {len(labels)} ({shown})." if labels else ""


def _span(values: Sequence[int]) -> str:
    return str(values[0]) if min(values) == max(values) else f"{min(values)} to {max(values)}"


# ---- pictures
def _profile(about: Data, chosen: Sequence[Measure]) -> Plot:
    x, curves = _shares([(m.solver, ratios) for m, ratios in profile(chosen)], 1.0, _SLOWEST)
    caption = (
        "Dolan-Moré profile: share of the problems that a solver solves to 1e-6 within a multiple of the time of the "
        "fastest solver. Left edge: how often it is the fastest. Right edge: how many it solves. Each solver in its "
        "best class."
    )
    return Plot(f"profile-{slug(about['name'])}", "Solved in time", "% of problems", x, curves, caption=caption,
                over="time over the fastest", log="x", zero=True, steps=True)  # fmt: skip


def _reached(about: Data, chosen: Sequence[Measure]) -> Plot:
    x, curves = _shares([(m.solver, m.achieved) for m in chosen], _FINEST, _COARSEST)
    caption = (
        "Share of the solutions whose certificate holds at a tolerance: no limit is exceeded by more, and every task "
        "is within 100 times the tolerance of its optimum, relative to 1 + |target|."
    )
    return Plot(f"accuracy-{slug(about['name'])}", "Solved to a tolerance", "% of problems", x, curves,
                [Bound(TARGET, "wanted", "x")], caption=caption, over="tolerance", log="x", zero=True,
                steps=True)  # fmt: skip


def _shares(found: Sequence[tuple[str, Vec]], low: float, high: float) -> tuple[Vec, list[Curve]]:
    """Values x from ``low`` to ``high``, and for each solver the share of its problems [%] with at most that."""
    values = np.clip(np.concatenate([own for _, own in found]), low, None)
    within = values[values <= high]
    x = np.unique(np.concatenate([[low], within, [min(high, 1.3 * float(within.max(initial=10.0 * low)))]]))
    return x, [
        Curve(name, 100.0 * np.searchsorted(np.sort(np.clip(own, low, None)), x, "right") / len(own))
        for name, own in found
    ]


# ---- tables
def _success(data: Data, found: Sequence[Measure], mode: str) -> Table:
    """One row a solver: what is solved, and called solved but is not, class by class."""
    classes = list(data["classes"])
    rows: list[list[Cell]] = []
    for solver in dict.fromkeys(m.solver for m in found):
        own = {m.asked: m for m in found if m.solver == solver}
        rows.append([solver, *(_solved(data, own[name]) for name in classes), sum(m.lost for m in own.values())])
    note = (
        f"Solved ({mode}): the certificate holds at the requested tolerance; for the default class at 1e-6. By "
        "itself: the back end's own solutions, before the library refines them with the rows that they name as active. "
        "Wrong: the back end says solved, or nearly solved, and the certificate fails, after refinement too. Lost: "
        "hangs and crashes of all classes."
    )
    return Table(["solver", *(f"at {name}" if name != "default" else name for name in classes), "lost"], rows, note)


def _solved(data: Data, m: Measure) -> Cell:
    tolerance, wrong = tolerance_of(data, m.asked), int(_wrong(data, m).sum())
    share, own = m.share(tolerance), float(np.mean(m.by_itself(tolerance)))
    said = f"{percent(share)} ({percent(own)} by itself)" if own < share else percent(share)
    return Marked(f"{said}, {wrong} wrong", "bad") if wrong else said


def _wrong(data: Data, m: Measure) -> Any:
    return m.says_solved & ~m.holds(tolerance_of(data, m.asked))


def _times(about: Data, chosen: Sequence[Measure], mode: str) -> Table:
    reference, period = chosen[0], period_of(about)
    rows: list[list[Cell]] = []
    for m in chosen:
        times = m.times(TARGET)
        late, rounds = int((times[np.isfinite(times)] > period).sum()), between_rounds(m)
        factor, common = ratio(times, reference.times(TARGET))
        rows.append([
            m.solver, m.asked, int(np.isfinite(times).sum()), *percentiles(times), factor, common,
            Marked(str(late), "bad") if late else 0, None if rounds is None else percent(rounds - 1.0),
        ])  # fmt: skip
    columns = ("solver", "requested", "solved to 1e-6", "p50 [µs]", "p99 [µs]", "max [µs]",
               f"times {reference.solver}", "compared on", f"over {1e-3 * period:g} ms",
               "rounds differ by")  # fmt: skip
    note = (
        f"Time of a whole solve, {mode}, of the problems that are solved to 1e-6; each solver in its best class. The "
        f"ratio to {reference.solver} is the geometric mean over the problems that both solved."
    )
    return Table(columns, rows, note)


def _accuracy(about: Data, chosen: Sequence[Measure]) -> Table:
    """One row a limit and a task, one column a solver."""
    rows = [[what, *(_largest(m, kind, name) for m in chosen)] for what, kind, name in _quantities(about, chosen)]
    note = (
        "Accuracy of all solutions, solved or not, each solver in its best class: the largest violation of a limit by "
        "unit, and the largest bound of the certificate on the distance of each task from its optimum."
    )
    return Table(["", *(m.solver for m in chosen)], rows, note)


def _accuracy_of_classes(about: Data, found: Sequence[Measure]) -> Table:
    quantities = list(_quantities(about, found))
    rows = [[m.solver, m.asked, *(_largest(m, kind, name) for _, kind, name in quantities)] for m in found]
    return Table(["solver", "requested", *(what for what, *_ in quantities)], rows, "Accuracy in all classes",
                 folded=True)  # fmt: skip


def _quantities(about: Data, found: Sequence[Measure]) -> Iterator[tuple[str, str, str]]:
    """What is said, and where it stands: the violations by unit, then the tasks."""
    for unit in dict.fromkeys(unit for m in found for unit in m.violation):
        yield f"limits exceeded{f' [{unit}]' if unit else ''}", "violation", unit
    for task in dict.fromkeys(task for m in found for task in m.bounds):
        unit = about["tasks"].get(task, "")
        yield f"{task if task in about['tasks'] else 'variables'}{f' [{unit}]' if unit else ''}", "bounds", task


def _largest(m: Measure, kind: str, name: str) -> Cell:
    values = getattr(m, kind).get(name, np.full(1, np.nan))
    if not np.isfinite(values).any():
        return None
    worst = float(np.nanmax(values))
    if worst < 1e-12:
        return "< 1e-12" if worst else "0"
    said = short(float(f"{worst:.2g}"))
    return Marked(said, "bad") if kind == "violation" and worst > TARGET else said


def _pairs(chosen: Sequence[Measure]) -> Table:
    times = [m.times(TARGET) for m in chosen]
    rows: list[list[Cell]] = []
    for i, m in enumerate(chosen):
        row: list[Cell] = [m.solver]
        for j, other in enumerate(times):
            won = wins(times[i], other)
            row.append("" if i == j else "–" if won is None else percent(won))
        rows.append(row)
    note = "How often the solver of the row was faster than that of the column; a solver that fails counts as slower"
    return Table(["faster", *(m.solver for m in chosen)], rows, note, folded=True)


def _cold_against_warm(data: Data, about: Data, chosen: Sequence[Measure]) -> Table:
    cold = {(m.solver, m.asked): m for m in measures(data, about["name"], "cold")}
    rows: list[list[Cell]] = []
    for m in chosen:
        other = cold[m.solver, m.asked]
        p50, p99, top = percentiles(other.times(TARGET))
        warm = percentiles(m.times(TARGET))[0]
        over = None if not p50 or not warm else p50 / warm
        rows.append([m.solver, m.asked, percent(other.share(TARGET)), p50, p99, top, over])
    columns = ("solver", "requested", "solved to 1e-6", "p50 [µs]", "p99 [µs]", "max [µs]", "median over warm")
    note = "The same problems cold: a new session for each, included in the time"
    return Table(columns, rows, note, folded=True)


def _every_class(data: Data, found: Sequence[Measure]) -> Table:
    rows: list[list[Cell]] = []
    for m in found:
        times = m.times(TARGET)
        good, rest = np.isfinite(times), m.total - m.build - m.solve
        parts = [float(np.median(part[good])) if good.any() else None for part in (m.build, m.solve, rest)]
        gave_up = sum(word not in ("SOLVED", "INACCURATE", "LOST") for word in m.status)
        changed = m.changed[np.isfinite(m.changed)]
        rows.append([
            m.solver, m.asked, _solved(data, m), gave_up, m.lost, *percentiles(times), *parts,
            float(changed.mean()) if changed.size else None,
        ])  # fmt: skip
    columns = ("solver", "requested", "solved", "stops early", "lost", "p50 [µs]", "p99 [µs]", "max [µs]", "build [µs]",
               "solve [µs]", "wrapper [µs]", "set changes")  # fmt: skip
    note = "All classes, with the parts of a solve: conversion, back end, checks and certificate"
    return Table(columns, rows, note, folded=True)
