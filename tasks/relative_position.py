"""RelativePosition: tracks the position of one frame of the robot, seen from another."""

from __future__ import annotations

from typing import Any, Self, final

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .relative import check_frames
from .trajectories import Sinusoid


@final
class RelativePosition(Tracking, KernelTask):
    """e = p_target − p [m]: three rows, axes of ``reference``.

    p is the origin of ``frame`` from that of ``reference``. ``target``: (3,), or a function of time giving it or
    (position, velocity, acceleration) as seen from the reference.

    Raises:
        InvalidInput: a target of another shape; the same frame twice. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import RelativePosition
        >>> RelativePosition("left_hand", reference="torso", target=[0.4, 0.2, 0.0]).name
        'RelativePosition[left_hand in torso]'
    """

    dim, units, labels, convert = 3, "m", "xyz", staticmethod(vector_target(3))
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
        return KernelRows.tracking(self, "wbc.tasks.compiled.frame:relative_pose", *frames, numbers=range(3))

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        first, last = model.frame_names[len(model.frame_names) // 4], model.frame_names[-1]
        moving = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9])
        return [cls(last, reference=first, target=target) for target in ([0.3, 0.0, 0.5], moving)]
