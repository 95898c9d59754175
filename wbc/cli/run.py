"""``wbc run``: one scenario, its verdict, and a report of it."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from traceback import extract_tb
from typing import TYPE_CHECKING, Annotated, Any
from weakref import ref

import typer
from rich.text import Text

from wbc.cli.console import (
    BAD_INPUT,
    INTERRUPTED,
    NO,
    complain,
    notes,
    on_stderr,
    one_sentence,
    place,
    progress,
    reported,
    say,
    table,
)
from wbc.cli.options import AsJson, Out, PlantName, SetOptions, Show, SolverName

if TYPE_CHECKING:
    from wbc.sim.scenario import Scenario, ScenarioResult, Trial
    from wbc.sim.simulate import Interrupted


@one_sentence
def run(
    scenario: Annotated[
        str | None,
        typer.Argument(
            help="A name, module:name or file.py:name; without one, those there are, or those of file.py, are listed."
        ),
    ] = None,
    *,
    solver: SolverName = "pdas",
    hierarchy: Annotated[
        str | None,
        typer.Option(
            help="What the stack's levels mean: weighted, strict or scaled, as far as the scenario has them; default: "
            "its first."
        ),
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time in seconds.")] = None,
    plant: PlantName = None,
    settings: SetOptions = None,
    out: Out = None,
    live: Annotated[bool, typer.Option("--live", help="Show it in the browser while it runs, with sliders.")] = False,
    port: Annotated[int, typer.Option(help="Of the address of --live.")] = 8080,
    as_json: AsJson = False,
    show: Show = False,
) -> None:
    """Run a scenario, print its verdict, write its report. Exit code 0: the verdict is good, 1: it is not, 2: bad
    input, or the scenario raised an error; what it had simulated is kept."""
    from wbc.cli.list_ import described, listed
    from wbc.control.recorder import ARRAYS_FILE, META_FILE
    from wbc.errors import InvalidInput, SimulationError
    from wbc.qp.solvers import by_name
    from wbc.report.build import require_extras
    from wbc.report.folder import HTML, replaced
    from wbc.report.record import write_run
    from wbc.sim.scenario import Settings, find, is_file, scenarios, scenarios_of
    from wbc.sim.simulate import Interrupted

    if scenario is None or is_file(scenario):
        there = scenarios() if scenario is None else scenarios_of(scenario)
        if (hierarchy, duration, plant, settings, out, as_json) != (None, None, None, None, None, False):
            here = "" if scenario is None else f" {scenario}"
            raise InvalidInput(f"name the scenario to run; wbc run{here} without anything else lists them")
        say(listed(described(there)))
        return
    chosen = find(scenario)
    parameters = chosen.parse(settings or ())
    chosen_settings = chosen.choose(plant=plant, hierarchy=hierarchy, duration=duration)
    by_name(solver)
    folder = place(out, chosen.name)
    require_extras()
    interrupted, raised, report = False, "", None
    done: list[ref[Trial]] = []  # no memory is held for runs that the scenario has let go
    with replaced(folder, ARRAYS_FILE) as pending, notes(told=not as_json), on_stderr():
        with progress(f"running {chosen.name}") as step, _shown(live, port):
            try:
                chosen_settings |= {"solver": solver, "progress": step}
                result = chosen.run(parameters, Settings(**chosen_settings), simulated=lambda t: done.append(ref(t)))
            except Interrupted as stop:
                result, interrupted = _unfinished(stop, chosen.name), True
            except SimulationError:
                raise
            except Exception as error:
                kept = [trial for one in done if (trial := one()) is not None]
                if not kept:
                    raise
                raised = _told(error, chosen)
                result = _unjudged(kept, raised)
        try:
            with progress("drawing the report") as step:
                report = write_run(result, pending, progress=step)
        except KeyboardInterrupt:
            if not (pending / META_FILE).is_file():
                raise
            (pending / HTML).unlink(missing_ok=True)  # half of it, perhaps
    if report is None:
        raise KeyboardInterrupt(f"the run is in {folder}, and `wbc report run {quote(str(folder))}` draws its report")
    if raised:
        complain(f"{raised}; the run is in {folder}")
        raise typer.Exit(BAD_INPUT)
    if as_json:
        print(json.dumps(summary(chosen.name, result, folder), allow_nan=False, ensure_ascii=False))
    else:
        _print(report.summary, result, folder, show=show)
    if interrupted:
        complain(f"{result.run.meta['ended']}; the run so far is in {folder}")
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(0 if result.ok else NO)


@contextmanager
def _shown(live: bool, port: int) -> Iterator[None]:
    """A view in the browser of what is simulated meanwhile, with ``live``."""
    if not live:
        yield
        return
    from wbc.live.beside import beside
    from wbc.live.view import required

    required(port)
    with beside(port, lambda url: print(f"wbc: open {url} in a browser", file=sys.stderr, flush=True)):
        yield


def _unfinished(stop: Interrupted, name: str) -> ScenarioResult:
    """What can be said of a run that Ctrl-C ended: everything but the scenario's own demands."""
    from wbc.report import measure
    from wbc.sim.scenario import Check, Place, ScenarioResult

    run = stop.run
    run.meta.setdefault("scenario", name)
    whole = float(run.meta["duration"])
    complete = Check("the run is complete", measure.seconds(run), ">=", whole, "s", Place(measure.seconds(run)))
    return ScenarioResult(
        run=run, ok=False, violations=measure.violations(run), tracking=measure.tracking(run), verdict=[complete],
        robot=stop.robot,
    )  # fmt: skip


def _told(error: Exception, scenario: Scenario) -> str:
    """What a scenario raised, and the last line of its own file that led there."""
    from wbc.plugins import one_line

    own = sys.modules[type(scenario).__module__].__file__
    lines = [
        f" ({Path(one.filename).name}:{one.lineno})" for one in extract_tb(error.__traceback__) if one.filename == own
    ]
    return f"the scenario {scenario.name} raised {one_line(error)}{''.join(lines[-1:])}"


def _unjudged(kept: list[Trial], raised: str) -> ScenarioResult:
    """What can be said of runs that the scenario could not judge."""
    from wbc.report import measure
    from wbc.sim.scenario import Check, ScenarioResult

    first, *others = kept
    return ScenarioResult(
        run=first.run, ok=False, violations=measure.violations(first.run), tracking=measure.tracking(first.run),
        verdict=[Check("errors in the scenario's own code", 1.0, "=", 0.0)], figures={"raised": raised},
        robot=first.robot, called=first.name, beside={trial.name: trial.run for trial in others},
    )  # fmt: skip


def summary(name: str, result: ScenarioResult, folder: Path) -> dict[str, Any]:
    """The object that ``--json`` prints; numbers that are not finite become null."""
    from wbc.report import measure
    from wbc.report.folder import HTML
    from wbc.report.record import demands, plain

    tick = measure.tick_times(result.run)
    return {
        "scenario": name,
        "ok": bool(result.ok),
        "seconds": plain(measure.seconds(result.run)),
        "demands": plain(demands(result)),
        "ticks": result.run.rows,
        "late_ticks": measure.late(result.run),
        "tick_us": plain(tick._asdict()),
        "violations": {kind: plain(worst) for kind, (worst, _) in result.violations.items()},
        "tracking": plain(result.tracking),
        "statuses": measure.statuses(result.run),
        "report": str((folder / HTML).resolve()),
        "figures": plain(result.figures),
    }


def _print(sentence: str, result: ScenarioResult, folder: Path, *, show: bool) -> None:
    from wbc.control.recorder import FAILED_FILE
    from wbc.report import measure
    from wbc.report.document import number
    from wbc.report.folder import HTML
    from wbc.sim.scenario import failed_first

    made = table("", "demanded", "came out", "bound", "holds", "where")
    made.columns[1].justify = "right"
    for check in failed_first(result.verdict):
        word = Text("yes", style="green") if check.ok else Text("no", style="bold red")
        bound = Text(f"{check.sign} {number(float(check.bound))} {check.unit}")
        made.add_row(Text(check.text), number(float(check.value)), bound, word, Text(str(check.place), style="dim"))
    tick, period = measure.tick_times(result.run), 1e6 * float(result.run.meta["dt"])
    late = measure.late(result.run)
    made.add_row("ticks late for real time", str(late), f"of {result.run.rows}")
    made.add_row("tick, median", f"{tick.median:.0f}", f"of {period:g} µs")
    made.add_row("tick, 99th percentile", f"{tick.p99:.0f}", f"of {period:g} µs")
    say(sentence, "", made, "")
    failure = result.run.meta.get("failure")
    if failure:
        where = "" if result.run.failed is None else f"\nits QP: wbc explain {quote(str(folder / FAILED_FILE))}"
        say(f"{failure['why']}{where}", "")
    reported(folder / HTML, show=show)
