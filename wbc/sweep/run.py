"""Running a sweep: begin or take up, stream results, write the report."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

from wbc import checks
from wbc.control.recorder import ARRAYS_FILE
from wbc.errors import InvalidInput
from wbc.files import located, made_folder
from wbc.report.document import Report
from wbc.report.folder import RESULTS, replaced
from wbc.report.folder import write as write_report
from wbc.report.journal import Journal, fresh, taken_up, unfinished
from wbc.report.record import missing, write_run
from wbc.sim.provenance import surroundings
from wbc.sim.scenario import Progress, ScenarioResult, silent
from wbc.sweep.cluster import do_all
from wbc.sweep.plan import Sweep
from wbc.sweep.summary import page_of, summary
from wbc.sweep.trial import check_result, done, refusal

_HEADER = {"scenario", "sweep", "runs", "seed", "date", "machine", "versions", "plan"}


def sweep(
    plan: Sweep,
    *,
    out: str | Path,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Progress = silent,
) -> Report:
    """Do all runs of a sweep and write ``results.jsonl``, ``report.html`` and ``report.md`` into the folder ``out``.

    Results stand in the folder ``OUT.unfinished`` as soon as they are there; :func:`resume` goes on after an interrupt.

    Args:
        plan: what to do.
        out: a folder that does not exist yet, or an older report.
        scheduler: address of a dask scheduler, "tcp://host:8786"; without one, an embedded cluster.
        workers: processes of the embedded cluster; by default one for each core.
        progress: called with the progress.

    Raises:
        InvalidInput: a place that cannot be written, an unfinished sweep there, no scheduler at that address.
        NotSupported: the extra ``sweep`` is not installed.
        WbcError: why the first run is refused, if all of them are: a frame that the robot does not have, a disturbance
            that the plant cannot have.
    """
    checks.instance("plan", plan, Sweep, "a wbc.sweep.Sweep")
    out = located(out)
    _begins(plan)
    folder = made_folder(fresh(out, RESULTS, "sweep", RESULTS))
    header = {
        "scenario": Path(plan.scenario).name,
        "sweep": str(plan),
        "runs": plan.runs,
        "seed": plan.seed,
        **{key: value for key, value in surroundings().items() if key in _HEADER},
        "plan": _plain(plan),
    }
    lines = Journal.begin(folder / RESULTS, "run", header)
    return _finished(plan, lines, out, progress, scheduler=scheduler, workers=workers)


def _begins(plan: Sweep) -> None:
    """Refuse a sweep of which no run would reach its first tick; how strong disturbances are makes no difference."""
    alike = not plan.vary and len(plan.solvers) == 1 and len(plan.hierarchies) < 2
    first = None
    for trial in plan.trials(range(1 if alike else plan.runs)):
        found = refusal(trial)
        if found is None:
            return
        first = first or found
    assert first is not None, "a sweep has runs"
    raise first


def resume(
    out: str | Path,
    *,
    scenario: str | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Progress = silent,
) -> Report:
    """Do the runs that an interrupted sweep left undone, with the settings that its results hold.

    A scenario that is Python code (``file.py:name``, ``module:name``) is executed only if ``scenario`` names it too:
    the results may come from someone else.

    Raises:
        InvalidInput: no unfinished sweep there, settings that cannot be read, or code that ``scenario`` does not name.
    """
    out = Path(out)
    lines = read(taken_up(out, RESULTS, "sweep"))
    return _finished(plan_of(lines, scenario), lines, out, progress, scheduler=scheduler, workers=workers)


def repeat(folder: str | Path, run: int, *, scenario: str | None = None) -> dict[str, Any]:
    """One run of a finished or unfinished sweep once more, in this process; ``scenario`` as for :func:`resume`.

    Raises:
        InvalidInput: no sweep there, no such run, or code that ``scenario`` does not name.
    """
    return done(plan_of(_results(Path(folder)), scenario).trial(run))


def replay(folder: str | Path, run: int, *, scenario: str | None = None) -> tuple[dict[str, Any], Path | None]:
    """One run once more, with its page in the folder of the sweep, whose own page leads there from now on.

    Gives the result and the path of the page, None where there is nothing to draw. Raises as :func:`repeat`.
    """
    out, kept = Path(folder), list[ScenarioResult]()
    lines = _results(out)
    result = done(plan_of(lines, scenario).trial(run), kept.append)
    if not kept or missing(kept[0].run):
        return result, None
    page = out / page_of(run)
    with replaced(page.parent, ARRAYS_FILE) as pending:
        write_run(kept[0], pending)
    if lines.findings and (out / RESULTS).is_file():
        write_report(summary(lines.header, in_order(lines), out), out)
    return result, page


def read(path: Path) -> Journal:
    """The results in a file.

    Raises:
        InvalidInput: it holds something else.
    """
    lines = Journal(path, "run")
    if not _HEADER <= set(lines.header):
        raise InvalidInput(f"{path} does not hold the results of a sweep: its first line is not their header")
    for key, result in lines.findings.items():
        check_result(f"{path}: run {key}", result)
    return lines


def in_order(lines: Journal) -> list[dict[str, Any]]:
    """All results by number of the run."""
    return sorted(lines.findings.values(), key=lambda result: int(result["run"]))


def _results(folder: Path) -> Journal:
    place = next((p / RESULTS for p in (folder, unfinished(folder)) if (p / RESULTS).is_file()), None)
    if place is None:
        raise InvalidInput(f"{folder} is not the folder of a sweep: it has no {RESULTS}")
    return read(place)


def plan_of(lines: Journal, scenario: str | None = None) -> Sweep:
    """The sweep whose results these are. The file is read as plain JSON.

    Raises:
        InvalidInput: the header holds no settings, or they name code that ``scenario`` does not name.
    """
    stored = lines.header.get("plan")
    if stored is None:
        raise InvalidInput("the results hold no settings: a value or class of the sweep had no form in JSON")
    return Sweep.from_json(stored, scenario=scenario)


def _plain(plan: Sweep) -> dict[str, Any] | None:
    """The settings for the header; None where they cannot be read back, and so neither resumed nor repeated."""
    try:
        return plan.to_json()
    except InvalidInput:
        return None


def _finished(
    plan: Sweep, lines: Journal, out: Path, progress: Progress, *, scheduler: str | None, workers: int | None
) -> Report:
    def take(result: dict[str, Any]) -> None:
        lines.add(result)
        count = len(lines.findings)
        progress(count / plan.runs, f"{count} of {plan.runs} runs")

    progress(len(lines.findings) / plan.runs)
    undone = [run for run in range(plan.runs) if run not in lines.findings]
    if undone:
        do_all(plan.trials(undone), take, scheduler=scheduler, workers=workers or os.cpu_count() or 1)
    results = in_order(lines)
    report = summary(lines.header, results, out)
    with replaced(out, RESULTS) as pending:
        lines.write(pending / RESULTS, results)
        write_report(report, pending)
    shutil.rmtree(unfinished(out))
    return report
