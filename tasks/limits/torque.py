"""TorqueLimits: limits joint torques."""

from __future__ import annotations

from typing import Any, ClassVar, final

from wbc.models.model import RobotModel
from wbc.stack.constraint import JointInterval, Quantity
from wbc.types import Vec

from .per_joint import per_joint, positive


@final
class TorqueLimits(JointInterval):
    """−tau_max <= τ <= tau_max [N m, N]; ``tau_max``: scalar, (nj,), {joint: value}, default the model's.

    Raises:
        InvalidInput: zero, negative or NaN, the model's own included, by joint name. UnknownJoint.

    Example:
        >>> import wbc
        >>> from wbc.tasks import TorqueLimits
        >>> lower, upper = TorqueLimits(40.0).bounds(wbc.load("arm"))
        >>> float(lower[0]), float(upper[0])
        (-40.0, 40.0)
    """

    quantity: ClassVar[Quantity] = "torque"
    read_once = frozenset({"tau_max"})

    def __init__(self, tau_max: Any = None, *, name: str | None = None) -> None:
        super().__init__(name=name)
        self.tau_max = tau_max

    def prepare(self, model: RobotModel) -> None:
        self.bounds(model)

    def bounds(self, model: RobotModel) -> tuple[Vec, Vec]:
        what = f"{self.name}.tau_max"
        tau_max = positive(what, per_joint(what, self.tau_max, model, model.limits.tau_max), model)
        return -tau_max, tau_max
