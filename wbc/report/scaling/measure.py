"""Measuring: the tick of a controller at each size, in the form that is chosen for it and in standard form."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.control.controller import Controller
from wbc.control.recorder import Run
from wbc.errors import InvalidInput
from wbc.qp.lexicographic import Pull
from wbc.qp.rows import RowProblem, RowSolver, RowTask
from wbc.qp.rows.standard import StandardSolver
from wbc.qp.solver import Solver
from wbc.report import measure
from wbc.sim.bench import least
from wbc.sim.scenario import Progress, Scenario, Setup, silent
from wbc.stack.hierarchy import Hierarchy, Rank, Weighted

#: The first ticks find cold memory, and no active set.
WARM_UP = 10


@final
@dataclass(frozen=True)
class InStandardForm(Hierarchy):
    """The weighted QP with its products made, whatever form would be chosen: what the chosen form is measured by."""

    def ranks(self, levels: Sequence[Sequence[RowTask]]) -> list[Rank]:
        return Weighted().ranks(levels)

    def open(
        self, problem: RowProblem, solver: Solver, pulls: Sequence[Pull | None] = (), *, may_break: bool = False
    ) -> RowSolver:
        return StandardSolver(problem, solver)


def scaled(
    chosen: Iterable[Scenario], *, ticks: int = 100, repeats: int = 5, solver: str = "pdas", progress: Progress = silent
) -> list[dict[str, Any]]:
    """Measure scenarios along their ``sizes``: one row for each size and form, in json's types.

    The plant of each ticks ``ticks`` times through each controller, ``repeats`` times, the controllers of a size in
    turns; the least time of each tick counts, and the median over the ticks.

    Raises:
        InvalidInput: ``ticks`` or ``repeats`` below 1, or a scenario without sizes.
        UnknownSolver, SolverMissing, NotSupported: a solver that cannot do it.
    """
    checks.number("ticks", ticks, low=1)
    checks.number("repeats", repeats, low=1)
    chosen = list(chosen)
    for scenario in chosen:
        if not scenario.sizes:
            raise InvalidInput(f"the scenario {scenario.name!r} has no sizes along which it grows")
    sizes = [(scenario, size) for scenario in chosen for size in scenario.sizes]
    rows: list[dict[str, Any]] = []
    for k, (scenario, size) in enumerate(sizes):
        progress(k / len(sizes), f"ticks with {size} {scenario.name}")
        setup = scenario.first_setup(scenario.complete_parameters({"size": size}, solver=solver))
        rows += [{"axis": scenario.name, "size": size, **row} for row in _measured(setup, ticks, repeats, solver)]
    progress(1.0, "ticks measured")
    return rows


def _measured(setup: Setup, ticks: int, repeats: int, solver: str) -> list[dict[str, Any]]:
    kinds: Mapping[str, Hierarchy] = {"chosen": Weighted(), "standard": InStandardForm()}
    setups = {kind: replace(setup, hierarchy=hierarchy) for kind, hierarchy in kinds.items()}
    controllers = {kind: one.controller(solver) for kind, one in setups.items()}
    runs: dict[str, list[Run]] = {kind: [] for kind in kinds}
    plant, duration = setup.plant, (ticks + WARM_UP) * setup.plant.dt
    q, v = plant.q, plant.v
    for _ in range(repeats):
        for kind, controller in controllers.items():
            plant.reset(q, v)
            trial = setups[kind].run(duration=duration, controller=controller, recorder=False)
            runs[kind].append(trial.run)
    return [_row(kind, controllers[kind], runs[kind]) for kind in kinds]


def _row(kind: str, controller: Controller, runs: Sequence[Run]) -> dict[str, Any]:
    found = least([run["tick_us"] for run in runs], WARM_UP)
    qp = controller.qp
    return {
        "kind": kind,
        "form": controller.form,
        "tick_us": _plain(float(np.median(found))),
        "p99_us": _plain(float(np.percentile(found, 99))),
        "variables": qp.shape.n,
        "equalities": qp.shape.n_eq,
        "rows": qp.shape.n_in,
        "active": int(controller.active_count),
        "guessed": _plain(controller.counts.first / max(controller.counts.total, 1)),
        "solved": all(bool(measure.solved(run).all()) for run in runs),
    }


def _plain(value: float) -> float | None:
    return round(value, 2) if isfinite(value) else None
