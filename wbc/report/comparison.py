"""Runs beside one another on one page: curves over each other, ghosts in the scene, and what differs."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.errors import InvalidInput
from wbc.files import located
from wbc.report import measure
from wbc.report.build import scene
from wbc.report.document import (
    Cell,
    Clock,
    Curve,
    Event,
    Item,
    Plot,
    Report,
    Section,
    Strip,
    Table,
    Text,
    Tile,
    formatted,
    neutral,
    number,
)
from wbc.report.folder import HTML, replaced, write
from wbc.report.happened import events
from wbc.report.record import RESULTS, checked, judged, named
from wbc.report.sections import SECTIONS, motion, settings, verdict
from wbc.report.why import why
from wbc.sim.scenario import Progress, ScenarioResult, failed_first, silent

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.collision import Obstacle
    from wbc.models.model import RobotModel

#: So many quantities of a plot are shown at first; the legend has the others.
MOST = 3
#: A table of more rows is folded.
LONG = 24
#: Settings that follow from the stack.
TOLD = ("distances", "residuals", "tasks")


@tells_arguments
def save_comparison(
    runs: Mapping[str, Run], folder: str | os.PathLike[str], *, robot: RobotModel | None = None,
    obstacles: Sequence[Obstacle] = (), progress: Progress = silent
) -> Path:  # fmt: skip
    """Save a page that shows ``runs`` over each other, by the names that they are called there; returns its path.

    The first run is the one that the others are compared with. With ``robot`` the motion is drawn; without, each run's
    own, where its name is enough to load it. ``obstacles`` are drawn with it.

    Raises:
        InvalidInput: less than two runs, one that is no record of a controller, or of another robot than ``robot``;
            something else than a report stands in the folder.
        NotSupported: a package that reports need is not installed.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> import numpy as np, wbc
        >>> from wbc.report import save_comparison
        >>> from wbc.tasks import JointVelocityLimits, Position
        >>> robot, runs = wbc.load("arm"), {}
        >>> for name, kp in (("soft", 1.0), ("stiff", 4.0)):
        ...     task = Position("tool", target=[0.4, 0.2, 0.5], kp=kp)
        ...     stack = wbc.Stack([task], subject_to=[JointVelocityLimits()])
        ...     controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=0.01)
        ...     recorder, q = wbc.Recorder(100), robot.q0
        ...     for k in range(100):
        ...         q = recorder.tick(controller, 0.01 * k, q, np.zeros(robot.nv)).q
        ...     runs[name] = recorder.run()
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     save_comparison(runs, Path(folder) / "gains", robot=robot).name
        'report.html'
    """
    checks.instance("runs", runs, Mapping, "runs by name")
    if len(runs) < 2:
        raise InvalidInput(f"{len(runs)} run is nothing to compare; give two or more")
    drawn = {name: checked(run, robot, f"runs[{name!r}]") or named(run) for name, run in runs.items()}
    results = {name: replace(judged(run, drawn[name]), obstacles=obstacles) for name, run in runs.items()}
    target = located(folder)
    with replaced(target) as pending:
        write(comparison(results, progress=progress), pending)
    return target / HTML


def comparison(results: Mapping[str, ScenarioResult], *, progress: Progress = silent) -> Report:
    """Everything in which judged runs differ, as data."""
    runs = {name: result.run for name, result in results.items()}
    drawn: list[dict[str, list[Plot]]] = []
    for k, result in enumerate(results.values()):
        progress(k / len(runs), "drawing the runs")
        drawn.append(dict(plots(result)))
    titles = dict.fromkeys(title for found in drawn for title in found)
    sections = [
        *([Section("Demands", [demanded(results)])] if any(r.verdict for r in results.values()) else []),
        Section("Settings", was_set(runs)),
        Section("Figures", came_out(results)),
        *(Section(title, overlaid(list(runs), [found.get(title, []) for found in drawn])) for title in titles),
    ]
    dt = min(float(run.meta["dt"]) for run in runs.values())
    clock = Clock(max(map(measure.seconds, runs.values())), dt, _events(results))
    whys = {name: found for name, run in runs.items() if (found := why(run)) is not None}
    tiles = [Tile(name, *_fate(result)) for name, result in results.items()]
    return Report(" · ".join(runs), _summary(results), None, sections, tiles, clock, scene(results), whys)


def plots(result: ScenarioResult) -> Iterator[tuple[str, list[Plot]]]:
    """Of each section of the run's own page the plots that can lie over those of another run."""
    for section in SECTIONS:
        made = None if section is motion.section else section(result)
        found = [item for item in made.items if isinstance(item, Plot) and not item.bars] if made else []
        if made and found:
            yield made.title, found


def overlaid(names: Sequence[str], drawn: Sequence[Sequence[Plot]]) -> list[Plot]:
    """The plots of runs by what they show, one colour a run; what only one run has stands there alone."""
    found: dict[str, dict[int, Plot]] = {}
    for run, each in enumerate(drawn):
        for plot in each:
            found.setdefault(plot.name, {})[run] = plot
    return [_over(names, of) for of in found.values()]


def _over(names: Sequence[str], of: Mapping[int, Plot]) -> Plot:
    first = next(iter(of.values()))
    every = [curve for plot in of.values() for curve in plot.curves]
    labels = list(dict.fromkeys(curve.label for curve in every))
    seen = set(labels)
    if len(labels) > MOST:  # seen at first: what is seen on the runs' own pages, the largest of any run
        size = {label: (0, 0.0) for label in labels}
        for curve in every:
            largest = float(np.nanmax(np.abs(curve.values), initial=0.0))
            size[curve.label] = max(size[curve.label], (curve.shown + (curve.shown and not curve.faint), largest))
        labels.sort(key=size.__getitem__, reverse=True)
        seen = {label for label in labels[:MOST] if size[label][0]}
    curves = []
    for dash, label in enumerate(labels):
        for run, plot in of.items():
            said = names[run] if len(labels) == 1 else f"{label}, {names[run]}"
            curves += [
                Curve(said, curve.values, label in seen, run=run, dash=dash, x=plot.x)
                for curve in plot.curves if curve.label == label
            ]  # fmt: skip
    strips = [
        Strip(f"{strip.label}, {names[run]}", strip.intervals, run) for run, plot in of.items() for strip in plot.strips
    ]
    bounds = list(dict.fromkeys(bound for plot in of.values() for bound in plot.bounds))
    return replace(first, curves=curves, strips=sorted(strips, key=lambda strip: strip.label), bounds=bounds)


def demanded(results: Mapping[str, ScenarioResult]) -> Table:
    """The demands with what came out in each run, first those that a run did not meet."""
    checks = [{check.text: check for check in result.verdict} for result in results.values()]
    every = [check for result in results.values() for check in result.verdict]
    rows: list[list[Cell]] = []
    for text in dict.fromkeys(check.text for check in failed_first(every)):
        mine = [found.get(text) for found in checks]
        bounds = dict.fromkeys(verdict.bound(check) for check in mine if check is not None)
        bars = [None if c is None else replace(verdict.margin(c), text=number(float(c.value))) for c in mine]
        rows.append([text, " or ".join(bounds), *bars])
    return Table(("demand", "bound", *results), rows, "Bar: the value; the line is the bound.")


def came_out(results: Mapping[str, ScenarioResult]) -> list[Item]:
    """The figures that differ, and those that do not."""
    differing, same = _differing([_figures(result) for result in results.values()])
    first: Item = Table(("figure", *results), differing) if differing else Text("No figure differs.")
    return [first, *([Table(("figure", "in every run"), same, "Figures that do not differ", True)] if same else [])]


def was_set(runs: Mapping[str, Run]) -> list[Item]:
    """Settings that differ."""
    flat = [
        dict(settings.flat({key: value for key, value in run.meta.items() if key not in (*RESULTS, *TOLD, "stack")}))
        | {part.strip(): value.strip() for part, _, value in _stack(run)}
        for run in runs.values()
    ]  # fmt: skip
    differing, _ = _differing(
        [{settings.setting_name(k): settings.shown(value) for k, value in one.items()} for one in flat]
    )
    if not differing:
        return [Text("Every setting is the same in all runs.")]
    caption = "The settings that differ. A dash: the run has no such setting."
    return [Table(("setting", *runs), differing, caption, folded=len(differing) > LONG)]


def _stack(run: Run) -> Iterator[tuple[str, str, str]]:
    """The lines of the stack: what is set, and to which members."""
    return (line.partition(": ") for line in str(run.meta.get("stack", "")).splitlines() if ": " in line)


def _differing(tables: Sequence[Mapping[str, Cell]]) -> tuple[list[list[Cell]], list[list[Cell]]]:
    """Rows of keys whose cells differ between the tables, and rows of those that are the same in all."""
    differing, same = list[list[Cell]](), list[list[Cell]]()
    for key in dict.fromkeys(key for table in tables for key in table):
        cells = [table.get(key) for table in tables]
        if len({formatted(cell) for cell in cells}) > 1:
            differing.append([key, *cells])
        else:
            same.append([key, cells[0]])
    return differing, same


def _figures(result: ScenarioResult) -> dict[str, Cell]:
    """What can be said of any run in a number, and the scenario's own numbers."""
    run, tick, use = result.run, measure.tick_times(result.run), measure.use(result.run)
    found: dict[str, Cell] = {
        "simulated [s]": measure.seconds(run), "ticks without an answer": int((~measure.solved(run)).sum()),
        "late ticks": measure.late(run), "tick, median [µs]": tick.median, "tick, p99 [µs]": tick.p99,
    }  # fmt: skip
    found |= {f"{kind}, of its limit at most [%]": 100.0 * float(share.max(initial=0.0)) for kind, share in use.items()}
    for task in measure.tasks(run):
        for unit, error in measure.errors(run, task).items():
            norm = np.linalg.norm(error, axis=1)
            found |= {f"{task}, rms [{unit}]": measure.rms(norm), f"{task}, largest [{unit}]": norm.max()}
    slips = {name: measure.slip(run, name) for name in run.meta.get("contacts", {})}
    found |= {f"slip of {name} [m]": slip for name, slip in slips.items() if slip is not None}
    silent = run.meta.get("silent")
    found |= {"not all recorded": ", ".join(silent)} if isinstance(silent, Mapping) and silent else {}
    found |= {f"{kind} exceeded by [{unit}]": worst for kind, (worst, unit) in result.violations.items()}
    numbers = {
        settings.figure_name(key): neutral(value)
        for key, value in settings.flat(result.figures) if isinstance(value, bool | int | float)
    }  # fmt: skip
    return found | numbers


def _events(results: Mapping[str, ScenarioResult]) -> list[Event]:
    """What happened in any run; what happened in all of them once, and of what did not, in which."""
    found: dict[Event, list[str]] = {}
    for name, result in results.items():
        for event in events(result):
            found.setdefault(event, []).append(name)
    everywhere = len(results)
    return [
        event if len(names) == everywhere else event._replace(label=f"{event.label}, {', '.join(names)}")
        for event, names in found.items()
    ]


def _fate(result: ScenarioResult) -> tuple[str, str]:
    if not result.verdict and result.ok:
        return "not judged", ""
    return ("passed", "good") if result.ok else ("failed", "bad")


def _summary(results: Mapping[str, ScenarioResult]) -> str:
    metas: list[Mapping[str, Any]] = [result.run.meta for result in results.values()]
    what = dict.fromkeys(f"{meta.get('scenario', 'a recorded loop')} of {meta.get('robot')}" for meta in metas)
    ends = []
    for name, result in results.items():
        failed = "; ".join(check.text for check in failed_first(result.verdict) if not check.ok)
        said = {"passed": "all demands met", "not judged": "not judged"}
        ends.append(f"{name}: {said.get(_fate(result)[0], f'not met: {failed}')}")
    return f"{len(results)} runs of {' and '.join(what)}. {'. '.join(ends)}."
