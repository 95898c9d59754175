"""The way of the centre of mass over the feet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wbc.report import measure, style
from wbc.report.document import Section
from wbc.report.motion import ContactPoint
from wbc.sim.scenario import ScenarioResult
from wbc.types import Mat, Vec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wbc.models.model import RobotModel

SAMPLES = 800


def section(result: ScenarioResult) -> Section | None:
    """The path seen from above, with the soles and their hull, and the height over time; for a floating base only."""
    run, robot = result.run, result.robot
    if robot is None or robot.nb == 0 or not run.rows:
        return None
    rows = np.unique(np.linspace(0, run.rows - 1, SAMPLES).astype(int))
    q = np.asarray(run.columns.get("plant.q", run["q"]))[rows]
    com, soles = _centres(robot, q), _soles(result)
    t = measure.times(run)[rows]
    with style.Canvas(1, 2, height=3.5, widths=(1, 1.15)) as canvas:
        above, time = canvas.axes
        _seen_from_above(above, com, soles)
        style.shade(time, measure.pushes(run))
        for i, axis in enumerate("xyz"):
            time.plot(t, 1e3 * (com[:, i] - com[0, i]), color=style.CYCLE[i], label=axis)
        time.set_title("Moved from where it began")
        time.set_xlabel("time [s]")
        time.set_ylabel("displacement [mm]")
        time.set_xlim(t[0], max(t[-1], t[0] + 1e-9))
        style.legend(time)
        caption = (
            "Left: the centre of mass seen from above, over the contacts as they were at the start and their hull. "
            "Right: its displacement." + style.shaded(run)
        )
        return Section("Centre of mass", [canvas.figure("centre_of_mass", caption)])


def _centres(robot: RobotModel, q: Vec) -> Mat:
    state, rest = robot.state(), np.zeros(robot.nv)
    com = np.empty((len(q), 3))
    for i, row in enumerate(q):
        state.update(0.0, row, rest)
        com[i] = state.com
    return com


def _soles(result: ScenarioResult) -> list[Mat]:
    """Corners (k, 2) of every contact on the ground at the start; one corner for a point."""
    run, robot = result.run, result.robot
    assert robot is not None, "the section is only made for a robot"
    state = robot.state()
    state.update(0.0, np.asarray(run.columns.get("plant.q", run["q"]))[0], np.zeros(robot.nv))
    soles = []
    for contact in run.meta.get("contacts", {}).values():
        if contact.get("frame") not in robot.frame_names:
            continue
        rotation, point = state.frame(contact["frame"]).rotation, ContactPoint.of(robot, contact["frame"]).at(state)
        x, y = contact.get("half_size") or (0.0, 0.0)
        signs = ((1, 1), (1, -1), (-1, -1), (-1, 1)) if x else ((0, 0),)
        corners = [point + rotation @ np.array([sx * x, sy * y, 0.0]) for sx, sy in signs]
        soles.append(np.array(corners)[:, :2])
    return soles


def _seen_from_above(axes: Axes, com: Mat, soles: list[Mat]) -> None:
    points = np.vstack([*soles, np.zeros((0, 2))])
    if len(points) > 2:
        from scipy.spatial import ConvexHull

        hull = points[ConvexHull(points).vertices]
        axes.fill(hull[:, 0], hull[:, 1], facecolor="none", edgecolor=style.RED, linewidth=0.9, linestyle=(0, (4, 3)))
    for sole in soles:
        if len(sole) > 1:
            axes.fill(sole[:, 0], sole[:, 1], facecolor=style.PAPER, edgecolor=style.FAINT, linewidth=0.8)
        else:
            axes.plot(*sole[0], marker="o", color=style.FAINT, markersize=5)
    axes.plot(com[:, 0], com[:, 1], color=style.BLUE, linewidth=1.0)
    axes.plot(*com[0, :2], marker="o", color=style.GREEN, markersize=4, linestyle="", label="start")
    axes.plot(*com[-1, :2], marker="s", color=style.ORANGE, markersize=4, linestyle="", label="end")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("Seen from above")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    style.legend(axes)
