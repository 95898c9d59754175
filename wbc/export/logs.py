"""A recorded run as a log: every column as a series with named numbers, and the scene a few times a second."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from wbc import checks
from wbc.control.table import numbers, table
from wbc.errors import InvalidInput
from wbc.report.marks import Mark, marks
from wbc.report.measure import clock
from wbc.report.motion import Motion, motion, quaternions
from wbc.report.replay import BUDGET
from wbc.report.shapes import Part, parts, thinned
from wbc.types import Mat, Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.model import RobotModel

PICTURES_PER_SECOND = 50.0  # so often a log says where links and forces are; its numbers are those of every tick
TICK = "tick"  # the series of all columns that are one number
STATUS = "status"
ACTIVE = ("active.row", "active.bound", "active.multiplier")


@final
@dataclass(frozen=True, eq=False)
class Series:
    """Numbers (N, k) over the ticks, by ``names``, each in one of ``units``."""

    names: list[str]
    units: list[str]
    values: Mat


@final
@dataclass(frozen=True, eq=False)
class Log:
    """A run as logs hold it: ``times`` (N,) [s] and ``series`` by name; the name of each tick's status; at a few of the
    ticks, ``scene.times``, poses (k, 7) of the links, position before quaternion w x y z, and marks."""

    times: Vec
    series: dict[str, Series]
    status: NDArray[np.str_]
    solid: list[Part]
    scene: Motion | None
    poses: dict[str, Mat]
    marks: list[Mark]


def log(run: Run, robot: RobotModel | None) -> Log:
    """The run, and the scene around ``robot`` if somebody is to be drawn.

    Raises:
        InvalidInput: a run without ticks, or of no period.
    """
    if not run.rows:
        raise InvalidInput("the run has no ticks")
    found: dict[str, list[tuple[str, str, Vec]]] = defaultdict(list)
    for column, component, unit, values in numbers(run.columns, run.meta):
        if column in ("t", STATUS, *ACTIVE) or values.dtype.kind not in "biuf":
            continue
        if run.columns[column].ndim == 1:
            found[TICK].append((column, unit, values))
            continue
        number = component or unit
        while number in [name for name, _, _ in found[column]]:  # two rows of a task with one label
            number += "'"
        found[column].append((number, unit, values))
    series = {
        name: Series([n for n, _, _ in some], [u for _, u, _ in some], np.column_stack([v for _, _, v in some]))
        for name, some in found.items()
    }
    if all(column in run for column in ACTIVE) and run.meta.get("active_rows"):
        series["active"] = _active(run)
    times = clock(run)
    status = np.asarray(table(run, run.meta).get(STATUS, np.full(run.rows, "")), dtype=str)
    solid = [] if robot is None else thinned(parts(robot), BUDGET)
    if robot is None or not solid:
        return Log(times, series, status, [], None, {}, [])
    dt = checks.number("meta['dt'] of the run", run.meta.get("dt"), low=0.0, strict=True)
    step = max(1, round(1.0 / (PICTURES_PER_SECOND * dt)))
    rows = np.unique(np.append(np.arange(0, run.rows, step), run.rows - 1))
    moving = motion(run, robot, rows, sorted({part.link for part in solid}))
    poses = {link: np.column_stack([p, quaternions(rotation)]) for link, (p, rotation) in moving.links.items()}
    return Log(times, series, status, solid, moving, poses, marks(moving, robot))


def _active(run: Run) -> Series:
    """The multiplier of every row that was ever active, by the row's name; NaN where it was not."""
    rows = run.meta["active_rows"]
    values = np.full((run.rows, len(rows)), np.nan)
    ticks, slots = np.nonzero(np.isfinite(run["active.row"]))
    values[ticks, run["active.row"][ticks, slots].astype(int)] = run["active.multiplier"][ticks, slots]
    return Series([f"{row['owner']}: {row['label']}, {row['side']}" for row in rows], [""] * len(rows), values)
