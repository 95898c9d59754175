"""JointAccelerationLimits: limits joint accelerations."""

from __future__ import annotations

from typing import Any, ClassVar, Self, final

import numpy as np

from wbc.models.model import RobotModel
from wbc.stack.constraint import JointInterval, Quantity
from wbc.types import Vec

from .per_joint import per_joint, positive


@final
class JointAccelerationLimits(JointInterval):
    """−a_max <= a <= a_max [rad/s², m/s²]; ``a_max``: scalar, (nj,), or {joint: value}, inf for the joints left out.

    Raises:
        InvalidInput: zero, negative or NaN, by joint name. UnknownJoint.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointAccelerationLimits
        >>> lower, upper = JointAccelerationLimits(20.0).bounds(wbc.load("arm"))
        >>> float(lower[0]), float(upper[0])
        (-20.0, 20.0)
    """

    quantity: ClassVar[Quantity] = "acceleration"
    read_once = frozenset({"a_max"})

    def __init__(self, a_max: Any, *, name: str | None = None) -> None:
        super().__init__(name=name)
        self.a_max = a_max

    def prepare(self, model: RobotModel) -> None:
        self.bounds(model)

    def bounds(self, model: RobotModel) -> tuple[Vec, Vec]:
        what = f"{self.name}.a_max"
        a_max = positive(what, per_joint(what, self.a_max, model, np.full(model.nj, np.inf)), model)
        return -a_max, a_max

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(20.0), cls({model.joint_names[0]: 5.0})]
