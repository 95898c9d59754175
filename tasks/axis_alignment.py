"""AxisAlignment: points an axis of a frame along a direction of the world; rotation about the axis is free."""

from __future__ import annotations

from typing import Any, Self, final

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.tracking import Tracking

from .directions import direction_target, unit_axis, view_axes
from .trajectories import Sinusoid


@final
class AxisAlignment(Tracking, KernelTask):
    """e = the two angles [rad] at which the direction d lies beside ``axis``, as seen from the frame: two rows.

    With u = (b₁, b₂, a)ᵀ Rᵀ d, a the axis and b₁, b₂ across it: e = (θ / sin θ) (u₁, u₂), θ the angle between, |e| = θ.
    Two rows and never three, so that it may be a constraint, and at rest only where axis and direction agree. A
    direction exactly opposite to the axis counts as 0.01 rad to one side.

    ``axis`` (3,) in the frame; ``target`` (3,) in the world, both of any length; or a function of time giving the
    target or (direction, its first, its second derivative).

    Raises:
        InvalidInput: a direction that is zero or of another shape. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import AxisAlignment
        >>> AxisAlignment("tool", axis=[0, 0, 1], target=[0, 0, -1], kp=50).dim  # the tool points down
        2
    """

    dim, units, labels, convert = 2, "rad", ("across b1", "across b2"), staticmethod(direction_target)
    read_once = frozenset({"axis"})
    target_dim = 3

    def __init__(
        self, frame: str, *, axis: Any, target: Any, kp: Any = 100.0, kd: Any = None, rate: Any = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.axis = unit_axis(f"{self.name}.axis", axis)
        self._view = view_axes(self.axis)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(
            self, "wbc.tasks.compiled.direction:alignment", self.frame, numbers=self._view.ravel()
        )

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame, moving = model.frame_names[-1], Sinusoid([1.0, 0.5, 0.2], amplitude=0.8, frequency=[0.5, 0.7, 0.9])
        return [cls(frame, axis=[0, 0, 1], target=[0.0, 3.0, -1.0]), cls(frame, axis=[1, 2, 0], target=moving)]
