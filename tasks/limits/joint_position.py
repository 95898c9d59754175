"""JointPositionLimits: limits joint positions, with room to brake."""

from __future__ import annotations

from typing import Any, ClassVar, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.constraint import JointInterval, Quantity
from wbc.types import Vec

from .per_joint import per_joint


@final
class JointPositionLimits(JointInterval):
    """lower <= q <= upper [rad, m], kept so that the joint can always brake in time.

    ``lower``, ``upper``: scalar, (nj,), {joint: value}, default the model's; equal ones hold a joint still; by name
    only, because one number alone would read like ± that number. ``braking``
    [rad/s², m/s²] is the deceleration counted on: by default the acceleration limit, or 20 where there is none. See
    :class:`~wbc.stack.interval.JointIntervals` for the bounds this gives with velocity and acceleration limits.

    Raises:
        InvalidInput: NaN, or lower > upper, the model's own included, by joint name. UnknownJoint.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointPositionLimits
        >>> robot = wbc.load("arm")
        >>> constraint = JointPositionLimits(upper={robot.joint_names[0]: 0.5}, braking=10.0)
        >>> float(constraint.bounds(robot)[1][0])
        0.5
    """

    quantity: ClassVar[Quantity] = "position"
    read_once = frozenset({"braking", "lower", "upper"})

    def __init__(
        self, *, lower: Any = None, upper: Any = None, braking: float | None = None, name: str | None = None
    ) -> None:
        super().__init__(name=name)
        self.lower, self.upper = lower, upper
        if braking is not None:
            self.braking = checks.number(f"{self.name}.braking", braking, low=0.0, strict=True)

    def prepare(self, model: RobotModel) -> None:
        self.bounds(model)

    def bounds(self, model: RobotModel) -> tuple[Vec, Vec]:
        lower = per_joint(f"{self.name}.lower", self.lower, model, model.limits.q_min)
        upper = per_joint(f"{self.name}.upper", self.upper, model, model.limits.q_max)
        wrong = [
            f"joint {joint!r} has limits [{low:g}, {high:g}]"
            for joint, low, high in zip(model.joint_names, lower.tolist(), upper.tolist(), strict=True)
            if not (low <= high and low < np.inf and high > -np.inf)
        ]
        if wrong:
            raise InvalidInput(
                f"{self.name}: {'; '.join(wrong)}; lower must not be above upper. "
                "Pass lower={joint: value} or upper={joint: value} to overrule the model"
            )
        return lower, upper

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        joint = model.joint_names[0]
        return [
            cls(),
            cls(lower=-1.0, upper=np.full(model.nj, 1.0), braking=5.0),
            cls(lower={joint: 0.0}, upper={joint: 0.0}),
        ]
