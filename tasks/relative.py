"""Kinematics of one frame of a robot relative to another, shared by relative tasks and closed loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio

from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.types import Mat, Vec


class RelativeMotion(NamedTuple):
    """A frame in the axes and from the origin of another: position (3,), rotation (3, 3), Jacobian (6, nv), linear
    rows first."""

    position: Vec
    rotation: Mat
    J: Mat


def relative_motion(state: RobotState, frame: str, reference: str) -> RelativeMotion:
    """``frame`` seen from ``reference``. With d = p − p_ref, ω_ref the reference's angular velocity and R its axes:
    ẋ = Rᵀ (ḋ − ω_ref × d), ω_rel = Rᵀ (ω − ω_ref).

    Example:
        >>> import wbc
        >>> from wbc.tasks.relative import relative_motion
        >>> state = wbc.load("humanoid").state()
        >>> relative_motion(state, "left_sole", "right_sole").position.round(3)
        array([0.  , 0.18, 0.  ])
    """
    moving, fixed = state.frame(frame), state.frame(reference)
    rows, J_ref, to_reference = moving.jacobian() - fixed.jacobian(), fixed.jacobian(), fixed.rotation.T
    d = moving.position - fixed.position
    rows[:3] += np.dot(pinocchio.skew(d), J_ref[3:])
    J = np.concatenate([np.dot(to_reference, rows[:3]), np.dot(to_reference, rows[3:])])
    return RelativeMotion(np.dot(to_reference, d), np.dot(to_reference, moving.rotation), J)


def check_frames(model: RobotModel, name: str, frame: str, reference: str) -> None:
    """That both exist and are two.

    Raises:
        UnknownFrame: with the names that are near. InvalidInput: the same frame twice.
    """
    model.check_frame(frame)
    model.check_frame(reference)
    if frame == reference:
        raise InvalidInput(f"{name}: {frame!r} seen from itself never moves; give two frames")
