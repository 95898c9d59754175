"""MidRange: how near the joints are to the middle of their ranges."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.types import Vec

from .criterion import Criterion


@final
class MidRange(Criterion):
    """H = −1/(2 n) Σ ((q_i − mid_i) / range_i)² over the n joints with two finite limits; zero in the middle.

    ∂H/∂q_i = −(q_i − mid_i) / (n range_i²), zero for a joint without limits.
    Source: Liégeois, IEEE Trans. Systems, Man, and Cybernetics 1977.

    Raises:
        InvalidInput: when a stack is compiled: no joint has a range, or one of them is not positive.

    Example:
        >>> import wbc
        >>> from wbc.tasks import MidRange
        >>> robot, middle = wbc.load("arm"), MidRange()
        >>> middle.prepare(robot)
        >>> middle.value(robot.state()) <= 0.0
        True
    """

    name, units = "mid-range", "1"

    def prepare(self, model: RobotModel) -> None:
        low, high = model.limits.q_min, model.limits.q_max
        ranged = np.isfinite(low) & np.isfinite(high)
        if not ranged.any():
            raise InvalidInput(f"MidRange: no joint of {model.name} has a range")
        for joint, lowest, highest in zip(model.joint_names, low, high, strict=True):
            if lowest >= highest:
                raise InvalidInput(
                    f"MidRange: joint {joint!r} has the range [{lowest:g}, {highest:g}]; it must not be empty"
                )
        self._middle = np.where(ranged, 0.5 * (np.where(ranged, low, 0.0) + np.where(ranged, high, 0.0)), 0.0)
        self._stiffness = np.where(ranged, 1.0 / (np.count_nonzero(ranged) * (high - low) ** 2), 0.0)

    def value(self, state: RobotState) -> float:
        away = state.q_joints - self._middle
        return float(-0.5 * (self._stiffness * away).dot(away))

    def gradient(self, state: RobotState) -> Vec:
        return self._stiffness * (self._middle - state.q_joints)
