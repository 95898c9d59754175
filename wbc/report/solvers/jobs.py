"""Jobs: the steps of a comparison, in an order that spreads every disturbance of the machine over all solvers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from wbc.report.solvers.problems import ProblemSet
from wbc.report.solvers.request import Request
from wbc.report.solvers.torture import CASES

#: Sequences whose first round took longer than this are not timed again, neither is a problem of a file [µs].
TIMED_ONCE = {"stretch": 1e6, "problem": 2e4}
#: Of a scenario in a loop.
TICKS_A_SECOND = 1000.0
#: The one class in which problems of growing size are solved.
GROWTH_CLASS = "1e-6"


Key = tuple[str | int | None, ...]


class Job(NamedTuple):
    """One order to one solver. ``key`` names it in the journal; ``weight`` is about how many solves it takes."""

    solver: str
    key: Key
    order: dict[str, Any]
    items: Sequence[int] = ()
    weight: float = 1.0


def jobs(request: Request, sets: Mapping[str, ProblemSet]) -> Iterator[Job]:
    """All jobs. Solvers take turns in the innermost loop; the rounds are the outermost one of each set."""
    for found in sets.values():
        yield from _solves(request, found)
    if request.torture:
        yield from _torture(request)
    for k, scenario in enumerate(request.scenarios if request.loop else ()):
        about = {"scenario": scenario.text, "parameters": scenario.parameters, "settings": scenario.settings}
        for name, tolerance in request.classes.items():
            for solver in request.solvers:
                order = {"do": "loop", "tolerance": tolerance, **about}
                ticks = TICKS_A_SECOND * float(scenario.settings["duration"])
                yield Job(solver.name, ("loop", scenario.name, solver.name, name, k), order, weight=ticks)


def _solves(request: Request, found: ProblemSet) -> Iterator[Job]:
    classes = {GROWTH_CLASS: 1e-6} if found.kind == "growth" else request.classes
    for round_ in range(request.rounds):
        for c, (start, end) in enumerate(found.stretches):
            items = range(start, end)
            for mode in found.modes:
                for name, tolerance in classes.items():
                    for solver in request.solvers:
                        order = {"do": "solve", "file": request.files[found.name], "warm": mode == "warm"}
                        key = ("solve", found.name, solver.name, name, mode, c, round_)
                        yield Job(solver.name, key, order | {"tolerance": tolerance}, items, len(items))


def _torture(request: Request) -> Iterator[Job]:
    for case in CASES:
        for guarded in (True, False):
            for solver in request.solvers:
                how = "guarded" if guarded else "alone"
                order = {"do": "torture", "tolerance": None, "case": case, "guarded": guarded}
                yield Job(solver.name, ("torture", case, solver.name, how, None), order)
