"""Gaze: points an axis of a frame, such as that of a camera, at a point of the world."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, Self, final

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .directions import unit_axis, view_axes
from .trajectories import Sinusoid


@final
class Gaze(Tracking, KernelTask):
    """e = the two angles [rad] at which the point x lies beside ``axis``, as seen from the frame's origin: two rows.

    The same as :class:`~tasks.axis_alignment.AxisAlignment` with the direction x − p, which changes as the frame moves
    about: |e| is the angle between the axis and the line of sight, turning about it is free. Nearer than ``nearest``
    [m], x − p is divided by ``nearest`` and not by its length, so that e and J go to zero with it.

    ``axis`` (3,) in the frame (the optical axis of a camera is often z); ``target`` (3,) [m], or a function of time
    giving it or (position, velocity, acceleration).

    Raises:
        InvalidInput: an axis that is zero, a target of another shape. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Gaze
        >>> Gaze("head", axis=[1, 0, 0], target=[2.0, 0.5, 1.0], kp=50)
        Gaze[head](weight=1.0)
    """

    dim, units, labels, convert = 2, "rad", ("across b1", "across b2"), staticmethod(vector_target(3))
    read_once = frozenset({"axis"})
    checked: ClassVar[Mapping[str, Any]] = {"nearest": partial(checks.number, low=0.0, strict=True)}
    target_dim = 3

    def __init__(
        self, frame: str, *, axis: Any, target: Any, nearest: float = 0.01, kp: Any = 100.0, kd: Any = None,
        rate: Any = None, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.axis = unit_axis(f"{self.name}.axis", axis)
        self.nearest = nearest
        self._view = view_axes(self.axis)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        numbers = [*self._view.ravel(), self.nearest]
        return KernelRows.tracking(self, "wbc.tasks.compiled.direction:gaze", self.frame, numbers=numbers)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame, moving = model.frame_names[-1], Sinusoid([1.0, 0.5, 2.2], amplitude=0.3, frequency=[0.5, 0.7, 0.9])
        return [cls(frame, axis=[0, 0, 1], target=[2.0, 0.5, 1.0]), cls(frame, axis=[1, 2, 0], target=moving)]
