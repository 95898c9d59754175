"""Kinematics: where frames are and how a robot moves over a whole motion, and what may touch the floor."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from wbc.models.pinocchio_ import PinocchioModel
from wbc.types import Mat, Vec


def placed(robot: PinocchioModel, q: Mat, frames: Mapping[str, str]) -> dict[str, tuple[Mat, Vec]]:
    """Positions (N, 3) [m] and rotations (N, 3, 3) of ``frames`` {name: frame} in configurations (N, nq), by name."""
    state, rest = robot.state(), np.zeros(robot.nv)
    found = {name: (np.empty((len(q), 3)), np.empty((len(q), 3, 3))) for name in frames}
    for k, row in enumerate(q):
        state.update(0.0, row, rest)
        for name, (positions, rotations) in found.items():
            frame = state.frame(frames[name])
            positions[k], rotations[k] = frame.position, frame.rotation
    return found


def velocities(robot: PinocchioModel, q: Mat, rate: float) -> tuple[Mat, Mat, Mat]:
    """Velocities and accelerations (N, nv) of configurations (N, nq), and the steps q_{k+1} ⊖ q_k (N − 1, nv)."""
    steps = np.array([robot.difference(one, other) for one, other in pairwise(q)])
    v = np.vstack([steps[:1], 0.5 * (steps[1:] + steps[:-1]), steps[-1:]]) * rate
    a = np.diff(steps, axis=0) * rate**2
    return v, np.vstack([a[:1], a, a[-1:]]), steps


def lowest(robot: PinocchioModel, frame: str, positions: Mat, rotations: Vec) -> Vec:
    """The points (N, k, 3) of a foot that may touch first, where its frame is there; of other frames their origin."""
    points = robot.feet[frame].lowest() if frame in robot.feet else [((0.0, 0.0, 0.0), 0.0)]
    below = np.array([[0.0, 0.0, radius] for _, radius in points])
    at = np.array([point for point, _ in points]) @ rotations.transpose(0, 2, 1)
    return np.asarray(positions[:, None] + at - below)
