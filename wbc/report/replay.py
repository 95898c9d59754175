"""The motion as a scene of the page: robot, floor, forces, pushes, centre of mass, targets and support; works offline.

The scene is drawn by ``assets/scene.js`` with three.js, at the time of the page's clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.report.document import Scene
from wbc.report.marks import Mark, marks, strained
from wbc.report.motion import Motion, motion, quaternions
from wbc.report.packed import text
from wbc.report.shapes import Part, thinned, view
from wbc.types import Index, Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.collision import Obstacle
    from wbc.models.model import RobotModel

FRAMES_PER_SECOND = 25.0  # the page moves the robot evenly between two of them
MAX_FRAMES = 1500  # a minute; a longer run is shown with fewer frames a second
BUDGET = 60_000  # triangles of the whole robot

SAID = "Drag to rotate, scroll to zoom. Red: a joint at a limit."
ARROWS = " An arrow of 0.5 m is the weight of the robot."
GHOSTS = "Transparent: the other runs at the same time."
#: Of the runs that are compared, in the scene and in the plots (``--curve-0`` and so on in ``assets/page.css``).
RUNS = ("#2b6cb0", "#d2691e", "#2f8f5b", "#7a5bb5", "#1f9aa0", "#8c6d46", "#c2408a", "#6b7a1f")


def replay(
    run: Run, robot: RobotModel, solid: Sequence[Part], *, obstacles: Sequence[Obstacle] = (), called: str = "",
    place: int = 0
) -> Scene:  # fmt: skip
    """The run of ``robot``, drawn as ``solid``: parts of the robot's links and of ``obstacles``.

    ``called`` is the run's name and ``place`` its place among those that are compared.
    """
    solid, rows = thinned(solid, BUDGET), _frames(run)
    moving = motion(run, robot, rows, sorted({part.link for part in solid}), obstacles)
    number = {link: k for k, link in enumerate(moving.links)}
    middle, size = _room(moving, solid)
    worn, shown = strained(run, robot), marks(moving, robot)
    content = {
        "label": called, "color": RUNS[place % len(RUNS)],
        "times": _floats(moving.times - moving.times[0]), "middle": middle.tolist(), "size": size, "view": view(robot),
        "links": [
            {"pose": _floats(np.column_stack([position, quaternions(rotation)])), "strained": worn.get(link)}
            for link, (position, rotation) in moving.links.items()
        ],
        "parts": [
            {"link": number[part.link], "vertices": _floats(part.vertices), "faces": text(part.faces.astype("<u4")),
             "color": "#{:02x}{:02x}{:02x}".format(*part.color)}
            for part in solid
        ],
        "arrows": [_drawn(m, count=m.points.shape[1] // 2, ends=_floats(m.points)) for m in shown if m.kind == "arrow"],
        "points": [_drawn(m, path=_floats(m.points)) for m in shown if m.kind == "point"],
        "loops": [_drawn(m, count=m.points.shape[1], corners=_floats(m.points)) for m in shown if m.kind == "line"],
    }  # fmt: skip
    return Scene(robot.name, SAID + ARROWS * bool(content["arrows"]), content)


def together(scenes: Sequence[Scene]) -> Scene:
    """Runs in one scene at the same time: the first as it is, the others seen through."""
    first, *others = scenes
    same = [{"parts": None} if one.content["parts"] == first.content["parts"] else {} for one in others]
    ghosts = [{**one.content, **shared} for one, shared in zip(others, same, strict=True)]
    size = min(max(one.content["size"] for one in scenes), 2.0 * first.content["size"])  # one that fell may fly far
    return Scene(first.name, f"{GHOSTS} {first.caption}", {**first.content, "size": size}, ghosts)


def _frames(run: Run) -> Index:
    """Rows of the run to show, the last among them."""
    dt = float(run.meta["dt"])
    step = max(1, round(1.0 / (FRAMES_PER_SECOND * dt)), -(-run.rows // MAX_FRAMES))
    return np.unique(np.append(np.arange(0, run.rows, step), run.rows - 1))


def _room(moving: Motion, solid: Sequence[Part]) -> tuple[Vec, float]:
    """Middle (3,) [m] and size [m] of where the links go, and of what is drawn of them at first."""
    low, high = moving.reach
    for part in solid:
        position, rotation = (values[0] for values in moving.links[part.link])
        corners = part.vertices @ rotation.T + position
        low, high = np.minimum(low, corners.min(axis=0)), np.maximum(high, corners.max(axis=0))
    return 0.5 * (low + high), max(float(np.linalg.norm(high - low)), 0.5)


def _drawn(mark: Mark, **more: Any) -> dict[str, Any]:
    return {"label": mark.label, "color": mark.color, "hidden": mark.hidden, "group": mark.name} | more


def _floats(values: Vec) -> str:
    return text(np.asarray(values, dtype="<f4"))
