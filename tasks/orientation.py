"""Orientation: tracks the orientation of a frame."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.tracking import Tracking, rotation_target

from .motions import swing


@final
class Orientation(Tracking, KernelTask):
    """e = log(R_target Rᵀ) [rad]: three rows, world axes.

    ``target``: rotation (3, 3), by default the identity (the frame's axes along the world's: upright), or a function
    of time giving it or (rotation, angular velocity, angular acceleration), world axes.

    Raises:
        InvalidInput: a target that is no rotation. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Orientation
        >>> Orientation("torso", kp=100, weight=0.1)
        Orientation[torso](weight=0.1)
    """

    dim, units, labels, convert = 3, "rad", ("roll", "pitch", "yaw"), staticmethod(rotation_target)

    def __init__(
        self, frame: str, *, target: Any = ((1, 0, 0), (0, 1, 0), (0, 0, 1)), kp: Any = 100.0, kd: Any = None,
        rate: Any = None, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.frame:pose", self.frame, numbers=range(3, 6))

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        motion = swing(np.eye(3), [1, 2, 3], angle=0.4, frequency=0.6)
        return [cls(model.frame_names[-1]), cls(model.frame_names[-1], target=motion)]
