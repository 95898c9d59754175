"""One run of a sweep, wherever it is done: a trial goes in, a line of figures comes out."""

from __future__ import annotations

from contextlib import redirect_stdout
from sys import stderr
from typing import Any

import numpy as np

from wbc.errors import WbcError
from wbc.report import measure
from wbc.sim.joining import joined
from wbc.sim.scenario import find, silent
from wbc.sweep.plan import Trial


def done(trial: Trial) -> dict[str, Any]:
    """Run it. Whatever goes wrong in a run is its result, not the end of the sweep."""
    about = {
        "run": trial.run,
        "parameters": {key: _plain(value) for key, value in trial.parameters.items()},
        "solver": trial.solver,
        "hierarchy": trial.settings["hierarchy"],
        "disturbances": [str(one) for one in trial.disturbances],
    }
    parameters = dict(trial.parameters)
    try:
        scenario = find(trial.scenario)
        parameters = {key: _as(scenario.parameters[key], value) for key, value in parameters.items()}
        with joined(disturbances=trial.disturbances), redirect_stdout(stderr):
            result = scenario.run(parameters, solver=trial.solver, progress=silent, **trial.settings)
    except WbcError as refusal:
        return {**about, "ok": False, "error": str(refusal)}
    except Exception as bug:  # a scenario's own, of any kind: one line of a thousand
        return {**about, "ok": False, "error": f"{type(bug).__name__}: {bug}"}
    run = result.run
    return {
        **about,
        "ok": bool(result.ok),
        "error": None,
        "failed": [check.text for check in result.verdict if not check.ok],
        "ended": str(run.meta.get("ended", "complete")),
        "seconds": _plain(measure.seconds(run)) if "dt" in run.meta else None,
        "unsolved": run.rows - measure.statuses(run).get("SOLVED", 0) if "statuses" in run.meta else None,
        "tracking": {task: _plain(value["rms"]) for task, value in result.tracking.items()},
        "violations": {kind: [_plain(worst), unit] for kind, (worst, unit) in result.violations.items()},
        "figures": {key: _plain(x) for key, x in result.figures.items() if isinstance(x, bool | int | float | str)},
        "tick_us": [_plain(x) for x in measure.tick_times(run)] if "tick_us" in run else None,
    }


def _as(default: Any, value: Any) -> Any:
    """A number for a parameter that is text, such as a force that may be "auto"."""
    return str(value) if isinstance(default, str) else value


def _plain(value: Any) -> Any:
    """In json's types, nine digits, nothing that is not finite."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return float(f"{value:.9g}") if np.isfinite(value) else None
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value
