"""Along a motion: where frames are and how a robot moves, over many configurations at a constant rate."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from wbc.models.model import RobotModel
from wbc.types import Mat, Vec


def placed(robot: RobotModel, q: Mat, frames: Mapping[str, str]) -> dict[str, tuple[Mat, Vec]]:
    """Positions (N, 3) [m] and rotations (N, 3, 3) of ``frames`` {name: frame} in configurations (N, nq), by name."""
    state, rest = robot.state(), np.zeros(robot.nv)
    found = {name: (np.empty((len(q), 3)), np.empty((len(q), 3, 3))) for name in frames}
    for k, row in enumerate(q):
        state.update(0.0, row, rest)
        for name, (positions, rotations) in found.items():
            frame = state.frame(frames[name])
            positions[k], rotations[k] = frame.position, frame.rotation
    return found


def velocities(robot: RobotModel, q: Mat, rate: float) -> tuple[Mat, Mat, Mat]:
    """Velocities and accelerations (N, nv) of configurations (N, nq), and the steps q_{k+1} ⊖ q_k (N − 1, nv).

    Both are central differences; those of the first and the last frame are their neighbours'.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.models.along import velocities
        >>> robot = wbc.load("arm")
        >>> v, a, steps = velocities(robot, np.outer([0.0, 0.1, 0.3], np.ones(robot.nq)), 10.0)
        >>> v[:, 0].round(3), a[:, 0].round(3)
        (array([1. , 1.5, 2. ]), array([10., 10., 10.]))
    """
    steps = np.array([robot.difference(one, other) for one, other in pairwise(q)])
    v = np.vstack([steps[:1], 0.5 * (steps[1:] + steps[:-1]), steps[-1:]]) * rate
    a = np.diff(steps, axis=0) * rate**2
    return v, np.vstack([a[:1], a, a[-1:]]), steps
