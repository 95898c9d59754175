"""Directions: what axis alignment and gaze share."""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.types import Mat, Vec


def unit_axis(name: str, value: Any) -> Vec:
    """``value`` (3,) scaled to length one.

    Raises:
        InvalidInput: another shape, not finite, or no direction at all.
    """
    axis = checks.array(name, value, (3,))
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise InvalidInput(f"{name} is {axis.tolist()}; a direction is not zero")
    return axis / length


def direction_target(name: str, value: Any, strict: bool) -> Vec:
    """Reader of directions (3,): of any length but zero, which is looked at when a target is assigned."""
    if strict:
        unit_axis(name, value)
    direction = np.asarray(value, dtype=np.float64)
    if direction.shape != (3,):
        raise InvalidInput(f"{name} must have shape (3,), not {direction.shape}")
    return direction


def view_axes(axis: Vec) -> Mat:
    """Rows b₁, b₂ and ``axis``, right-handed and orthonormal: the axes of somebody who looks along ``axis``."""
    across = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = across - (across @ axis) * axis
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first), axis])
