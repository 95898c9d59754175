"""The section of what happens in the loop: the robot under each solver."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from wbc.report.document import Cell, Item, Marked, Section, Table, Text, percent
from wbc.report.solvers.data import Data


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
    without = list(dict.fromkeys(loop["solver"] for loop in loops if loop["error"] is not None))
    helped = list(dict.fromkeys(loop["solver"] for loop in ran if loop["helped"]))
    bad = [f"{loop['solver']} at {loop['class']}" for loop in ran if not loop["ok"]]
    words = [f"{name}: {len(good)} of {len(ran)} runs met every demand of the scenario"]
    words += [f"not met by {', '.join(bad)}"] if bad else []
    words += [f"another solver had to solve ticks of {', '.join(helped)}"] if helped else []
    words += [f"no run with {', '.join(without)} (reasons below)"] if without else []
    return "; ".join(words) + "."


def _tables(loops: Sequence[Data]) -> Iterator[Table]:
    ran = [loop for loop in loops if loop["error"] is None]
    tasks = list(dict.fromkeys(task for loop in ran for task in loop["tracking"]))
    kinds = list(dict.fromkeys(kind for loop in ran for kind in loop["violations"]))
    units = {kind: loop["violations"][kind][1] for loop in ran for kind in loop["violations"]}
    jerks = _least(loop["jerk"] for loop in ran)
    order = list(dict.fromkeys(loop["solver"] for loop in ran))
    ran = sorted(ran, key=lambda loop: order.index(loop["solver"]))  # the sort is stable: classes stay in order
    rows: list[list[Cell]] = []
    for loop in ran:
        rows.append([
            loop["solver"], loop["class"], loop["ok"], _share(loop), _helped(loop), _worst_tracking(loop, ran, tasks),
            _over(loop["jerk"], jerks), *loop["tick_us"],
            Marked(str(loop["late"]), "bad") if loop["late"] else 0,
        ])  # fmt: skip
    columns = ("solver", "requested", "verdict", "ticks solved", "by another", "tracking", "jerk",
               "tick p50 [µs]", "p99 [µs]", "max [µs]", "late ticks")  # fmt: skip
    note = (
        "By another: ticks that the solver failed and the controller's fallback solved. Tracking: largest ratio of a "
        "task's rms error to the smallest of all runs. Jerk: rms change of the commanded joint acceleration, over the "
        "smallest of all runs. Late: ticks longer than the period. Each solver ran once, so the largest tick time may "
        "be the machine's."
    )
    if rows:
        yield Table(columns, [row for row in rows if row[1] == ran[0]["class"]], note)
        yield Table(columns, rows, "All classes", folded=True)
        detail: list[list[Cell]] = [
            [loop["solver"], loop["class"], *(_violation(loop, kind) for kind in kinds), loop["jerk"],
             *(loop["tracking"].get(task) for task in tasks), loop["ended"]]
            for loop in ran
        ]  # fmt: skip
        heads = [f"{kind} [{units[kind]}]" for kind in kinds]
        details = ("solver", "requested", *heads, "jerk [rad/s³ or m/s³]",
                   *(f"{task}, rms" for task in tasks), "ended")  # fmt: skip
        yield Table(details, detail, "Largest violations of limits, smoothness and tracking", folded=True)
    failed = [[loop["solver"], loop["class"], loop["error"]] for loop in loops if loop["error"] is not None]
    if failed:
        yield Table(("solver", "requested", "reason"), failed, "Runs that did not begin or did not end", folded=True)


def _share(loop: Data) -> str:
    return "–" if loop["solved"] is None or not loop["ticks"] else percent(loop["solved"] / loop["ticks"])


def _helped(loop: Data) -> Cell:
    return Marked(percent(loop["helped"]), "bad") if loop["helped"] else "0 %"


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
