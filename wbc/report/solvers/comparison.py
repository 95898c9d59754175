"""Comparing: from what a user names to a folder with the page, its tables and the raw data."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from wbc.arguments import tells_arguments
from wbc.errors import InvalidInput
from wbc.files import made_folder, slug
from wbc.qp.problem import QP
from wbc.qp.solver import Solver
from wbc.qp.solvers import by_name, usable
from wbc.report.document import Report
from wbc.report.folder import DATA, replaced
from wbc.report.folder import write as write_report
from wbc.report.journal import Journal, fresh, taken_up
from wbc.report.solvers import data as raw
from wbc.report.solvers.appendix import FAILURES, failed, failure_file
from wbc.report.solvers.data import Data
from wbc.report.solvers.engine import work
from wbc.report.solvers.page import page
from wbc.report.solvers.problems import ProblemSet, from_folder, sequence
from wbc.report.solvers.recording import QpRecorder, growing, record
from wbc.report.solvers.request import Request, ScenarioRequest
from wbc.sim.provenance import surroundings, versions
from wbc.sim.scenario import Progress, Scenario, find, silent
from wbc.sim.scenario import scenarios as registered_scenarios

PROBLEMS = "problems"
_JOURNAL = "journal.jsonl"


@tells_arguments
def compare(
    run: Any,
    *,
    solvers: Iterable[str | Solver] | None = None,
    out: str | Path | None = None,
    settings: Sequence[str] = (),
    plant: str | None = None,
    hierarchy: str | None = None,
    duration: float | None = None,
    progress: Progress = silent,
    **options: Any,
) -> Data:
    """Compare solvers on a scenario, on recorded QPs or on a folder of QPs or a file; several in a list stay apart.

    Args:
        run: a :class:`~wbc.report.solvers.recording.QpRecorder`, a list of QPs, a problem set, a scenario or its
            name, or a folder of .npz files; or a list of such things.
        solvers: names or settings; all usable ones by default. Each works in a process of its own, so a class of
            one's own must be importable by name there.
        out: a folder for ``report.html``, ``report.md`` and ``data.json``; nothing is written without.
        settings: parameters of the scenarios, "key=value"; ``plant``, ``hierarchy``, ``duration`` likewise.
        progress: called with the progress.
        options: fields of :class:`~wbc.report.solvers.request.Request`: classes, rounds, limit, patience, ticks,
            loop, torture, growth.

    Returns:
        The raw data; :func:`wbc.report.solvers.page.page` makes the report of them.

    Raises:
        InvalidInput: nothing to compare, or a place that cannot be written.
        UnknownSolver, SolverMissing, UnknownScenario: an unknown name, or a package that is missing.

    Example:
        >>> import wbc
        >>> from wbc.report import compare
        >>> qps = [wbc.QP([[2.0]], [-2.0 * k], ub=[1.0]) for k in range(3)]
        >>> data = compare(qps, solvers=["pdas"], torture=False, growth=False, rounds=1)
        >>> [m["status"] for m in data["measures"] if m["class"] == "default"]
        [['SOLVED', 'SOLVED', 'SOLVED'], ['SOLVED', 'SOLVED', 'SOLVED']]
    """
    chosen = [by_name(solver) for solver in (usable() if solvers is None else solvers)]
    if not chosen:
        raise InvalidInput("there is no solver to compare")
    choices = {"plant": plant, "hierarchy": hierarchy, "duration": duration}
    place = None if out is None else Path(out)
    folder = None if place is None else fresh(place, _JOURNAL, "comparison", DATA)
    sources = _listed(run)
    if not sources and not (options.get("torture") or options.get("growth")):
        raise InvalidInput("there is nothing to compare solvers on; give QPs, a scenario or a folder")
    _refuse_stray(settings, sources)
    collected = _collected(sources, settings, choices, Request(chosen, **options), progress)
    with TemporaryDirectory(prefix="wbc-compare-") if folder is None else nullcontext(folder) as name:
        work_in = made_folder(name)
        return _finished(_begun(collected, Request(chosen, **options), work_in), work_in, place, progress)


def resume(out: str | Path, *, trusted: Sequence[str | Solver] = (), progress: Progress = silent) -> Data:
    """Take up a comparison that was interrupted; its journal holds the request, as plain JSON.

    The journal may come from someone else. Code that it names is executed only if the user names it too: ``trusted``
    lists scenarios given as ``file.py:name`` or ``module:name``, and solvers of one's own.

    Raises:
        InvalidInput: no unfinished comparison there, other versions of the packages are installed now, or code that
            ``trusted`` does not name.
    """
    journal = taken_up(Path(out), _JOURNAL, "comparison")
    header = Journal(journal, "key").header
    now = versions()
    try:
        begun = dict(header["surroundings"]["versions"])
    except (KeyError, TypeError, ValueError) as cause:
        raise InvalidInput(f"{journal} is not the journal of a comparison: {cause!r}") from cause
    changed = [name for name, version in begun.items() if now.get(name) != version]
    if changed:
        raise InvalidInput(f"{journal.parent} was begun with other versions of {', '.join(changed)}; start anew")
    return _finished(Request.from_json(header.get("request"), trusted=trusted), journal.parent, Path(out), progress)


def redraw(source: Path, out: Path) -> Report:
    """Write the page and its tables once more from ``data.json`` (or the folder it is in): the same bits.

    Raises:
        InvalidInput: no such data.
    """
    file = source / DATA if source.is_dir() else source
    data = raw.read(file)
    text = file.read_bytes()
    with replaced(out, DATA) as pending:
        try:
            report = page(data)
            write_report(report, pending)
        except (KeyError, IndexError, TypeError, ValueError, AttributeError) as cause:
            raise InvalidInput(f"{file} does not hold the data of a comparison: {cause!r}") from cause
        (pending / DATA).write_bytes(text)
        for name in (PROBLEMS, FAILURES):  # of which the page speaks
            if (file.parent / name).is_dir():
                shutil.copytree(file.parent / name, pending / name)
    return report


def _listed(run: Any) -> list[Any]:
    """``run`` as a list of sources; a list of QPs is one source."""
    if isinstance(run, Sequence) and not isinstance(run, str) and not (run and isinstance(run[0], QP)):
        return list(run)
    return [run]


class _Collected(NamedTuple):
    """What was found to compare on: sets of problems, the scenarios among them, and what could not be read."""

    sets: list[ProblemSet]
    scenarios: list[ScenarioRequest]
    unread: dict[str, str]


def _collected(
    sources: Sequence[Any], settings: Sequence[str], choices: Mapping[str, Any], request: Request, progress: Progress
) -> _Collected:
    """Record and read all problems."""
    sets: list[ProblemSet] = []
    scenarios: list[ScenarioRequest] = []
    unread: dict[str, str] = {}
    for k, source in enumerate(sources):
        progress(0.0, f"collecting problems: {source if isinstance(source, str | Path) else 'given'}")
        if _is_place(source):
            found = from_folder(Path(source))
            sets += found.sets
            unread |= found.unread
        elif isinstance(source, str | Scenario):
            scenario = source if isinstance(source, Scenario) else find(source)
            asked = _asked(source, scenario, settings, choices)
            sets.append(record(scenario, asked.parameters, asked.settings, count=request.ticks))
            scenarios.append(asked)
        else:
            sets.append(_given(source, f"problems {k + 1}" if len(sources) > 1 else "problems"))
    if request.growth:
        sets += [growing(scenario) for scenario in registered_scenarios("growth").values()]
    names = [one.name for one in sets]
    if len(set(names)) < len(names):
        raise InvalidInput(f"two sets of problems have the same name: {', '.join(names)}")
    return _Collected(sets, scenarios, unread)


def _begun(collected: _Collected, request: Request, folder: Path) -> Request:
    """Write the problems down and begin the journal; the complete request."""
    (folder / PROBLEMS).mkdir(exist_ok=True)
    files = {found.name: f"{PROBLEMS}/{slug(found.name)}.npz" for found in collected.sets}
    for found in collected.sets:
        found.save(folder / files[found.name])
    request = replace(request, scenarios=collected.scenarios, files=files)
    header = {
        "surroundings": surroundings(),
        "request": request.to_json(),
        "unread": collected.unread,
    }
    Journal.begin(folder / _JOURNAL, "key", header)
    return request


def _asked(
    source: str | Scenario, scenario: Scenario, settings: Sequence[str], choices: Mapping[str, Any]
) -> ScenarioRequest:
    kind = type(scenario)
    text = source if isinstance(source, str) else f"{kind.__module__}:{kind.__qualname__}"
    own = [setting for setting in settings if setting.partition("=")[0] in scenario.parameters]
    chosen = scenario.choose(plant=choices["plant"], hierarchy=choices["hierarchy"], duration=choices["duration"])
    return ScenarioRequest(text, scenario.name, scenario.parse(own), chosen)


def _refuse_stray(settings: Sequence[str], sources: Sequence[Any]) -> None:
    """A parameter must belong to one of the scenarios, a misspelt one to none."""
    scenarios = [find(s) if isinstance(s, str) else s for s in sources if not _is_place(s)]
    scenarios = [s for s in scenarios if isinstance(s, Scenario)]
    for setting in settings:
        if not scenarios:
            raise InvalidInput(f"{setting!r} is a parameter of a scenario, and there is none")
        if not any(setting.partition("=")[0] in s.parameters for s in scenarios):
            scenarios[0].parse([setting])


def _is_place(source: Any) -> bool:
    """Whether ``source`` is a folder of QPs or one of its files."""
    return isinstance(source, str | Path) and (Path(source).is_dir() or Path(source).suffix == ".npz")


def _given(source: Any, name: str) -> ProblemSet:
    if isinstance(source, ProblemSet):
        return source
    if isinstance(source, QpRecorder):
        return source.problems(name)
    if isinstance(source, Sequence) and all(isinstance(qp, QP) for qp in source):
        return sequence(name, source)
    raise InvalidInput(
        f"{source!r} is nothing to compare solvers on; give a scenario or its name, a folder of QPs, a list of QPs, "
        "or a QpRecorder that joined a simulation"
    )


def _finished(request: Request, folder: Path, out: Path | None, progress: Progress) -> Data:
    """Do what is left, and write everything down."""
    journal = Journal(folder / _JOURNAL, "key")
    work(request, folder, journal, progress)
    sets = {name: ProblemSet.load(folder / file) for name, file in request.files.items()}
    data = raw.gathered(request, sets, journal, journal.header["unread"])
    if out is None:
        return data
    progress(1.0, "drawing the report")
    with replaced(out, DATA) as pending:
        raw.write(data, pending / DATA)
        write_report(page(raw.read(pending / DATA)), pending)
        shutil.copytree(folder / PROBLEMS, pending / PROBLEMS)
        _save_failures(data, sets, pending)
    shutil.rmtree(folder)
    return data


def _save_failures(data: Data, sets: Mapping[str, ProblemSet], pending: Path) -> None:
    (pending / FAILURES).mkdir()
    for name, index in {(name, index) for name, index, _, _ in failed(data)}:
        sets[name].qps[index].save(pending / failure_file(name, index))
