"""A few moments of the motion side by side, drawn without any 3-D engine: for print and for plain text."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from wbc import checks
from wbc.report import measure
from wbc.report.document import Figure, number
from wbc.report.motion import Motion, motion
from wbc.report.shapes import Part, thinned, view
from wbc.types import Index, Mat, Vec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wbc.control.recorder import Run
    from wbc.models.collision import Obstacle
    from wbc.models.model import RobotModel

MOMENTS = 5
WIDTH = 8.4  # inches
GREEN, RED = "#2f8f5b", "#c53d3d"
BUDGET = 20_000  # triangles of the robot in a still
LIGHT = np.array([0.35, -0.5, 0.8])


def stills(
    run: Run, robot: RobotModel, solid: Sequence[Part], *, moments: int = MOMENTS, obstacles: Sequence[Obstacle] = ()
) -> Figure:
    """The robot, drawn as ``solid``, at ``moments`` times, seen from its front right."""
    solid = thinned(solid, BUDGET)
    rows = _moments(run, moments)
    times = measure.times(run)[rows]
    moving = motion(run, robot, rows, sorted({part.link for part in solid}), obstacles)
    right, up, towards = _camera(robot)
    scene = [_projected(solid, moving, i, np.array([right, up, towards])) for i in range(len(rows))]
    arrows = np.concatenate([moving.forces.reshape(-1, 3), moving.pushes.reshape(-1, 3)]) @ np.array([right, up]).T
    drawn = [points[..., :2].reshape(-1, 2) for points, _ in scene] + [arrows[np.any(arrows != 0, axis=1)]]
    low = np.min([points.min(axis=0) for points in drawn if len(points)], axis=0)
    high = np.max([points.max(axis=0) for points in drawn if len(points)], axis=0)
    width, height = np.maximum(high - low, 0.2) * 1.08
    tall = min(4.6, WIDTH / len(rows) * height / width)
    checks.packages("a picture", "matplotlib", extra="report")
    from matplotlib import rc_context
    from matplotlib.figure import Figure as Drawing

    memory = BytesIO()
    with rc_context({"font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"], "text.color": "#1f2a37"}):
        drawing = Drawing(figsize=(WIDTH, tall + 0.3), layout="constrained", facecolor="white")
        grid = drawing.subplots(1, len(rows), squeeze=False)[0]
        for i, (axes, (points, colours)) in enumerate(zip(grid, scene, strict=True)):
            _floor(axes, right, up, moving)
            _draw(axes, points, colours)
            _force_lines(axes, moving, i, np.array([right, up]))
            middle = 0.5 * (low + high)
            axes.set_xlim(middle[0] - width / 2, middle[0] + width / 2)
            axes.set_ylim(middle[1] - height / 2, middle[1] + height / 2)
            axes.set_aspect("equal")
            axes.axis("off")
            axes.set_title(f"{number(times[i])} s", loc="center", fontsize=8.5)
        drawing.savefig(memory, format="png", dpi=170, metadata={"Software": None})
    pushed = ", at the ends of pushes" if measure.pushes(run) else ""
    caption = f"The robot at the start, at the end{pushed} and between."
    return Figure("motion", caption, memory.getvalue(), "png")


def _moments(run: Run, count: int) -> Index:
    """Rows of the start, the end and the ends of pushes; the widest gaps are filled off their middle.

    Halving would meet a periodic motion in the same phase again and again.
    """
    dt = float(run.meta["dt"])
    ends = [round(end / dt) - 1 for _, end in measure.pushes(run)]
    rows = sorted({0, run.rows - 1, *ends[: max(0, count - 2)]})
    while len(rows) < min(count, run.rows):
        start, end = max(pairwise(rows), key=lambda gap: gap[1] - gap[0])
        rows = sorted({*rows, start + max(1, round(0.38 * (end - start)))})
    return np.array(rows)


def _camera(robot: RobotModel) -> tuple[Vec, Vec, Vec]:
    towards = np.array(view(robot)) / np.linalg.norm(view(robot))
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return right, np.cross(towards, right), towards


def _projected(solid: list[Part], moving: Motion, i: int, axes: Mat) -> tuple[Mat, Mat]:
    """All triangles (m, 3, 3) in the camera's axes, the farthest first, and their shaded colours (m, 3)."""
    triangles, colours = [], []
    light = LIGHT / np.linalg.norm(LIGHT)
    for part in solid:
        position, rotation = (values[i] for values in moving.links[part.link])
        corners = (part.vertices @ rotation.T + position)[part.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        bright = 0.45 + 0.55 * np.abs(normal @ light)[:, None] / np.maximum(length, 1e-12)
        triangles.append(corners @ axes.T)
        colours.append(np.clip(bright * (0.25 + 0.75 * np.array(part.color) / 255.0), 0.0, 1.0))
    points, shade = np.concatenate(triangles), np.concatenate(colours)
    order = np.argsort(points[..., 2].mean(axis=1), kind="stable")
    return points[order], shade[order]


def _draw(axes: Axes, points: Mat, colours: Mat) -> None:
    from matplotlib.collections import PolyCollection

    axes.add_collection(PolyCollection(list(points[..., :2]), facecolors=colours, edgecolors=colours, linewidths=0.25))


def _floor(axes: Axes, right: Vec, up: Vec, moving: Motion) -> None:
    """A few lines of a floor of half a metre."""
    centre, size = moving.extent
    reach = np.ceil(size) + 0.5
    for s in np.arange(-reach, reach + 0.1, 0.5):
        for ends in (([s, -reach], [s, reach]), ([-reach, s], [reach, s])):
            line = np.array([[x + round(centre[0]), y + round(centre[1]), 0.0] for x, y in ends])
            axes.plot(line @ right, line @ up, color="#e3e7eb", linewidth=0.6, zorder=0)


def _force_lines(axes: Axes, moving: Motion, i: int, camera: Mat) -> None:
    """Contact forces in green, pushes in red."""
    for arrows, colour in ((moving.forces[i], GREEN), (moving.pushes[i : i + 1], RED)):
        for tail, tip in arrows @ camera.T:
            if np.linalg.norm(tip - tail) > 1e-6:
                arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.1, "mutation_scale": 7}
                axes.annotate("", xy=tuple(tip), xytext=tuple(tail), arrowprops=arrow)
