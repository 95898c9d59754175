"""Limits: what the joints of a robot can do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arguments import TellsArguments
from wbc.types import Vec


@final
@dataclass(frozen=True, eq=False)
class Limits(metaclass=TellsArguments):
    """Limits of each joint, (nj,) each: position [rad, m], speed [rad/s, m/s], torque [N m, N]; ±inf: none.

    The numbers are the model's own, even where they make no sense (a speed limit of 0 in a URDF): the limit that uses
    them refuses them by joint name. Those of a file beyond 1e8, as Gazebo writes 1e16, are none.
    """

    q_min: Vec
    q_max: Vec
    v_max: Vec
    tau_max: Vec


def finite_interval(limits: Limits, span: Vec) -> tuple[Vec, Vec]:
    """Position limits, up to 2 span wide where one of them is infinite; ±span where they make no sense, and where both
    are 0, as in a URDF that says nothing."""
    low, high = limits.q_min, limits.q_max
    sane = (low < high) | ((low == high) & (low != 0.0))
    low = np.where(np.isfinite(low), low, np.minimum(-span, high - 2 * span))
    high = np.where(np.isfinite(high), high, np.maximum(span, low + 2 * span))
    return np.where(sane, low, -span), np.where(sane, high, span)
