"""JointVelocityLimits: limits joint velocities."""

from __future__ import annotations

from typing import Any, ClassVar, final

from wbc.models.model import RobotModel
from wbc.stack.constraint import JointInterval, Quantity
from wbc.types import Vec

from .per_joint import per_joint, positive


@final
class JointVelocityLimits(JointInterval):
    """−v_max <= v <= v_max [rad/s, m/s]; ``v_max``: scalar, (nj,), {joint: value}, default the model's.

    Raises:
        InvalidInput: zero, negative or NaN, the model's own included, by joint name. UnknownJoint.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointVelocityLimits
        >>> lower, upper = JointVelocityLimits(0.5).bounds(wbc.load("arm"))
        >>> float(lower[0]), float(upper[0])
        (-0.5, 0.5)
    """

    quantity: ClassVar[Quantity] = "velocity"
    read_once = frozenset({"v_max"})

    def __init__(self, v_max: Any = None, *, name: str | None = None) -> None:
        super().__init__(name=name)
        self.v_max = v_max

    def prepare(self, model: RobotModel) -> None:
        self.bounds(model)

    def bounds(self, model: RobotModel) -> tuple[Vec, Vec]:
        what = f"{self.name}.v_max"
        v_max = positive(what, per_joint(what, self.v_max, model, model.limits.v_max), model)
        return -v_max, v_max
