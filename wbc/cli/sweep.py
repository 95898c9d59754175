"""``wbc sweep``: many runs of a scenario, and how they are spread."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from wbc.cli.console import kept, notes, on_stderr, one_sentence, place, reported, say, working
from wbc.cli.options import AsJson, Out, PlantName, SetOptions, Show
from wbc.errors import InvalidInput


@one_sentence
def sweep(
    scenario: Annotated[
        str | None, typer.Argument(help="A name that wbc list shows, module:name or file.py:name.")
    ] = None,
    *,
    runs: Annotated[int, typer.Option(min=1, help="How many.")] = 100,
    vary: Annotated[
        list[str] | None, typer.Option(metavar="KEY=LOW:HIGH", help="Draw a parameter: KEY=LOW:HIGH or KEY=a,b,c.")
    ] = None,
    settings: SetOptions = None,
    solver: Annotated[str, typer.Option(help="QP solvers to draw from, separated by commas.")] = "pdas",
    hierarchy: Annotated[
        str | None, typer.Option(help="Of weighted, strict and scaled those to draw from, separated by commas.")
    ] = None,
    push: Annotated[list[str] | None, typer.Option(metavar="FRAME=LOW:HIGH", help="A level push [N].")] = None,
    payload: Annotated[list[str] | None, typer.Option(metavar="FRAME=LOW:HIGH", help="An unknown mass [kg].")] = None,
    noise: Annotated[str | None, typer.Option(metavar="LOW:HIGH", help="Noise of joint velocities [rad/s].")] = None,
    delay: Annotated[str | None, typer.Option(metavar="LOW:HIGH", help="Commands arrive late [s].")] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time of a run in seconds.")] = None,
    plant: PlantName = None,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, other runs.")] = 0,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help="A dask scheduler that runs.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes here; default: one for each core.")] = None,
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the sweep that --out began.")] = False,
    repeat: Annotated[int | None, typer.Option(metavar="RUN", help="Do one run of --out again, make its page.")] = None,
    as_json: AsJson = False,
    show: Show = False,
) -> None:
    """Run a scenario many times with drawn parameters, disturbances, solvers, hierarchies; report how it spreads."""
    from wbc import sweep as sweeping
    from wbc.report.build import require_extras
    from wbc.report.folder import HTML, RESULTS
    from wbc.sweep.run import in_order, read
    from wbc.sweep.summary import figures, reasons

    if (resume or repeat is not None) and out is None:
        raise InvalidInput("--resume and --repeat are about a sweep that was begun: give its folder as --out")
    require_extras("jinja2")
    if repeat is not None and out is not None:
        with notes(), on_stderr():
            result, page = sweeping.replay(out, repeat, scenario=scenario)
        said = f"run {repeat} went well" if result["ok"] else f"run {repeat}: {'; '.join(reasons(result))}"
        _answer(as_json, said, result, page, show=show)
        return
    folder = place(out, "sweep")
    how: dict[str, Any] = {"scheduler": scheduler, "workers": workers}
    named = [scenario] if scenario and ":" in scenario else []
    again = shlex.join(["wbc", "sweep", *named, "--resume", "--out", str(folder)])
    going_on = f"finished runs are kept; continue with: {again}"
    with working("sweeping") as step, kept(going_on):
        if resume:
            report = sweeping.resume(folder, scenario=scenario, progress=step, **how)
        else:
            if scenario is None:
                raise InvalidInput("give a scenario, as wbc run takes it")
            plan = sweeping.Sweep(
                scenario, runs, **_drawn(scenario, vary or (), settings or ()),
                disturbances=_disturbances(push or (), payload or (), noise, delay),
                solvers=tuple(solver.split(",")), hierarchies=tuple(hierarchy.split(",")) if hierarchy else (),
                plant=plant, duration=duration, seed=seed,
            )  # fmt: skip
            report = sweeping.sweep(plan, out=folder, progress=step, **how)
    lines = read(folder / RESULTS)
    _answer(as_json, report.summary, figures(lines.header, in_order(lines)), folder / HTML, show=show)


def _answer(as_json: bool, sentence: str, found: dict[str, Any], page: Path | None, *, show: bool) -> None:
    if as_json:
        made = found | {"report": None if page is None else str(page.resolve())}
        print(json.dumps(made, ensure_ascii=False, allow_nan=False))
        return
    say(sentence)
    if page is not None:
        reported(page, show=show)


def _drawn(scenario: str, vary: Any, settings: Any) -> dict[str, Any]:
    from wbc.sim.scenario import find
    from wbc.sweep.plan import read_variations

    chosen = find(scenario)
    keys = [setting.partition("=")[0] for setting in settings]
    parsed = chosen.parse(settings)
    return {"vary": read_variations(chosen, vary), "fixed": {key: parsed[key] for key in keys}}


def _disturbances(push: Any, payload: Any, noise: str | None, delay: str | None) -> tuple[Any, ...]:
    from wbc.sweep.draw import RandomDelay, RandomNoise, RandomPayload, RandomPush, at_frame, read_range

    found: list[Any] = [RandomPush(*at_frame("--push", text)) for text in push]
    found += [RandomPayload(*at_frame("--payload", text)) for text in payload]
    found += [RandomNoise(read_range("--noise", noise))] if noise else []
    found += [RandomDelay(read_range("--delay", delay))] if delay else []
    return tuple(found)
