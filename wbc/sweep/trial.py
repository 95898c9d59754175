"""One run of a sweep, wherever it is done: a trial goes in, a line of figures comes out."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from typing import Any, final

from wbc import checks
from wbc.errors import InvalidInput, WbcError
from wbc.report import measure
from wbc.report.record import demands, outline, plain
from wbc.sim.disturbance import Disturbance, Effect
from wbc.sim.joining import joined
from wbc.sim.plant import Plant
from wbc.sim.scenario import RELATIONS, Parameters, ScenarioResult, Settings, find
from wbc.sweep.draw import axes
from wbc.sweep.plan import Trial

_TEXT, _OBJECT, _ANSWER = (str, "text"), (Mapping, "an object"), (bool, "true or false")
_NUMBER = (int | float | None, "a number")
#: What is kept of each demand, and of which kind it is.
_OF_DEMANDS: Mapping[str, tuple[Any, str]] = {
    "demand": _TEXT, "value": _NUMBER, "relation": _TEXT, "bound": _NUMBER, "unit": _TEXT, "ok": _ANSWER,
}  # fmt: skip
#: Of which kind the parts of a result are that its report reads.
_KINDS: Mapping[str, tuple[Any, str]] = {
    "run": (int, "a whole number"), "ok": _ANSWER, "error": (str | None, "text"), "parameters": _OBJECT,
    "axes": _OBJECT, "units": _OBJECT, "figures": _OBJECT, "tracking": _OBJECT, "violations": _OBJECT,
    "demands": (list, "a list"), "tick_us": (list, "a list"),
}  # fmt: skip


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
        "demands": [{key: d[key] for key in _OF_DEMANDS} for d in plain(demands(result))],
        "units": {task: next(iter(measure.errors(run, task)), "") for task in measure.tasks(run)},
        "figures": {key: plain(x) for key, x in result.figures.items() if isinstance(x, bool | int | float | str)},
    }


def check_result(where: str, result: Mapping[str, Any]) -> None:
    """Refuse a result read from a file whose parts are not of the kinds that :func:`done` gives.

    Raises:
        InvalidInput: by its name, in the line ``where``.
    """
    for name, (kind, what) in _KINDS.items():
        if name in result:
            checks.instance(f"{where}: {name}", result[name], kind, what)
    for k, demand in enumerate(result.get("demands", ())):
        place = f"{where}: demands[{k}]"
        for key, (kind, what) in _OF_DEMANDS.items():
            found = checks.instance(place, demand, Mapping, "an object").get(key)
            checks.instance(f"{place}: {key}", found, kind, what)
        checks.one_of(f"{place}: relation", demand["relation"], RELATIONS)
    for name, pair in (result.get("violations") or {}).items():
        if len(checks.items(f"{where}: violations[{name!r}]", pair, "numbers")) != 2:
            raise InvalidInput(
                f"{where}: violations[{name!r}] is {checks.shown(pair)}; it must be a number and its unit"
            )


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
