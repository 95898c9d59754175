"""One run of a sweep, wherever it is done: a trial goes in, a line of figures comes out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any, final

from wbc.errors import WbcError
from wbc.report import measure
from wbc.report.record import demands, outline, plain
from wbc.sim.disturbance import Disturbance, Effect
from wbc.sim.joining import joined
from wbc.sim.plant import Plant
from wbc.sim.scenario import Parameters, ScenarioResult, Settings, find
from wbc.sweep.draw import axes
from wbc.sweep.plan import Trial

#: What is kept of each demand.
_DEMAND = ("demand", "value", "relation", "bound", "unit", "ok")


def done(trial: Trial, keep: Callable[[ScenarioResult], object] | None = None) -> dict[str, Any]:
    """Run it; ``keep`` is given what the scenario hands back. Whatever goes wrong in a run is its result, not the end
    of the sweep."""
    about = {
        "run": trial.run,
        "parameters": {key: plain(value) for key, value in trial.parameters.items()},
        "solver": trial.solver,
        "hierarchy": trial.settings["hierarchy"],
        "disturbances": [str(one) for one in trial.disturbances],
        "axes": {key: plain(value) for key, value in axes(trial.disturbances).items()},
    }
    try:
        result = _run(trial)
    except WbcError as refusal:
        return {**about, "ok": False, "error": str(refusal)}
    except Exception as bug:  # a scenario's own, of any kind: one line of a thousand
        return {**about, "ok": False, "error": f"{type(bug).__name__}: {bug}"}
    if keep is not None:
        keep(result)
    run = result.run
    return {
        **about,
        **outline(result),
        "demands": [{key: d[key] for key in _DEMAND} for d in plain(demands(result))],
        "units": {task: next(iter(measure.errors(run, task)), "") for task in measure.tasks(run)},
        "figures": {key: plain(x) for key, x in result.figures.items() if isinstance(x, bool | int | float | str)},
    }


def refusal(trial: Trial) -> WbcError | None:
    """Why the run would be refused before its first tick, or None. It goes as far as that, and simulates nothing."""
    try:
        if find(trial.scenario).cases(Parameters(trial.parameters, Settings(**trial.settings))):
            _run(trial, _Stop())
    except WbcError as cause:
        return cause
    except Exception:  # where it stops, or a bug, which is the result of the run
        pass
    return None


class _Stopped(Exception):
    """A run is ready for its first tick."""


@final
class _Stop(Disturbance):
    """Joins a run last, and ends it when it begins."""

    def begin(self, plant: Plant) -> Effect:
        raise _Stopped

    def __str__(self) -> str:
        return "stop at the start"


def _run(trial: Trial, *more: Disturbance) -> ScenarioResult:
    scenario = find(trial.scenario)
    parameters = {key: _as(scenario.parameters[key], value) for key, value in trial.parameters.items()}
    with joined(disturbances=[*trial.disturbances, *more]), redirect_stdout(sys.stderr):
        return scenario.run(parameters, Settings(**trial.settings, solver=trial.solver))


def _as(default: Any, value: Any) -> Any:
    """A number for a parameter that is text, such as a force that may be "auto"."""
    return str(value) if isinstance(default, str) else value
