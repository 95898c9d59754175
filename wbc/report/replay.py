"""The motion as a scene of the page: robot, floor, forces, pushes, centre of mass, targets and support; works offline.

The scene is drawn by ``assets/scene.js`` with three.js, at the time of the page's clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.report.document import Scene
from wbc.report.marks import Mark, marks, strained
from wbc.report.motion import motion, quaternions
from wbc.report.packed import text
from wbc.report.shapes import Part, thinned
from wbc.types import Index, Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.collision import Obstacle
    from wbc.models.model import RobotModel

FRAMES_PER_SECOND = 25.0  # the page moves the robot evenly between two of them
MAX_FRAMES = 1500  # a minute; a longer run is shown with fewer frames a second
BUDGET = 60_000  # triangles of the whole robot
VIEW = (1.15, -0.92, 0.42)  # where the camera stands, from the middle, in sizes of the scene

SAID = "Drag to turn, scroll to come nearer. Red: a joint at a limit. An arrow of half a metre: the robot's weight."


def replay(
    run: Run, robot: RobotModel, solid: Sequence[Part], *, name: str = "motion", caption: str = "",
    obstacles: Sequence[Obstacle] = ()
) -> Scene:  # fmt: skip
    """The run of ``robot``, drawn as ``solid``: parts of the robot's links and of ``obstacles``."""
    solid, rows = thinned(solid, BUDGET), _frames(run)
    moving = motion(run, robot, rows, sorted({part.link for part in solid}), obstacles)
    number = {link: k for k, link in enumerate(moving.links)}
    middle, size = moving.extent
    worn, shown = strained(run, robot), marks(moving, robot)
    content = {
        "times": _floats(moving.times - moving.times[0]), "middle": middle.tolist(), "size": size, "view": VIEW,
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
    return Scene(name, caption or SAID, content)


def _frames(run: Run) -> Index:
    """Rows of the run to show, the last among them."""
    dt = float(run.meta["dt"])
    step = max(1, round(1.0 / (FRAMES_PER_SECOND * dt)), -(-run.rows // MAX_FRAMES))
    return np.unique(np.append(np.arange(0, run.rows, step), run.rows - 1))


def _drawn(mark: Mark, **more: Any) -> dict[str, Any]:
    return {"label": mark.label, "color": mark.color, "hidden": mark.hidden, "group": mark.name} | more


def _floats(values: Vec) -> str:
    return text(np.asarray(values, dtype="<f4"))
