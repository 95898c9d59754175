"""The motion as a scene of the page: robot, floor, forces, pushes, centre of mass, targets and support; works offline.

The scene is drawn by ``assets/scene.js`` with three.js, at the time of the page's clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Scene
from wbc.report.motion import Motion, motion, quaternions
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
STRAINED = 1e-3  # a joint this near to a limit of its position, of its range, or of its torque, is drawn red

SAID = "Drag to turn, scroll to come nearer. Red: a joint at a limit. An arrow of half a metre: the robot's weight."
FORCE, COMMANDED, PUSH, CENTRE, SUPPORT = "#2f8f5b", "#3b82d0", "#c53d3d", "#dd7a1f", "#1f9aa0"
TARGETS = ("#7a5bb5", "#2b6cb0", "#c2408a", "#8c6d46")


def replay(
    run: Run, robot: RobotModel, solid: Sequence[Part], *, name: str = "motion", caption: str = "",
    obstacles: Sequence[Obstacle] = ()
) -> Scene:  # fmt: skip
    """The run of ``robot``, drawn as ``solid``: parts of the robot's links and of ``obstacles``."""
    solid, rows = thinned(solid, BUDGET), _frames(run)
    moving = motion(run, robot, rows, sorted({part.link for part in solid}), obstacles)
    number = {link: k for k, link in enumerate(moving.links)}
    middle, size = moving.extent
    strained = _strained(run, robot)
    content = {
        "times": _floats(moving.times - moving.times[0]), "middle": middle.tolist(), "size": size, "view": VIEW,
        "links": [
            {"pose": _floats(np.column_stack([position, quaternions(rotation)])), "strained": strained.get(link)}
            for link, (position, rotation) in moving.links.items()
        ],
        "parts": [
            {"link": number[part.link], "vertices": _floats(part.vertices), "faces": text(part.faces.astype("<u4")),
             "color": "#{:02x}{:02x}{:02x}".format(*part.color)}
            for part in solid
        ],
        "arrows": _arrows(moving), "points": _points(moving, robot), "loops": _loops(moving),
    }  # fmt: skip
    return Scene(name, caption or SAID, content)


def _frames(run: Run) -> Index:
    """Rows of the run to show, the last among them."""
    dt = float(run.meta["dt"])
    step = max(1, round(1.0 / (FRAMES_PER_SECOND * dt)), -(-run.rows // MAX_FRAMES))
    return np.unique(np.append(np.arange(0, run.rows, step), run.rows - 1))


def _arrows(moving: Motion) -> list[dict[str, Any]]:
    """Arrows for the contact forces and for the push; none for what the run does not have."""
    sets = [("contact forces", FORCE, moving.forces, False), ("commanded forces", COMMANDED, moving.commanded, True)]
    if np.any(moving.pushes[:, 0] != moving.pushes[:, 1]):
        sets.append(("push", PUSH, moving.pushes[:, None], False))
    return [
        {"label": label, "color": color, "count": ends.shape[1], "ends": _floats(ends), "hidden": hidden}
        for label, color, ends, hidden in sets if ends.shape[1]
    ]  # fmt: skip


def _points(moving: Motion, robot: RobotModel) -> list[dict[str, Any]]:
    """Centre of mass of a robot that is free, and the targets of tasks, with their trails."""
    shown = [("centre of mass", CENTRE, moving.com)] if robot.nb else []
    shown += [
        (f"target of {task}", TARGETS[k % len(TARGETS)], path) for k, (task, path) in enumerate(moving.targets.items())
    ]
    return [{"label": label, "color": color, "path": _floats(path)} for label, color, path in shown]


def _loops(moving: Motion) -> list[dict[str, Any]]:
    """The support polygon, whose corners that it does not have at a moment lie on its last one, and friction cones."""
    cones = [
        {"label": f"friction cone of {name}", "group": "friction cones", "color": FORCE, "count": line.shape[1],
         "corners": _floats(line), "hidden": True}
        for name, line in moving.cones.items()
    ]  # fmt: skip
    most = max((len(corners) for corners in moving.support if corners is not None), default=0)
    if not most:
        return cones
    drawn = np.zeros((len(moving.support), most, 3))
    for k, corners in enumerate(moving.support):
        if corners is not None:
            drawn[k] = corners[np.minimum(np.arange(most), len(corners) - 1)]
            drawn[k, :, 2] += 2e-3  # above the lines of the floor
    return [{"label": "support polygon", "color": SUPPORT, "count": most, "corners": _floats(drawn)}, *cones]


def _strained(run: Run, robot: RobotModel) -> dict[str, list[tuple[float, float]]]:
    """When the joint that moves a link is at a limit, by the link's name."""
    links = {joint.name: joint.child for joint in robot.urdf.joints} if isinstance(robot, PinocchioModel) else {}
    use = measure.use(run)
    near = use["position"] >= 1.0 - STRAINED
    if "torque" in use:
        near = near | (use["torque"] >= 1.0 - STRAINED)
    names = list(run.meta["joint_names"])
    return {
        link: measure.intervals(run, near[:, names.index(joint)])
        for joint, link in links.items() if joint in names and near[:, names.index(joint)].any()
    }  # fmt: skip


def _floats(values: Vec) -> str:
    return text(np.asarray(values, dtype="<f4"))
