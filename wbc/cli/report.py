"""``wbc report``: comparisons that people can decide from."""

from __future__ import annotations

import shlex
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from wbc.cli.console import kept, one_sentence, place, reported, say, working
from wbc.cli.options import Out, RobotName, SetOptions, Show, SolverName
from wbc.errors import InvalidInput

report = typer.Typer(
    name="report",
    help="Reports: of a recorded run, of QP solvers compared, of how times grow.",
    rich_markup_mode="markdown",
)

#: What ``--all`` runs besides the folders it is given.
SCENARIOS = ("arm-reach", "quadruped-stand", "humanoid-stand")


@report.callback(invoke_without_command=True)
def top(context: typer.Context) -> None:
    """Reports: of a recorded run, of QP solvers compared, of how times grow."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@report.command("run")
@one_sentence
def run(
    folder: Annotated[Path, typer.Argument(help="Where run.npz and meta.json are.")],
    *,
    robot: RobotName = None,
    again: Annotated[bool, typer.Option("--again", help="Make the report anew though there is one.")] = False,
    show: Show = False,
) -> None:
    """The report of a recorded run: made if there is none, or --again, from the record alone."""
    from wbc.control.recorder import ARRAYS_FILE
    from wbc.report.folder import HTML

    page = folder / HTML
    if again or robot is not None or not (page.is_file() and (folder / ARRAYS_FILE).is_file()):
        from wbc.models import load
        from wbc.report.record import report_again

        with working("drawing the report") as step:
            model = None if robot is None else load(robot)
            page, drawn = report_again(folder, robot=model, progress=step)
            if drawn is None:
                warnings.warn(
                    "the motion is not drawn: the run's robot cannot be loaded by its name; give --robot", stacklevel=1
                )
    reported(page, show=show)


@report.command("solvers")
@one_sentence
def solvers(
    sources: Annotated[
        list[str] | None,
        typer.Argument(metavar="[SCENARIO|FOLDER]...", help="Scenarios as wbc run names them, QPs (.npz)."),
    ] = None,
    *,
    every: Annotated[bool, typer.Option("--all", help=f"Add {', '.join(SCENARIOS)}, --torture and --growth.")] = False,
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the comparison that --out began.")] = False,
    data: Annotated[
        Path | None, typer.Option("--from", metavar="DATA", help="Write the pages once more from a data.json.")
    ] = None,
    solver: Annotated[list[str] | None, typer.Option(help="A solver, again for more; default: all usable.")] = None,
    settings: SetOptions = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time of the scenarios in seconds.")] = None,
    ticks: Annotated[int, typer.Option(min=2, help="QPs to record of each scenario.")] = 200,
    rounds: Annotated[int, typer.Option(min=1, help="How often each solve is timed; the least counts.")] = 3,
    limit: Annotated[float, typer.Option(min=0.1, help="Seconds a solve may take.")] = 5.0,
    loop: Annotated[bool, typer.Option(help="Run the scenarios with each solver in the loop.")] = True,
    torture: Annotated[bool | None, typer.Option(help="Give the solvers malformed problems too.")] = None,
    growth: Annotated[bool | None, typer.Option(help="Measure how times grow with size.")] = None,
    show: Show = False,
) -> None:
    """Which solver at which tolerance: replay QPs over every solver, each in its own process, and say what to use.

    With all solvers a scenario of some seconds takes several minutes. It is shorter with --no-loop, fewer --ticks and
    --rounds, a short --duration, or --solver for some of the solvers; --resume goes on after an interrupt.
    """
    from wbc.report import solvers as comparing
    from wbc.report.build import require_extras
    from wbc.report.folder import HTML
    from wbc.report.solvers.page import page

    require_extras("jinja2")
    folder = place(out, "solvers")
    if data is not None:
        summary = comparing.redraw(data, folder).summary
    else:
        if resume and out is None:
            raise InvalidInput("--resume goes on with the comparison of a folder: give it as --out")
        options: dict[str, Any] = {
            "solvers": solver, "settings": settings or (), "duration": duration, "ticks": ticks, "rounds": rounds,
            "limit": limit, "loop": loop,
            "torture": every if torture is None else torture, "growth": every if growth is None else growth,
        }  # fmt: skip
        wanted = [*(sources or ()), *(name for name in SCENARIOS if every and name not in (sources or ()))]
        if not wanted and not resume:
            raise InvalidInput("give a scenario, a folder of QPs, or --all")
        named = [source for source in sources or () if ":" in source]
        again = shlex.join(["wbc", "report", "solvers", *named, "--resume", "--out", str(folder)])
        going_on = f"what was measured stays: {again}"
        with working("comparing") as step, kept(going_on):
            if resume:
                measured = comparing.resume(folder, trusted=wanted, progress=step)
            else:
                measured = comparing.compare(wanted, out=folder, progress=step, **options)
        summary = page(measured).summary
    say(summary)
    reported(folder / HTML, show=show)


@report.command("scaling")
@one_sentence
def scaling(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[SCENARIO]...", help="With sizes; default: the growing ones.")
    ] = None,
    *,
    out: Out = None,
    solver: SolverName = "pdas",
    ticks: Annotated[int, typer.Option(min=1, help="Ticks at each size.")] = 100,
    repeats: Annotated[int, typer.Option(min=1, help="How often; the least time of each tick counts.")] = 5,
    show: Show = False,
) -> None:
    """How the time of a tick grows with joints, tasks, contacts and active rows, with exponents."""
    import json

    from wbc.report.build import require_extras
    from wbc.report.folder import DATA, HTML, replaced, write
    from wbc.report.scaling import scaled
    from wbc.report.scaling.page import page
    from wbc.sim.provenance import surroundings
    from wbc.sim.scenario import find, scenarios

    require_extras("jinja2")
    chosen = [find(name) for name in names] if names else [*scenarios("growth").values()]
    folder = place(out, "scaling")
    where = surroundings()
    with replaced(folder, DATA) as pending:
        with working("measuring") as step:
            rows = scaled(chosen, ticks=ticks, repeats=repeats, solver=solver, progress=step)
        settings = {"ticks": ticks, "repeats": repeats, "solver": solver}
        titles = {scenario.name: scenario.summary for scenario in chosen}
        made = page(data := {"surroundings": where, "settings": settings, "titles": titles, "rows": rows})
        (pending / DATA).write_text(json.dumps(data, ensure_ascii=False, allow_nan=False), encoding="utf-8")
        write(made, pending)
    say(made.summary)
    reported(folder / HTML, show=show)
