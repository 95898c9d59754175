"""What is drawn around the robot: forces, pushes, targets, centre of mass, support polygon, friction cones.

Three kinds of mark, each a shape that moves: whoever draws a :class:`~wbc.report.motion.Motion` draws these, in a page,
in a picture or in a window.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np

from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.motion import Motion
from wbc.types import Mat

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.model import RobotModel

STRAINED = 1e-3  # a joint this near to a limit of its position, of its range, or of its torque, is drawn red
RED = "#d23b3b"

FORCE, COMMANDED, PUSH, CENTRE, SUPPORT = "#2f8f5b", "#3b82d0", "#c53d3d", "#dd7a1f", "#1f9aa0"
TARGETS = ("#7a5bb5", "#2b6cb0", "#c2408a", "#8c6d46")


@final
@dataclass(frozen=True, eq=False)
class Mark:
    """A mark at the k moments of a motion. ``points`` is (k, m, 3) [m]: m/2 arrows from tail to tip, one point, or the
    corners of a closed line. ``group``: the name under which several marks are shown or hidden."""

    kind: str
    label: str
    color: str
    points: Mat
    hidden: bool = False
    group: str = ""

    @property
    def name(self) -> str:
        """What a legend calls it."""
        return self.group or self.label


def above_ground(ends: Mat) -> Mat:
    """Arrows (k, 2, 3), those from below a floor that hides them moved to begin where they end: a force of the ground
    then begins where it acts."""
    below = ends[:, :1, 2:] < 0.0
    return np.where(below, ends + (ends[:, 1:] - ends[:, :1]), ends)


def marks(moving: Motion, robot: RobotModel) -> list[Mark]:
    """Every mark of the motion; none for what the run does not have."""
    return [*_arrows(moving), *_points(moving, robot), *_lines(moving)]


def _arrows(moving: Motion) -> list[Mark]:
    sets = [("contact forces", FORCE, moving.forces, False), ("commanded forces", COMMANDED, moving.commanded, True)]
    if np.any(moving.pushes[:, 0] != moving.pushes[:, 1]):
        sets.append(("push", PUSH, moving.pushes[:, None], False))
    return [
        Mark("arrow", label, color, ends.reshape(len(ends), -1, 3), hidden)
        for label, color, ends, hidden in sets if ends.shape[1]
    ]  # fmt: skip


def _points(moving: Motion, robot: RobotModel) -> list[Mark]:
    """Centre of mass of a robot that is free, and the targets of tasks."""
    shown = [("centre of mass", CENTRE, moving.com)] if robot.nb else []
    shown += [
        (f"target of {task}", TARGETS[k % len(TARGETS)], path) for k, (task, path) in enumerate(moving.targets.items())
    ]
    return [Mark("point", label, color, path[:, None]) for label, color, path in shown]


def _lines(moving: Motion) -> list[Mark]:
    """The support polygon, whose corners that it does not have at a moment lie on its last one, and friction cones."""
    cones = [
        Mark("line", f"friction cone of {name}", FORCE, line, True, "friction cones")
        for name, line in moving.cones.items()
    ]
    most = max((len(corners) for corners in moving.support if corners is not None), default=0)
    if not most:
        return cones
    drawn = np.zeros((len(moving.support), most, 3))
    for k, corners in enumerate(moving.support):
        if corners is not None:
            drawn[k] = corners[np.minimum(np.arange(most), len(corners) - 1)]
            drawn[k, :, 2] += 2e-3  # above the lines of the floor
    return [Mark("line", "support polygon", SUPPORT, drawn), *cones]


def strained(run: Run, robot: RobotModel) -> dict[str, list[tuple[float, float]]]:
    """When the joint that moves a link is at a limit, by the link's name: intervals (start, end) [s]."""
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
