"""ConeLimit: keeps a frame inside a cone."""

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
class ConeLimit(KernelBarrier):
    """h = z sin α − r cos α >= 0 [m]: the origin of a frame inside a cone, h its distance from the cone's side.

    With p the origin, d = p − apex: z = a·d is the height along the unit axis a, r = √(|d − z a|² + (1 mm)²) the
    distance from it, α the half opening ``angle`` [rad], between 0 and π/2.

    Raises:
        InvalidInput: an axis of length zero, an angle out of range. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import ConeLimit
        >>> ConeLimit("tool", apex=[0.5, 0, 0], axis=[0, 0, 1], angle=0.5)  # approach from above
        ConeLimit[tool]
    """

    dim, units = 1, "m"
    checked: ClassVar[Mapping[str, Any]] = {
        "apex": partial(checks.array, shape=(3,)), "axis": unit,
        "angle": partial(checks.number, low=0.0, high=0.5 * np.pi, strict=True),
    }  # fmt: skip

    def __init__(
        self, frame: str, *, apex: Any, axis: Any, angle: float, rate: float = 10.0, slack: float | None = 1e6,
        name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(rate=rate, slack=slack, name=name)
        self.apex = apex
        self.axis = axis
        self.angle = angle

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        return KernelRows("wbc.tasks.compiled.limit:cone", (self.frame,), [*self.apex, *self.axis, self.angle])

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(model.frame_names[-1], apex=[0.2, -0.1, 0.0], axis=[0.1, 0.2, 1.0], angle=0.6)]
