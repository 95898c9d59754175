"""Robots: what they must answer (model), Pinocchio behind it, and ``load``. Knows no optimisation.

Importing this loads no robot library; the first robot does.
"""

from __future__ import annotations

from wbc.models.loading import load
from wbc.models.model import FrameState, Limits, Pose, RobotModel, RobotState

__all__ = ["FrameState", "Limits", "Pose", "RobotModel", "RobotState", "load"]
