"""Frame: tracks position and orientation of a frame."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.tracking import Tracking, pose_target

from .motions import pose_motion, swing
from .trajectories import Sinusoid


@final
class Frame(Tracking, KernelTask):
    """e = (p_target − p, log(R_target Rᵀ)): six rows, position [m] then orientation [rad], world axes.

    ``target``: pinocchio.SE3 or 4x4 matrix; its rate and acceleration (6,) are linear before angular, world axes.
    ``weight`` is a scalar or (6,); ``position_weight`` and ``orientation_weight`` replace it for three rows each.

    Raises:
        InvalidInput: a target that is no pose. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Frame
        >>> Frame("tool", target=[[1, 0, 0, 0.4], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]], kp=400).name
        'Frame[tool]'
    """

    dim, units, convert = 6, ("m", "m", "m", "rad", "rad", "rad"), staticmethod(pose_target)
    labels = ("x", "y", "z", "roll", "pitch", "yaw")

    def __init__(
        self, frame: str, *, target: Any, kp: Any = 100.0, kd: Any = None, rate: Any = None, weight: Any = 1.0,
        position_weight: float | None = None, orientation_weight: float | None = None, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        if position_weight is not None or orientation_weight is not None:
            halves = [weight if half is None else half for half in (position_weight, orientation_weight)]
            weight = np.repeat(np.array(halves, dtype=object), 3)
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.frame:pose", self.frame, numbers=range(6), leads=True)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        position = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=0.5)
        motion = pose_motion(position, swing(np.eye(3), [1, 2, 3], angle=0.4, frequency=0.6))
        return [cls(model.frame_names[-1], target=target) for target in (np.eye(4), motion)]
