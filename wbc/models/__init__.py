"""Robots: what they must answer (model), Pinocchio behind it and ``load``, and planar robots.

Importing this loads no robot library; the first robot does. It loads no sympy; the first derivation does.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from wbc.models.chain import Chain
from wbc.models.loading import load

if TYPE_CHECKING:
    from wbc.models.limits import Limits
    from wbc.models.model import FrameState, Pose, RobotModel, RobotState
    from wbc.models.planar_robots import Planar4P, PlanarPR

__all__ = ["Chain", "FrameState", "Limits", "Planar4P", "PlanarPR", "Pose", "RobotModel", "RobotState", "load"]

_HOME = {
    "FrameState": "wbc.models.model",
    "Limits": "wbc.models.limits",
    "Planar4P": "wbc.models.planar_robots",
    "PlanarPR": "wbc.models.planar_robots",
    "Pose": "wbc.models.model",
    "RobotModel": "wbc.models.model",
    "RobotState": "wbc.models.model",
}


def __getattr__(name: str) -> Any:
    if name == "lagrange":
        return import_module("wbc.models.lagrange")
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'wbc.models' has no attribute {name!r}")
