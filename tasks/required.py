"""Required: what a task asks of a robot, beside frames and joints by name."""

from __future__ import annotations

from wbc.errors import NotSupported
from wbc.models.model import RobotModel


def gravity_down(name: str, model: RobotModel) -> None:
    """That gravity acts along −z.

    Raises:
        NotSupported: it acts along another direction, or there is none.
    """
    if model.gravity[:2].any() or not model.gravity[2] < 0.0:
        raise NotSupported(f"{name} needs gravity along −z, not {model.gravity.tolist()}")


def inertia(name: str, model: RobotModel) -> None:
    """That M is positive definite.

    Raises:
        NotSupported: it is singular; with the joints with which no inertia moves.
    """
    if model.weightless:
        raise NotSupported(f"{name} needs M > 0, and no inertia moves with {', '.join(model.weightless)}")
