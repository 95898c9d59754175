"""AxisConeLimit: keeps an axis of a frame within an angle of a direction."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, Self, final

import numpy as np

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelBarrier
from wbc.stack.kernel_rows import KernelRows

from .directions import unit


@final
class AxisConeLimit(KernelBarrier):
    """h = b·d − cos α >= 0: the axis b = R a of a frame within ``angle`` α [rad] of the direction d of the world.

    ``axis`` a (3,) in the frame, ``direction`` d (3,) in the world, of any length but zero. A carried cup stays
    upright, a camera looks ahead, and how the frame turns about the axis is free.

    Raises:
        InvalidInput: an axis or direction of length zero, an angle not between 0 and π. UnknownFrame: when a stack is
            compiled.

    Example:
        >>> from wbc.tasks import AxisConeLimit
        >>> AxisConeLimit("tool", axis=[0, 0, 1], direction=[0, 0, -1], angle=0.3)
        AxisConeLimit[tool]
    """

    dim, units = 1, "1"
    checked: ClassVar[Mapping[str, Any]] = {
        "axis": unit, "direction": unit, "angle": partial(checks.number, low=0.0, high=np.pi, strict=True),
    }  # fmt: skip

    def __init__(
        self, frame: str, *, axis: Any, direction: Any, angle: float, rate: float = 10.0,
        slack: float | None = 1e6, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(rate=rate, slack=slack, name=name)
        self.axis, self.direction = axis, direction
        self.angle = angle

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        return KernelRows(
            "wbc.tasks.compiled.limit:axis_cone", (self.frame,), [*self.axis, *self.direction, self.angle]
        )

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(model.frame_names[-1], axis=[0.0, 0.3, 1.0], direction=[0.2, 0.0, 1.0], angle=1.0)]
