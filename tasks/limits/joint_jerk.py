"""JointJerkLimits: limits joint jerks."""

from __future__ import annotations

from typing import Any, ClassVar, Self, final

import numpy as np

from wbc.models.model import RobotModel
from wbc.stack.constraint import JointInterval, Quantity
from wbc.types import Vec

from .per_joint import per_joint, positive


@final
class JointJerkLimits(JointInterval):
    """|a − a_last| <= j_max dt [rad/s³, m/s³], a_last the acceleration commanded last, zero before the first tick.

    ``j_max``: scalar, (nj,), or {joint: value}, inf for the joints left out. Other limits are approached so that it can
    be kept, and stand above it: see :class:`~wbc.stack.interval.JointIntervals`. Where velocities are decided, an
    acceleration is the change from the measured one over the tick.

    Raises:
        InvalidInput: zero, negative or NaN, by joint name. UnknownJoint.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointJerkLimits
        >>> lower, upper = JointJerkLimits(500.0).bounds(wbc.load("arm"))
        >>> float(lower[0]), float(upper[0])
        (-500.0, 500.0)
    """

    quantity: ClassVar[Quantity] = "jerk"
    read_once = frozenset({"j_max"})

    def __init__(self, j_max: Any, *, name: str | None = None) -> None:
        super().__init__(name=name)
        self.j_max = j_max

    def prepare(self, model: RobotModel) -> None:
        self.bounds(model)

    def bounds(self, model: RobotModel) -> tuple[Vec, Vec]:
        what = f"{self.name}.j_max"
        j_max = positive(what, per_joint(what, self.j_max, model, np.full(model.nj, np.inf)), model)
        return -j_max, j_max

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(500.0), cls({model.joint_names[0]: 100.0})]
