"""The section of one set of problems: who solves it, how well, how fast."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.report import style
from wbc.report.document import Cell, Figure, Item, Section, Table, Text, percent
from wbc.report.solvers.data import Data
from wbc.report.solvers.drawing import look, side_legend, slug
from wbc.report.solvers.statistics import (
    PERIOD,
    TARGET,
    Measure,
    best_classes,
    main_mode,
    measures,
    percentiles,
    profile,
    ratio,
    tolerance_of,
    wins,
)
from wbc.report.style import logarithmic, short
from wbc.types import Vec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SEVERAL = 2


def section(data: Data, about: Data) -> Section:
    """Success and time, profile, pairs, accuracy, violations."""
    mode = main_mode(about)
    found = measures(data, about["name"], mode)
    chosen = best_classes(found)
    order = {m.solver: i for i, m in enumerate(_ranked(chosen))}
    found = sorted(found, key=lambda m: order[m.solver])  # the sort is stable: classes stay in order
    chosen = _ranked(chosen)
    items: list[Item] = [Text(_about(about))]
    items += [_profile_figure(about, chosen), _success(data, found, mode), _success_in_full(data, found)]
    items += [_times(chosen, chosen, mode), _times(found, chosen, mode)]
    items += [_pairs(chosen)] if len(chosen) >= _SEVERAL else []
    items += [_accuracy_figure(about, found), *_violations(chosen, found), _achieved(found), _residuals(found)]
    if mode == "warm":
        items.append(_cold_against_warm(data, about, chosen))
    return Section(about["name"], items)


def _ranked(chosen: Sequence[Measure]) -> list[Measure]:
    """By share solved, then by median time."""
    return sorted(chosen, key=lambda m: (-m.share(TARGET), percentiles(m.times(TARGET))[0] or np.inf))


def _about(about: Data) -> str:
    n = [shape[0] for shape in about["shapes"]]
    rows = [shape[1] + shape[2] for shape in about["shapes"]]
    sizes = f"{_span(n)} variables, {_span(rows)} rows"
    if about["kind"] == "files":
        return f"{len(n)} problems from files, each solved alone ({sizes})."
    stretches = len(about["stretches"])
    return (
        f"{len(n)} QPs of a closed loop in {stretches} stretch{'es' if stretches > 1 else ''} of consecutive ticks "
        f"({sizes}), {about['source']}. Warm: one session goes through a stretch; its first problem is not counted."
    )


def _span(values: Sequence[int]) -> str:
    return str(values[0]) if min(values) == max(values) else f"{min(values)} to {max(values)}"


def _success(data: Data, found: Sequence[Measure], mode: str) -> Table:
    """One row a solver: shares solved, and wrong claims, class by class."""
    classes = list(data["classes"])
    rows: list[list[Cell]] = []
    for solver in dict.fromkeys(m.solver for m in found):
        own = {m.asked: m for m in found if m.solver == solver}
        solved = [percent(own[name].share(tolerance_of(data, name))) for name in classes]
        wrong = [int(_wrong(data, own[name]).sum()) for name in classes]
        rows.append([solver, *solved, *wrong, sum(len(m.lost) for m in own.values())])
    columns = ["solver", *(f"solved, {name}" for name in classes), *(f"wrong, {name}" for name in classes), "lost"]
    note = (
        f"Solved ({mode}): the certificate recomputed from the data holds to what was asked, 1e-6 for the default "
        "settings: rows in their own units, and a hundred times that from the optimum relative to its size. Wrong: "
        "says solved but is not. Lost: hangs or crashes, all classes together."
    )
    return Table(columns, rows, note)


def _wrong(data: Data, m: Measure) -> Any:
    return m.says_solved & ~m.holds(tolerance_of(data, m.asked))


def _success_in_full(data: Data, found: Sequence[Measure]) -> Table:
    rows: list[list[Cell]] = []
    for m in found:
        wrong = _wrong(data, m)
        worst = float(m.achieved[wrong].max()) if wrong.any() else None
        gave_up = sum(word not in ("SOLVED", "INACCURATE", "LOST") for word in m.status)
        rows.append([
            m.solver, m.asked, percent(m.share(tolerance_of(data, m.asked))), int(wrong.sum()),
            None if worst is None or not np.isfinite(worst) else worst, gave_up, len(m.lost),
        ])  # fmt: skip
    columns = ("solver", "asked for", "solved", "says solved but is not", "worst of these", "gives up", "lost")
    return Table(columns, rows, "Success, solver by solver and class by class", folded=True)


def _times(found: Sequence[Measure], chosen: Sequence[Measure], mode: str) -> Table:
    reference = chosen[0].times(TARGET)
    rows: list[list[Cell]] = []
    for m in found:
        times = m.times(TARGET)
        good = np.isfinite(times)
        rest = m.total - m.build - m.solve
        times_best, common = ratio(times, reference)
        parts = [float(np.median(part[good])) if good.any() else None for part in (m.build, m.solve, rest)]
        late = int((times[good] > PERIOD).sum())
        changed = m.changed[np.isfinite(m.changed)]
        row: list[Cell] = [m.solver, m.asked, int(good.sum()), *percentiles(times), *parts, times_best, common, late]
        if mode == "warm":
            row.append(float(changed.mean()) if changed.size else None)
        rows.append(row)
    columns = ["solver", "asked for", "solved to 1e-6", "p50 [µs]", "p99 [µs]", "max [µs]", "build [µs]", "solve [µs]",
               "wrapper [µs]", f"times {chosen[0].solver}", "compared on", "over 1 ms"]  # fmt: skip
    columns += ["set changes"] if mode == "warm" else []
    note = (
        f"Time of a solve, {mode}, each solver at its best class, where its answer is good to 1e-6. Build: "
        "conversion to the back end's form; solve: the back end; wrapper: checks and certificate; medians. The "
        "ratio is the geometric mean over the problems that both solved (so many). Set changes: rows that become "
        "active or free, a tick."
    )
    if len(found) > len(chosen):
        return Table(columns, rows, "Times in every class", folded=True)
    return Table(columns, rows, note)


def _profile_figure(about: Data, chosen: Sequence[Measure]) -> Figure:
    with style.Canvas(1, 1, height=3.6) as canvas:
        axes = canvas.axes[0]
        largest = _TENFOLD
        for k, (m, ratios) in enumerate(profile(chosen)):
            finite = np.sort(ratios[np.isfinite(ratios)])
            largest = max(largest, float(finite[-1])) if finite.size else largest
            x = np.concatenate([[1.0], finite, [1e9]])
            y = 100.0 * np.concatenate([[0.0], np.arange(1, finite.size + 1), [finite.size]]) / m.count
            axes.step(x, y, where="post", label=m.name, **look(k))
        logarithmic(axes, "x")
        axes.set_xlim(1.0, 1.4 * largest)
        axes.set_ylim(0.0, 104.0)
        axes.set_xlabel("time over the fastest on the same problem")
        axes.set_ylabel("problems solved [%]")
        side_legend(axes)
        caption = (
            "Dolan-Moré profile: how many problems a solver answers to 1e-6 within so many times the time of the "
            "fastest. Left edge: how often it is the fastest; right edge: how much it solves at all. Each at its "
            "best class."
        )
        return canvas.figure(f"profile-{slug(about['name'])}", caption)


_TENFOLD = 10.0


def _pairs(chosen: Sequence[Measure]) -> Table:
    times = [m.times(TARGET) for m in chosen]
    rows: list[list[Cell]] = []
    for i, m in enumerate(chosen):
        row: list[Cell] = [m.name]
        for j, other in enumerate(times):
            won = wins(times[i], other)
            row.append("" if i == j else "–" if won is None else percent(won))
        rows.append(row)
    note = (
        "Pairs: how often the solver of the row was faster than that of the column, of the problems that at least "
        "one of the two solved; one that does not solve loses."
    )
    return Table(["faster", *(m.solver for m in chosen)], rows, note, folded=True)


def _accuracy_figure(about: Data, found: Sequence[Measure]) -> Figure:
    solvers = list(dict.fromkeys(m.solver for m in found))
    classes = list(dict.fromkeys(m.asked for m in found))
    with style.Canvas(1, 3, height=0.9 + 0.30 * len(solvers)) as canvas:
        for axes, (part, title) in zip(canvas.axes, _RESIDUALS, strict=True):
            for m in found:
                y = solvers.index(m.solver) + 0.19 * (classes.index(m.asked) - 0.5 * (len(classes) - 1))
                _bar(axes, y, getattr(m, part), style.CYCLE[classes.index(m.asked)])
            logarithmic(axes, "x")
            axes.set_xlim(1e-17, 1e3)
            axes.set_xticks([1e-15, 1e-9, 1e-3])
            axes.set_ylim(len(solvers) - 0.4, -0.6)
            axes.set_title(title)
            axes.set_yticks(range(len(solvers)), solvers if part == "primal" else [""] * len(solvers))
            style.bound(axes, TARGET, vertical=True)
        for asked in classes:
            canvas.axes[0].plot([], [], color=style.CYCLE[classes.index(asked)], linewidth=3, label=asked)
        canvas.drawing.legend(loc="outside lower center", ncols=len(classes))
        caption = (
            "Residuals of the answers: from the 5th to the 95th percentile, a dot at the median, a cross at the "
            "largest; nothing where there is no answer. Dashed: 1e-6. Colours: what was asked for."
        )
        return canvas.figure(f"accuracy-{slug(about['name'])}", caption)


_RESIDUALS = (("primal", "primal"), ("dual", "dual, relative"), ("gap", "gap, relative"))


def _bar(axes: Axes, y: float, values: Vec, colour: str) -> None:
    finite = np.maximum(values[np.isfinite(values)], 1e-17)
    if finite.size:
        low, middle, high = np.percentile(finite, [5, 50, 95])
        axes.plot([low, high], [y, y], color=colour, linewidth=2.2, alpha=0.55)
        axes.plot(middle, y, marker="o", markersize=3, color=colour)
        axes.plot(finite.max(), y, marker="x", markersize=3.5, color=colour)


def _achieved(found: Sequence[Measure]) -> Table:
    levels = (1e-3, 1e-6, 1e-9)
    rows = [[m.solver, m.asked, *(percent(m.share(level)) for level in levels)] for m in found]
    columns = ("solver", "asked for", *(f"reached {short(level)}" for level in levels))
    return Table(columns, rows, "What was reached, whatever was asked for: share of all problems.", folded=True)


def _residuals(found: Sequence[Measure]) -> Table:
    rows: list[list[Cell]] = []
    for m in found:
        row: list[Cell] = [m.solver, m.asked]
        for part, _ in _RESIDUALS:
            values = getattr(m, part)
            finite = values[np.isfinite(values)]
            row += [float(np.median(finite)), float(finite.max())] if finite.size else [None, None]
        rows.append(row)
    columns = ["solver", "asked for", *(f"{part}, {what}" for part, _ in _RESIDUALS for what in ("median", "max"))]
    return Table(columns, rows, "Residuals of all answers, good or not.", folded=True)


def _violations(chosen: Sequence[Measure], found: Sequence[Measure]) -> list[Table]:
    """The largest violation by unit, where rows have units."""
    units = [unit for unit in dict.fromkeys(u for m in found for u in m.violation) if unit]
    if not units:
        return []
    note = (
        "The largest violation of a row or bound by unit, over all answers, good or not, of each solver's best class."
    )
    columns = ("solver", "asked for", *(f"[{unit}]" for unit in units))
    return [
        Table(columns, [_violation_row(m, units) for m in chosen], note),
        Table(columns, [_violation_row(m, units) for m in found], "Violations in every class", folded=True),
    ]


def _violation_row(m: Measure, units: Sequence[str]) -> list[Cell]:
    row: list[Cell] = [m.solver, m.asked]
    for unit in units:
        values = m.violation.get(unit, np.full(1, np.nan))
        finite = values[np.isfinite(values)]
        row.append(float(finite.max()) if finite.size else None)
    return row


def _cold_against_warm(data: Data, about: Data, chosen: Sequence[Measure]) -> Table:
    cold = {(m.solver, m.asked): m for m in measures(data, about["name"], "cold")}
    rows: list[list[Cell]] = []
    for m in chosen:
        other = cold[m.solver, m.asked]
        p50, p99, top = percentiles(other.times(TARGET))
        warm = percentiles(m.times(TARGET))[0]
        rows.append([m.name, percent(other.share(TARGET)), p50, p99, top, None if not p50 or not warm else p50 / warm])
    columns = ("solver", "solved to 1e-6", "p50 [µs]", "p99 [µs]", "max [µs]", "median over warm")
    return Table(columns, rows, "The same problems cold: each in a session of its own, making it included.")
