"""The report of a recorded run: of a loop of one's own, or once more from the folder that it was saved in."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.arguments import tells_arguments
from wbc.control.recorder import ARRAYS_FILE, Run
from wbc.errors import InvalidInput, WbcError
from wbc.files import located
from wbc.report import measure
from wbc.report.build import require_extras, run_report
from wbc.report.folder import HTML, replaced, write
from wbc.report.kept import keep_obstacles, keep_sections, kept_obstacles, kept_sections
from wbc.report.markdown import FIGURES, picture_path
from wbc.report.shapes import check_kinds, described
from wbc.sim.provenance import machine, versions
from wbc.sim.scenario import Check, Place, Progress, ScenarioResult, failed_first, silent

if TYPE_CHECKING:
    from wbc.models.collision import Obstacle
    from wbc.models.model import RobotModel
    from wbc.report.document import Report

#: What a report of a run cannot do without: metadata, and columns.
NEEDED_META, NEEDED = ("dt", "joint_names", "statuses"), ("t", "q", "v", "status")
JUDGED = "judged"
#: Where the runs beside a run lie, in a folder each; metadata of the run has their names, and its own.
BESIDE, CALLED = "beside", "called"
#: The picture of the motion, which a report has that shows the robot.
MOTION = "motion.png"
#: Metadata that is no setting: what came of the run.
RESULTS = (JUDGED, BESIDE, CALLED, "failure", "active_rows", "fallback_levels", "statuses", "ended", "fallen", "silent")


@tells_arguments
def save_report(
    run: Run, folder: str | os.PathLike[str], *, robot: RobotModel | None = None, obstacles: Sequence[Obstacle] = ()
) -> Path:
    """Save ``run`` into ``folder``, with a report of it, and return the path of ``report.html``.

    A report that stands there is replaced. With ``robot`` the motion is drawn, and with it ``obstacles``.

    Raises:
        InvalidInput: a run that a :class:`~wbc.Recorder`'s ``tick`` or :func:`~wbc.sim.simulate.simulate` did not make,
            of another robot, or without ticks; no obstacle; something else than a report stands in the folder.
        NotSupported: a package that reports need is not installed.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> import numpy as np, wbc
        >>> from wbc.report import save_report
        >>> from wbc.tasks import JointVelocityLimits, Position
        >>> robot = wbc.load("arm")
        >>> stack = wbc.Stack([Position("tool", target=[0.4, 0.2, 0.5])], subject_to=[JointVelocityLimits()])
        >>> controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=0.01)
        >>> recorder, q = wbc.Recorder(100), robot.q0
        >>> for k in range(100):
        ...     q = recorder.tick(controller, 0.01 * k, q, np.zeros(robot.nv)).q
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     save_report(recorder.run(), Path(folder) / "mine").name
        'report.html'
    """
    from wbc.models.collision import obstacles_in

    checked(run, robot)
    around = obstacles_in("obstacles", obstacles)
    run = Run(run.columns, {"versions": versions(), "machine": machine(), **run.meta})
    target = located(folder)
    with replaced(target, ARRAYS_FILE) as pending:
        report = run_report(replace(judged(run, robot), obstacles=around))
        keep_obstacles(around, measure.clock(run), pending)
        run.save(pending)
        write(report, pending)
    return target / HTML


def report_again(
    folder: str | os.PathLike[str], *, robot: RobotModel | None = None, progress: Progress = silent
) -> tuple[Path, RobotModel | None]:
    """Make the report in the folder of a run anew from ``run.npz`` and ``meta.json``; gives its path, and who is drawn.

    Without ``robot`` the one of the run's name, or the planar robot of the record, is drawn. Obstacles that are meshes
    are left out. The record itself stays.

    Raises:
        InvalidInput: no run in the folder, ``robot`` is another one, or the report shows one that has no such name.
        NotSupported: a package that reports need is not installed.
    """
    run = Run.load(folder)
    drawn, target = checked(run, robot) or named(run), Path(folder)
    if drawn is None and (target / HTML).is_file() and (target / FIGURES / MOTION).is_file():
        raise InvalidInput(
            f"{target / HTML} shows the robot {str(run.meta.get('robot'))!r}, which cannot be loaded by its name, and "
            "a new report would not; give the robot (--robot NAME or FILE)"
        )
    result = replace(
        judged(run, drawn), called=str(run.meta.get(CALLED, "")), beside=beside(target, run),
        sections=kept_sections(target), obstacles=kept_obstacles(target),
    )  # fmt: skip
    report = run_report(result, progress=progress)
    before = [*(target / FIGURES).iterdir()] if (target / HTML).is_file() and (target / FIGURES).is_dir() else []
    write(report, target)
    shown = {target / picture_path(figure) for figure in report.figures}
    for path in before:
        if path not in shown:  # a picture of the report before
            path.unlink(missing_ok=True)
    return target / HTML, drawn


def write_run(result: ScenarioResult, folder: Path, *, progress: Progress = silent) -> Report:
    """Write the record of a run, what its scenario says of it, and its report into an existing folder.

    The runs beside it have folders of their own there, and the scenario's own sections a file. The record comes first:
    :func:`report_again` can draw the report where this was interrupted.
    """
    run = result.run
    keep_sections(result.sections, folder)
    if run.rows:
        longest = max((run, *result.beside.values()), key=lambda one: one.rows)
        keep_obstacles(result.obstacles, measure.clock(longest), folder)
    run.meta |= judgement(result)
    if result.beside:
        run.meta |= {CALLED: result.called, BESIDE: {name: str(k) for k, name in enumerate(result.beside, 1)}}
    for k, (name, other) in enumerate(result.beside.items(), 1):
        Run(other.columns, {**other.meta, CALLED: name}).save(folder / BESIDE / str(k))
    run.save(folder)
    report = run_report(result, progress=progress)
    write(report, folder)
    return report


def beside(folder: Path, run: Run) -> dict[str, Run]:
    """The runs that :func:`write_run` saved beside ``run`` in ``folder``, by their names."""
    places = run.meta.get(BESIDE)
    places = places if isinstance(places, Mapping) else {}
    return {str(name): Run.load(folder / BESIDE / Path(str(place)).name) for name, place in places.items()}


def judgement(result: ScenarioResult) -> dict[str, Any]:
    """What a scenario said of its run, for the run's metadata."""
    violations = {kind: list(worst) for kind, worst in result.violations.items()}
    found = {"ok": bool(result.ok), "verdict": demands(result), "violations": violations, "tracking": result.tracking}
    return {JUDGED: plain(found | {"figures": result.figures}, exact=True)}


def demands(result: ScenarioResult) -> list[dict[str, Any]]:
    """Every demand of a verdict with what came out, those that failed first: what ``wbc run --json`` prints of it."""
    return [
        {"demand": c.text, "value": float(c.value), "relation": c.relation, "bound": float(c.bound), "unit": c.unit,
         "ok": c.ok, **c.place._asdict()}
        for c in failed_first(result.verdict)
    ]  # fmt: skip


def outline(result: ScenarioResult) -> dict[str, Any]:
    """What came of one of many runs, in JSON's types: None for what its record does not tell."""
    run = result.run
    return {
        "ok": bool(result.ok),
        "error": None,
        "ended": str(run.meta.get("ended", "complete")),
        "seconds": plain(measure.seconds(run)) if "dt" in run.meta else None,
        "ticks": run.rows,
        "solved": measure.statuses(run).get("SOLVED", 0) if "statuses" in run.meta else None,
        "late": measure.late(run) if "tick_us" in run and "dt" in run.meta else 0,
        "tracking": {task: plain(float(value["rms"])) for task, value in result.tracking.items()},
        "violations": {kind: [plain(float(worst)), unit] for kind, (worst, unit) in result.violations.items()},
        "tick_us": [plain(x) for x in measure.tick_times(run)] if "tick_us" in run else [None] * 3,
    }


def judged(run: Run, robot: RobotModel | None) -> ScenarioResult:
    """A recorded run with what :func:`judgement` kept of it; measured from its columns where nothing was kept."""
    kept = run.meta.get(JUDGED)
    if not isinstance(kept, Mapping):
        return ScenarioResult(run, True, measure.violations(run), {}, (), robot=robot)
    try:
        verdict = [
            Check(d["demand"], float(d["value"]), d["relation"], float(d["bound"]), d["unit"],
                  Place(d["at"], d["part"], d["plot"]))
            for d in kept["verdict"]
        ]  # fmt: skip
        violations = {kind: (float(worst), unit) for kind, (worst, unit) in kept["violations"].items()}
        tracking = {task: {k: float(x) for k, x in part.items()} for task, part in kept["tracking"].items()}
        return ScenarioResult(run, bool(kept["ok"]), violations, tracking, verdict, kept["figures"], robot)
    except (KeyError, TypeError, ValueError, AttributeError) as cause:
        raise InvalidInput(f"the run's meta[{JUDGED!r}] is not what a scenario says of its run: {cause}") from cause


def fits(robot: RobotModel, run: Run) -> bool:
    """Whether it can be the robot of the run."""
    return list(robot.joint_names) == list(run.meta.get("joint_names", ())) and run["q"].shape[1:] == (robot.nq,)


def named(run: Run) -> RobotModel | None:
    """The robot of the run's name, or the planar one that the run describes; None where neither can be made."""
    from wbc.models import load

    name, planar = str(run.meta.get("robot")), run.meta.get("planar")
    if not name.replace("_", "").isalnum():  # a path: a record says which files are read no more than a pickle would
        return None
    try:
        if planar is None:
            robot: RobotModel = load(name, base=run.meta.get("base"))
        else:
            robot = described(name, planar, run.meta["limits"])
    except (WbcError, KeyError, TypeError, ValueError):
        return None
    return robot if fits(robot, run) else None


def plain(value: Any, *, exact: bool = False) -> Any:
    """``value`` in JSON's types, no numpy. Nine digits and no NaN, no infinity; ``exact``: numbers as they are."""
    if isinstance(value, Mapping):
        return {str(key): plain(item, exact=exact) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist(), exact=exact)
    if isinstance(value, float) and not exact:
        return float(f"{value:.9g}") if isfinite(value) else None
    if value is None or isinstance(value, str | bool | int | float):
        return value
    return [plain(item, exact=exact) for item in value] if isinstance(value, Sequence) else str(value)


def missing(run: Run) -> list[str]:
    """What a report cannot do without, and the run does not have."""
    return [*(name for name in NEEDED_META if name not in run.meta), *(name for name in NEEDED if name not in run)]


def checked(run: Run, robot: RobotModel | None, name: str = "run") -> RobotModel | None:
    """The robot, once it is sure that a report can be made of the run, which its giver calls ``name``, and of it.

    Raises:
        InvalidInput: no run, one without the columns and metadata that a report needs, or of another robot.
        NotSupported: a package that reports need is not installed.
    """
    check_kinds(run, robot, name)
    lacks = missing(run)
    if lacks or not run.rows:
        what = f"has no {', '.join(lacks)}" if lacks else "has no ticks"
        raise InvalidInput(f"the run {what}; a report needs a run of wbc.Recorder.tick or of simulate")
    if robot is not None and not fits(robot, run):
        raise InvalidInput(f"robot is {robot.name}, with other joints or another base than the run's")
    require_extras()
    return robot
