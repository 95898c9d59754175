"""RelativeFrame: tracks position and orientation of one frame of the robot, seen from another."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.tracking import Tracking, pose_target

from .motions import pose_motion, swing
from .relative import check_frames
from .trajectories import Sinusoid


@final
class RelativeFrame(Tracking, KernelTask):
    """e = (p_target − p, log(R_target Rᵀ)): six rows, position [m] then orientation [rad], axes of ``reference``.

    (p, R) is the pose of ``frame`` in ``reference``. ``target``: pinocchio.SE3 or 4x4 matrix, the same pose; its rate
    and acceleration (6,) are linear before angular, as seen from the reference. ``weight`` is a scalar or (6,).

    Raises:
        InvalidInput: a target that is no pose; the same frame twice. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import RelativeFrame
        >>> bar = [[1, 0, 0, 0], [0, 1, 0, 0.4], [0, 0, 1, 0], [0, 0, 0, 1]]
        >>> RelativeFrame("left_hand", reference="right_hand", target=bar).name
        'RelativeFrame[left_hand in right_hand]'
    """

    dim, units, convert = 6, ("m", "m", "m", "rad", "rad", "rad"), staticmethod(pose_target)
    labels = ("x", "y", "z", "roll", "pitch", "yaw")
    read_once = frozenset({"frame_of_reference"})

    def __init__(
        self, frame: str, *, reference: str, target: Any, kp: Any = 100.0, kd: Any = None, rate: Any = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame, self.frame_of_reference = frame, reference
        self.subject = f"{frame} in {reference}"
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        check_frames(model, self.name, self.frame, self.frame_of_reference)

    def kernel_rows(self) -> KernelRows:
        frames = self.frame, self.frame_of_reference
        return KernelRows.tracking(self, "wbc.tasks.compiled.frame:relative_pose", *frames, numbers=range(6))

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        position = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=0.5)
        motion = pose_motion(position, swing(np.eye(3), [1, 2, 3], angle=0.4, frequency=0.6))
        first, last = model.frame_names[len(model.frame_names) // 4], model.frame_names[-1]
        return [cls(last, reference=first, target=target) for target in (np.eye(4), motion)]
