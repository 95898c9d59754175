"""Measuring: the tick of a controller at each size, in the form that is chosen for it and in standard form."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from time import perf_counter_ns
from typing import Any, final

import numpy as np
from threadpoolctl import threadpool_limits

from wbc import checks
from wbc.control.controller import Controller
from wbc.qp.rows import RowProblem, RowSolver, RowTask
from wbc.qp.rows.standard import StandardSolver
from wbc.qp.solver import Solver
from wbc.report.scaling.axis import Axis, Problem
from wbc.sim.scenario import Progress, silent
from wbc.stack.hierarchy import Hierarchy, Pulls, Rank, Weighted
from wbc.types import Vec

#: The first ticks find cold memory, and no active set.
WARM_UP = 10


@final
@dataclass(frozen=True)
class InStandardForm(Hierarchy):
    """The weighted QP with its products made, whatever form would be chosen: what the chosen form is measured by."""

    def ranks(self, levels: Sequence[Sequence[RowTask]]) -> list[Rank]:
        return Weighted().ranks(levels)

    def open(self, problem: RowProblem, solver: Solver, pulls: Pulls | None = None) -> RowSolver:
        return StandardSolver(problem, solver)


def scaled(
    chosen: Iterable[Axis], *, ticks: int = 100, repeats: int = 5, solver: str = "pdas", progress: Progress = silent
) -> list[dict[str, Any]]:
    """Measure the axes: one row for each size and form, in json's types.

    The same ``ticks`` states go through each controller ``repeats`` times, the controllers of a size in turns; the
    least time of each tick counts, and the median over the ticks.

    Raises:
        InvalidInput: ``ticks`` or ``repeats`` below 1.
        UnknownSolver, SolverMissing, NotSupported: a solver that cannot do it.
    """
    checks.number("ticks", ticks, low=1)
    checks.number("repeats", repeats, low=1)
    chosen = list(chosen)
    rows: list[dict[str, Any]] = []
    total = 2 * sum(len(axis.sizes) for axis in chosen)
    for axis in chosen:
        for size in axis.sizes:
            progress(len(rows) / total, f"ticks with {size} {axis.name}")
            rows += [
                {"axis": axis.name, "size": size, **row}
                for row in _measured(axis.problem(size), ticks, repeats, solver)
            ]
    progress(1.0, "ticks measured")
    return rows


def _measured(problem: Problem, ticks: int, repeats: int, solver: str) -> list[dict[str, Any]]:
    states = list(problem.states(ticks + WARM_UP))
    kinds: Mapping[str, Hierarchy] = {"chosen": Weighted(), "standard": InStandardForm()}
    controllers = {
        kind: Controller(problem.robot, problem.stack, level=problem.level, hierarchy=hierarchy, solver=solver)
        for kind, hierarchy in kinds.items()
    }
    times: dict[str, list[Vec]] = {kind: [] for kind in kinds}
    with threadpool_limits(1):
        for _ in range(repeats):
            for kind, controller in controllers.items():
                controller.reset()
                times[kind].append(_once(controller, states))
    return [_row(kind, controllers[kind], times[kind]) for kind in kinds]


def _once(controller: Controller, states: list[tuple[float, Vec, Vec]]) -> Vec:
    """Time of each tick [µs]."""
    found = np.empty(len(states))
    for k, (t, q, v) in enumerate(states):
        start = perf_counter_ns()
        controller.tick(t, q, v)
        found[k] = perf_counter_ns() - start
    return found / 1e3


def _row(kind: str, controller: Controller, times: list[Vec]) -> dict[str, Any]:
    least = np.min(times, axis=0)[WARM_UP:]
    qp = controller.qp
    return {
        "kind": kind,
        "form": controller.form,
        "tick_us": _plain(float(np.median(least))),
        "p99_us": _plain(float(np.percentile(least, 99))),
        "variables": qp.shape.n,
        "equalities": qp.shape.n_eq,
        "rows": qp.shape.n_in,
        "active": int(controller.active_count),
        "guessed": _plain(controller.counts.first / max(controller.counts.total, 1)),
        "solved": bool(controller.status.ok),
    }


def _plain(value: float) -> float | None:
    return round(value, 2) if isfinite(value) else None
