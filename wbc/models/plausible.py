"""Plausibility: numbers that are allowed and look as if they were in another unit are warned about, not refused."""

from __future__ import annotations

import warnings
from math import pi

import numpy as np

from wbc.models.model import RobotModel
from wbc.types import Vec


class ImplausibleUnit(UserWarning):
    """A number that looks like degrees, milliseconds or millimetres."""


def doubt(sentence: str) -> None:
    """Warn."""
    warnings.warn(sentence, ImplausibleUnit, stacklevel=2)


def joints(model: RobotModel, name: str, positions: Vec) -> None:
    """Joint positions (nj,) beyond a whole turn, of joints whose limits are within one, look like degrees."""
    turning = np.array([unit == "rad" for unit in model.joint_units])
    low, high = model.limits.q_min, model.limits.q_max
    far = turning & (low >= -2.0 * pi) & (high <= 2.0 * pi) & (np.abs(positions) > 2.0 * pi)
    if far.any():
        i = int(far.argmax())
        doubt(
            f"{name} has {positions[i]:g} rad for joint {model.joint_names[i]!r}, whose limits are "
            f"[{low[i]:g}, {high[i]:g}]: are these degrees?"
        )


def position(model: RobotModel, name: str, point: Vec) -> None:
    """Points ten times farther than any frame of a robot with a fixed base is in q0 look like millimetres."""
    if model.nb:
        return
    state = model.state()
    reach = max([0.1, *(float(np.linalg.norm(state.frame(frame).position)) for frame in model.frame_names)])
    if np.abs(point).max(initial=0.0) > 10.0 * reach:
        doubt(f"{name} is {point} m, more than ten times as far as {model.name} reaches: are these millimetres?")


def period(dt: float) -> None:
    """Ticks of half a second and more look like milliseconds."""
    if dt >= 0.5:
        doubt(f"dt is {dt:g} s: are these milliseconds?")
