"""The report of one run: what happened in a sentence, the figures to see first, and every section."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.report import measure
from wbc.report.document import Clock, Report, Scene, Tile, formatted, plural, rounded
from wbc.report.happened import events
from wbc.report.replay import replay, together
from wbc.report.sections import SECTIONS
from wbc.report.shapes import obstacle_parts, parts
from wbc.report.why import why
from wbc.sim.scenario import Progress, ScenarioResult, failed_first, silent

if TYPE_CHECKING:
    from wbc.control.recorder import Run


@tells_arguments
def run_report(result: ScenarioResult, *, progress: Progress = silent) -> Report:
    """The report of a run as data; :func:`wbc.report.folder.write` writes it down.

    Raises:
        NotSupported: a package that draws is not installed; the message says what to install.
    """
    checks.instance("result", result, ScenarioResult, "a ScenarioResult, such as Scenario.run gives")
    sections = []
    for i, section in enumerate(SECTIONS):
        progress(i / len(SECTIONS))
        made = section(result)
        if made is not None:
            sections.append(made)
        if i == 0:
            sections += result.sections
    progress(1.0)
    meta = result.run.meta
    title = f"{meta.get('scenario', 'run')} · {meta.get('robot', 'robot')}"
    ok = result.ok if result.verdict or not result.ok else None  # nothing was demanded
    run = result.run
    clock = Clock(measure.seconds(run), float(run.meta["dt"]), events(result)) if run.rows else None
    found = why(run)
    whys = {} if found is None else {"": found}
    return Report(title, summary(result), ok, sections, highlights(result), clock, scene(_together(result)), whys)


def _together(result: ScenarioResult) -> dict[str, ScenarioResult]:
    """The run with those beside it, by their names."""
    return {result.called: result, **{name: replace(result, run=run) for name, run in result.beside.items()}}


def scene(results: Mapping[str, ScenarioResult]) -> Scene | None:
    """The robot that stands beside the plots, and with it those of the other runs, by their names."""
    scenes = []
    for place, (name, result) in enumerate(results.items()):
        run, robot = result.run, result.robot
        solid = [*parts(robot), *obstacle_parts(result.obstacles)] if robot is not None and run.rows else []
        if robot is not None and solid:
            scenes.append(replay(run, robot, solid, obstacles=result.obstacles, called=name, place=place))
    return together(scenes) if len(scenes) > 1 else scenes[0] if scenes else None


def require_extras(*modules: str) -> None:
    """Check that a report can be drawn, before any long work. ``modules``: those it needs; by default, those of a run.

    Raises:
        NotSupported: a package is missing; the message says what to install.
    """
    checks.packages("a report", *(modules or ("jinja2", "matplotlib", "trimesh", "collada")), extra="report")


def summary(result: ScenarioResult) -> str:
    """One sentence: who did what for how long under which disturbances, and how it ended."""
    run, meta = result.run, result.run.meta
    solved = measure.statuses(run).get("SOLVED", 0)
    ticks = "every tick" if solved == run.rows else f"{solved} of {run.rows} ticks"
    disturbances = meta.get("disturbances", [])
    under = f" under {plural(len(disturbances), 'disturbance')}" if disturbances else ""
    failed = [check for check in failed_first(result.verdict) if not check.ok]
    early = meta.get("ended", "complete")
    stopped = "" if early == "complete" else f" and ended early ({early})"
    end = "; every demand was met" if result.verdict else ""
    if not result.ok:
        end = "; not met: the scenario's own verdict"
    if failed:
        first = f"{failed[0].text} ({failed[0].place})" if str(failed[0].place) else failed[0].text
        end = f"; not met: {len(failed)} of {len(result.verdict)} demands, first {first}"
    how = ", ".join(str(meta[key]) for key in ("level", "hierarchy", "solver") if key in meta)
    return (
        f"{_named(str(meta.get('robot', 'the robot')))} ran {meta.get('scenario', 'a recorded loop')} for "
        f"{measure.seconds(run):g} s at {1.0 / float(meta['dt']):g} Hz ({how}){under}{stopped}; "
        f"{ticks} solved and certified{end}."
    )


def _named(robot: str) -> str:
    """A name at the start of a sentence; an identifier is left as it is."""
    return robot if "_" in robot else robot.capitalize()


def highlights(result: ScenarioResult) -> list[Tile]:
    """The few figures to see first."""
    run = result.run
    times, use = measure.tick_times(run), measure.use(run)
    tiles = [
        Tile("simulated", f"{measure.seconds(run):g} s"),
        Tile("ticks", formatted(run.rows)),
        _real_time(run),
        Tile("median tick", f"{times.median:.0f} µs"),
    ]
    if "torque" in use:
        tiles.append(_peak("peak torque", use["torque"]))
    tiles.append(_peak("peak speed", use["velocity"]))
    return tiles


def _real_time(run: Run) -> Tile:
    """Whether every tick was done within its period; the slowest hundredth beside it."""
    late, p99, period = measure.late(run), measure.tick_times(run).p99, 1e6 * float(run.meta["dt"])
    beside = f"p99 {p99:.0f} µs, period {period:g} µs"
    if not late:
        return Tile(f"real time; {beside}", "yes", "good")
    return Tile(f"ticks late; {beside}", formatted(late), "bad" if p99 > period else "doubtful")


def _peak(what: str, share: Any) -> Tile:
    """The largest share of a limit; beyond it, whether or not the scenario demands that it be kept, it is coloured."""
    percent = 100.0 * float(np.max(share, initial=0.0))
    return Tile(what, f"{rounded(percent)} %", "doubtful" if np.round(percent) > 100.0 else "")
