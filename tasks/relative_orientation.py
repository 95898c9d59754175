"""RelativeOrientation: tracks the orientation of one frame of the robot, seen from another."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.tracking import Tracking, rotation_target

from .motions import swing
from .relative import check_frames


@final
class RelativeOrientation(Tracking, KernelTask):
    """e = log(R_target Rᵀ) [rad]: three rows, axes of ``reference``.

    R are the axes of ``frame`` in those of ``reference``. ``target``: rotation (3, 3), by default the identity (both
    point the same way), or a function of time giving it or (rotation, angular velocity, angular acceleration) as seen
    from the reference.

    Raises:
        InvalidInput: a target that is no rotation; the same frame twice. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import RelativeOrientation
        >>> RelativeOrientation("left_hand", reference="right_hand", weight=0.1).name
        'RelativeOrientation[left_hand in right_hand]'
    """

    dim, units, labels, convert = 3, "rad", ("roll", "pitch", "yaw"), staticmethod(rotation_target)
    read_once = frozenset({"frame_of_reference"})

    def __init__(
        self, frame: str, *, reference: str, target: Any = ((1, 0, 0), (0, 1, 0), (0, 0, 1)), kp: Any = 100.0,
        kd: Any = None, rate: Any = None, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame, self.frame_of_reference = frame, reference
        self.subject = f"{frame} in {reference}"
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        check_frames(model, self.name, self.frame, self.frame_of_reference)

    def kernel_rows(self) -> KernelRows:
        frames = self.frame, self.frame_of_reference
        return KernelRows.tracking(self, "wbc.tasks.compiled.frame:relative_pose", *frames, numbers=range(3, 6))

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        first, last = model.frame_names[len(model.frame_names) // 4], model.frame_names[-1]
        moving = swing(np.eye(3), [1, 2, 3], angle=0.4, frequency=0.6)
        return [cls(last, reference=first), cls(last, reference=first, target=moving)]
