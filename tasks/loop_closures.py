"""loop_closures: what closes the loops that a robot's description speaks of."""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.models.pinocchio_ import PinocchioModel

from .criteria.manipulability import ROWS
from .loop_closure import LoopClosure
from .relative import relative_motion

#: A direction in which no joint moves the ends of a loop against each other, by this much [m/rad, 1] and random states.
_STILL, _STATES = 1e-9, 4


@tells_arguments
def loop_closures(robot: PinocchioModel, **settings: Any) -> list[LoopClosure]:
    """A :class:`~tasks.loop_closure.LoopClosure` for each loop of the robot's description; ``settings`` are each's.

    These are MJCF's equalities of bodies and sites: ``<connect>`` holds a point, ``<weld>`` a pose. The robot is a tree
    without them: they belong in ``contacts``. Directions in which the mechanism keeps itself (across the plane of a
    planar one) are left out.

    Raises:
        InvalidInput: no robot from wbc.load.

    Example:
        >>> import wbc
        >>> from wbc.tasks import loop_closures
        >>> loop_closures(wbc.load("arm"))
        []
    """
    checks.instance("robot", robot, PinocchioModel, "a robot from wbc.load(...)")
    state, rng = robot.state(), np.random.default_rng(0)
    closures = []
    for loop in robot.urdf.loops:
        moving = np.zeros(6)
        for _ in range(_STATES):
            state.update(0.0, robot.random_configuration(rng), np.zeros(robot.nv))
            moving = np.maximum(moving, np.abs(relative_motion(state, loop.frame, loop.to).J).max(axis=1))
        rows = [row for row, size in zip(ROWS, moving, strict=True) if size > _STILL and (loop.weld or len(row) == 1)]
        pose = np.eye(4)
        closures.append(LoopClosure(loop.frame, to=loop.to, rows=rows, target=pose, name=loop.name, **settings))
    return closures
