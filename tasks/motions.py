"""Rotations and poses that move: functions of time giving (value, rate, acceleration), the derivatives exact."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pinocchio

from wbc import checks
from wbc.types import Mat, Vec

from .trajectories import Sinusoid

Motion = Callable[[float], tuple[Any, Vec, Vec]]


def swing(rotation: Any, axis: Any, *, angle: float, frequency: float, ramp: float = 1.0) -> Motion:
    """``rotation`` (3, 3) turned about a world axis (3,) by r(t) angle sin(2π frequency t) [rad]; rates in world axes.

    Example:
        >>> import numpy as np
        >>> from wbc.tasks.motions import swing
        >>> swing(np.eye(3), axis=[0, 0, 1], angle=0.5, frequency=1.0, ramp=0.0)(0.0)[1].round(3)
        array([0.   , 0.   , 3.142])
    """
    start = checks.array("rotation", rotation, (3, 3))
    direction = checks.array("axis", axis, (3,))
    direction /= np.linalg.norm(direction)
    turn = Sinusoid([0.0], amplitude=angle, frequency=frequency, ramp=ramp)
    return partial(_swung, start, direction, turn)


def _swung(start: Mat, direction: Vec, turn: Motion, t: float) -> tuple[Mat, Vec, Vec]:
    value, rate, acceleration = turn(t)
    return pinocchio.exp3(value * direction) @ start, rate * direction, acceleration * direction


def pose_motion(position: Motion, rotation: Motion) -> Motion:
    """A pose whose origin follows one motion and whose axes follow another: a target of ``Frame``.

    Example:
        >>> import numpy as np
        >>> from wbc.tasks import Sinusoid
        >>> from wbc.tasks.motions import pose_motion, swing
        >>> circle = Sinusoid([0.4, 0.0, 0.5], amplitude=0.1, frequency=0.5, phase=[0.0, np.pi / 2, 0.0])
        >>> pose_motion(circle, swing(np.eye(3), [0, 0, 1], angle=0.3, frequency=0.5))(0.0)[1].shape
        (6,)
    """
    return partial(_posed, position, rotation)


def _posed(position: Motion, rotation: Motion, t: float) -> tuple[Any, Vec, Vec]:
    p, p_rate, p_second = position(t)
    r, r_rate, r_second = rotation(t)
    return pinocchio.SE3(r, p), np.concatenate([p_rate, r_rate]), np.concatenate([p_second, r_second])
