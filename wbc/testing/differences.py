"""Derivatives by differences: along a velocity, and in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio

from wbc.models.model import RobotModel
from wbc.testing.robots import Moment
from wbc.tolerances import NOISE, ROUNDING
from wbc.types import Mat, Vec

#: Step of the configuration [rad, m] and of time [s].
STEP, TIME_STEP = 1e-5, 1e-4


def along(read: Callable[[Moment], Vec], model: RobotModel, moment: Moment, direction: Vec) -> Vec:
    """d read / ds along q ⊕ s · direction (nv,), central."""
    t, q, v = moment
    ahead, behind = (read((t, model.integrate(q, s * direction), v)) for s in (STEP, -STEP))
    return (ahead - behind) / (2.0 * STEP)


def in_time(read: Callable[[Moment], Vec], moment: Moment) -> Vec:
    """d read / dt in the same configuration at the same velocity, central."""
    t, q, v = moment
    return (read((t + TIME_STEP, q, v)) - read((t - TIME_STEP, q, v))) / (2.0 * TIME_STEP)


def row_sizes(rows: Sequence[tuple[Mat, Vec]]) -> Vec:
    """What differences of each row are judged by (m,), from its Jacobian and its value at several moments.

    It is the largest entry of the row, so that units far apart do not hide mistakes: 1 where that is rounding, as where
    no joint moves the row, and no less than what rounding of the value can be told from along ``STEP``.
    """
    J, value = (np.max([np.abs(one[i]) for one in rows], axis=0) for i in (0, 1))
    size = J.max(axis=1)
    largest = float(size.max())
    largest = largest if largest > NOISE else 1.0
    size[size <= ROUNDING * largest] = min(largest, 1.0)
    result: Vec = np.maximum(size, np.finfo(float).eps / STEP**2 * value)
    return result


def velocity_names(model: RobotModel) -> list[str]:
    """What each entry of v is called."""
    base = ["base x", "base y", "base z", "base roll", "base pitch", "base yaw"][: model.nb]
    return base + list(model.joint_names)


def rotation_blocks(units: Sequence[str]) -> list[slice]:
    """Rows that may be rotation vectors: runs of "rad" in threes."""
    blocks, row = [], 0
    while row < len(units):
        if list(units[row : row + 3]) == ["rad"] * 3:
            blocks.append(slice(row, row + 3))
            row += 3
        else:
            row += 1
    return blocks


def turned_by_robot(start: Vec, error: Vec) -> Vec:
    """From a rotation error log(R_t Rᵀ), minus the rotation vector (world axes) the robot turned by since ``start``."""
    turned: Vec = pinocchio.log3(_exp(start).T @ _exp(error))
    return turned


def turned_by_target(start: Vec, error: Vec) -> Vec:
    """The same error seen from the other side: the rotation vector the target turned by since ``start``."""
    turned: Vec = pinocchio.log3(_exp(error) @ _exp(start).T)
    return turned


def _exp(vector: Vec) -> Mat:
    rotation: Mat = pinocchio.exp3(np.array(vector))
    return rotation
