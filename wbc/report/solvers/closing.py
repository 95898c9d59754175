"""Sections of what happens in the loop: the robot under each solver, the meaning of levels, and of weights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from wbc.report.document import Cell, Curve, Item, Marked, Plot, Section, Table, Text, percent
from wbc.report.solvers.data import Data
from wbc.report.solvers.problems import slug
from wbc.report.solvers.ranked import reached


def section(data: Data) -> Section:
    """One table a scenario: verdict, tracking, smoothness, violations, deadlines."""
    items: list[Item] = []
    for name in dict.fromkeys(loop["scenario"] for loop in data["loops"]):
        loops = [loop for loop in data["loops"] if loop["scenario"] == name]
        items += [Text(_summary(name, loops)), *_tables(loops)]
    return Section("In the closed loop", items)


def _summary(name: str, loops: Sequence[Data]) -> str:
    ran = [loop for loop in loops if loop["error"] is None]
    good = [loop for loop in ran if loop["ok"]]
    refused = list(dict.fromkeys(loop["solver"] for loop in loops if loop["error"] is not None))
    bad = [f"{loop['solver']} at {loop['class']}" for loop in ran if not loop["ok"]]
    words = [f"{name}: {len(good)} of {len(ran)} runs met every demand of the scenario"]
    words += [f"not met by {', '.join(bad)}"] if bad else []
    words += [f"{', '.join(refused)} did not run (reasons below)"] if refused else []
    return "; ".join(words) + "."


def _tables(loops: Sequence[Data]) -> Iterator[Table]:
    ran = [loop for loop in loops if loop["error"] is None]
    tasks = list(dict.fromkeys(task for loop in ran for task in loop["tracking"]))
    kinds = list(dict.fromkeys(kind for loop in ran for kind in loop["violations"]))
    units = {kind: loop["violations"][kind][1] for loop in ran for kind in loop["violations"]}
    jerks, chatters = (_least(loop[part] for loop in ran) for part in ("jerk", "chatter"))
    unit = next((loop["chatter_unit"] for loop in ran if loop["chatter_unit"]), "")
    order = list(dict.fromkeys(loop["solver"] for loop in ran))
    ran = sorted(ran, key=lambda loop: order.index(loop["solver"]))  # the sort is stable: classes stay in order
    rows: list[list[Cell]] = []
    for loop in ran:
        jerk, chatter = loop["jerk"], loop["chatter"]
        rows.append([
            loop["solver"], loop["class"], loop["ok"], _share(loop), _worst_tracking(loop, ran, tasks),
            _over(jerk, jerks), _over(chatter, chatters), *loop["tick_us"],
            Marked(str(loop["late"]), "bad") if loop["late"] else 0,
        ])  # fmt: skip
    columns = ("solver", "asked for", "verdict", "ticks solved", "tracking", "jerk", "above 30 Hz",
               "tick p50 [µs]", "p99 [µs]", "max [µs]", "late ticks")  # fmt: skip
    note = (
        "Tracking: the worst ratio of a task's rms error to the least of all runs. Jerk: rms change of commanded "
        f"joint acceleration; above 30 Hz: rms of the command{f' [{unit}]' if unit else ''} beyond what links can "
        "follow; both over the least of all runs. Late: ticks longer than the period. One run each: its maximum is "
        "the machine's too."
    )
    if rows:
        yield Table(columns, [row for row in rows if row[1] == ran[0]["class"]], note)
        yield Table(columns, rows, "The same in every class", folded=True)
        detail: list[list[Cell]] = [
            [loop["solver"], loop["class"], *(_violation(loop, kind) for kind in kinds), loop["jerk"], loop["chatter"],
             *(loop["tracking"].get(task) for task in tasks), loop["ended"]]
            for loop in ran
        ]  # fmt: skip
        heads = [f"{kind} [{units[kind]}]" for kind in kinds]
        details = ("solver", "asked for", *heads, "jerk [rad/s³]", f"above 30 Hz [{unit}]",
                   *(f"{task}, rms" for task in tasks), "ended")  # fmt: skip
        yield Table(
            details, detail, "Limits exceeded at worst after integration, smoothness and tracking.", folded=True
        )
    failed = [[loop["solver"], loop["class"], loop["error"]] for loop in loops if loop["error"] is not None]
    if failed:
        yield Table(("solver", "asked for", "why it did not run"), failed, "Runs that did not happen.", folded=True)


def _share(loop: Data) -> str:
    return "–" if loop["solved"] is None or not loop["ticks"] else percent(loop["solved"] / loop["ticks"])


def _violation(loop: Data, kind: str) -> float | None:
    found: float | None = loop["violations"].get(kind, [None])[0]
    return found


def _least(values: Iterator[float | None]) -> float | None:
    return min((value for value in values if value is not None and value > 0.0), default=None)


def _over(value: float | None, least: float | None) -> str:
    return "–" if value is None or least is None else f"{max(value / least, 0.0):.3g}×"


def _worst_tracking(loop: Data, ran: Sequence[Data], tasks: Sequence[str]) -> str:
    worst = None
    for task in tasks:
        least = _least(other["tracking"].get(task) for other in ran)
        own = loop["tracking"].get(task)
        if own is not None and least is not None:
            worst = max(worst or 0.0, own / least)
    return "–" if worst is None else f"{worst:.3g}×"


def levels(data: Data) -> Iterator[Section]:
    """Hierarchies, and weights: what the first task loses to the others, what the QP's condition pays for it."""
    found = [entry for entry in data["levels"] if "hierarchies" in entry]
    lost = [entry for entry in data["levels"] if "lost" in entry]
    items: list[Item] = []
    for entry in found:
        items += _hierarchies(entry)
    items += [Text(f"{entry['scenario']}: not measured, {entry['lost']}.") for entry in lost]
    yield Section("Hierarchies", items)
    items = []
    for entry in found:
        if len(entry["weights"]) > 1:
            items += [*_weights_plots(entry), _weights_table(entry)]
    yield Section("Weights", items)


def _hierarchies(entry: Data) -> Iterator[Item]:
    text = (
        f"{entry['scenario']}: the same {entry['ticks']} recorded states, through controllers that differ in what "
        f"the levels of the stack mean. First level: {', '.join(entry['first'])}; then: {', '.join(entry['others'])}."
    )
    yield Text(text + (" " + entry["note"] if entry["note"] else ""))
    rows: list[list[Cell]] = []
    for one in entry["hierarchies"]:
        if one.get("error"):
            rows.append([one["name"], None, None, None, None, None, None])
            continue
        rows.append([one["name"], one["solved"], *one["first"], one["others"], one["condition"], one["tick_us"]])
    columns = ("hierarchy", "ticks solved", "first level, median", "first level, max", "others, median", "condition",
               "tick [µs]")  # fmt: skip
    note = (
        "Residual of the first level |wanted − got| in the tasks' own rate units, and of all other tasks; condition "
        "number of the cost of the QP that was solved last in a tick; median tick."
    )
    yield Table(columns, rows, note)
    refused = [f"{one['name']}: {one['error']}" for one in entry["hierarchies"] if one.get("error")]
    if refused:
        yield Text("Not run: " + "; ".join(refused))


def _weights_plots(entry: Data) -> Iterator[Plot]:
    """What the first level loses to the others over its weight, and over the condition number of the cost."""
    residual = np.array([one["first"][0] or np.nan for one in entry["weights"]], dtype=np.float64)
    for key, over in (("factor", "its weight, times its own"), ("condition", "the condition number of the cost")):
        x = np.array([one[key] or np.nan for one in entry["weights"]], dtype=np.float64)
        order = [i for i in np.argsort(x) if np.isfinite(x[i])]
        curve = Curve("median residual of the first level", np.maximum(residual[order], 1e-16))
        title = f"{entry['scenario']}: residual of the first level"
        yield Plot(
            f"weights-{slug(entry['scenario'])}-{key}", title, "", x[order], [curve], over=over, log="xy", dots=True
        )


def _weights_table(entry: Data) -> Table:
    rows = [
        [f"{one['factor']:g}", one["solved"], *one["first"], one["others"], one["condition"], one["tick_us"]]
        for one in entry["weights"]
    ]
    columns = ("weight ×", "ticks solved", "first level, median", "first level, max", "others, median", "condition",
               "tick [µs]")  # fmt: skip
    return Table(columns, rows, f"{entry['scenario']}: the first level's weight multiplied.", folded=True)


def ranked(data: Data) -> Section:
    """Hierarchies from files: how many levels the core brings to the optimum, and at what time."""
    items: list[Item] = []
    for name in dict.fromkeys(entry["name"] for entry in data["ranked"]):
        entries = [entry for entry in data["ranked"] if entry["name"] == name]
        items += _ranked_table(name, entries)
    return Section("Hierarchies from files", items)


def _ranked_table(name: str, entries: Sequence[Data]) -> Iterator[Item]:
    solved = [entry["levels"] for entry in entries if entry.get("levels")]
    known = next((entry["known"] for entry in entries if entry.get("known")), None)
    if not solved and known is None:
        yield Text(f"{name}: no solver gave an answer.")
        return
    best = min([*solved, *([known] if known else [])], key=_lexicographic)
    rows: list[list[Cell]] = []
    for entry in entries:
        levels = entry.get("levels")
        if levels is None:
            rows.append(
                [entry["solver"], entry.get("lost") or entry["status"].lower(), None, None, *[None] * len(best)]
            )
            continue
        rows.append([entry["solver"], entry["status"].lower(), reached(levels, best), entry["us"], *levels])
    if known is not None:
        rows.append(["known solution", "", reached(known, best), None, *known])
    columns = ("solver", "status", "levels at the optimum", "time [µs]", *(f"level {k + 1}" for k in range(len(best))))
    note = (
        f"{name}: ½ |v|² of each level, v the distance of its rows from their bounds, the first above all others. At "
        "the optimum: as low as the best answer of all, level after level, before one is not. Least of three times, "
        "cold."
    )
    yield Table(columns, rows, note)


def _lexicographic(levels: Sequence[float]) -> tuple[float, ...]:
    """An order in which rounding decides nothing."""
    return tuple(float(f"{max(level, 1e-9):.5g}") for level in levels)
