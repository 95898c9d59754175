"""How one frame of a robot moves seen from another: what relative tasks and closed loops share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio

from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.types import Mat, Vec

_NO_DRIFT = np.full(6, np.nan)


class RelativeMotion(NamedTuple):
    """A frame in the axes and from the origin of another: position (3,), rotation (3, 3), Jacobian (6, nv), linear
    rows first, and drift J̇ v (6,), NaN in a state without drifts."""

    position: Vec
    rotation: Mat
    J: Mat
    drift: Vec


def relative_motion(state: RobotState, frame: str, reference: str) -> RelativeMotion:
    """``frame`` seen from ``reference``. With d = p − p_ref, ω_ref the reference's angular velocity and R its axes:

    ẋ = Rᵀ (ḋ − ω_ref × d)                                       ω_rel = Rᵀ (ω − ω_ref)
    ẍ = Rᵀ (d̈ − ω̇_ref × d − 2 ω_ref × ḋ + ω_ref × (ω_ref × d))    ω̇_rel = Rᵀ (ω̇ − ω̇_ref − ω_ref × ω)

    Example:
        >>> import wbc
        >>> from wbc.tasks.relative import relative_motion
        >>> state = wbc.load("humanoid").state()
        >>> relative_motion(state, "left_sole", "right_sole").position.round(3)
        array([0.  , 0.18, 0.  ])
    """
    moving, fixed = state.frame(frame), state.frame(reference)
    J, J_ref = moving.jacobian(), fixed.jacobian()
    to_reference = fixed.rotation.T
    d = moving.position - fixed.position
    arm = pinocchio.skew(d)
    rows = J - J_ref
    rows[:3] += np.dot(arm, J_ref[3:])
    return RelativeMotion(
        np.dot(to_reference, d),
        np.dot(to_reference, moving.rotation),
        np.concatenate([np.dot(to_reference, rows[:3]), np.dot(to_reference, rows[3:])]),
        _drift(state, frame, reference, d) if state.drifts else _NO_DRIFT,
    )


def _drift(state: RobotState, frame: str, reference: str, d: Vec) -> Vec:
    moving, fixed = state.frame(frame), state.frame(reference)
    twist, twist_ref = np.dot(moving.jacobian(), state.v), np.dot(fixed.jacobian(), state.v)
    drift_ref = fixed.drift()
    change = moving.drift() - drift_ref
    spin = pinocchio.skew(twist_ref[3:])
    change[:3] -= np.dot(pinocchio.skew(drift_ref[3:]), d)
    change[:3] -= np.dot(spin, 2.0 * (twist[:3] - twist_ref[:3]) - np.dot(spin, d))
    change[3:] -= np.dot(spin, twist[3:])
    seen: Vec = np.dot(change.reshape(2, 3), fixed.rotation).reshape(6)  # Rᵀ x as rows: xᵀ R
    return seen


def check_frames(model: RobotModel, name: str, frame: str, reference: str) -> None:
    """That both exist and are two.

    Raises:
        UnknownFrame: with the names that are near. InvalidInput: the same frame twice.
    """
    model.check_frame(frame)
    model.check_frame(reference)
    if frame == reference:
        raise InvalidInput(f"{name}: {frame!r} seen from itself never moves; give two frames")
