"""Yaw: tracks the heading: the direction of an axis of a frame, seen from above."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self, final

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking
from wbc.types import Vec

from .directions import unit_axis
from .trajectories import Sinusoid


@final
class Yaw(Tracking, KernelTask):
    """e = ψ_target − ψ [rad] in [−π, π): one row. ψ = atan2(u_y, u_x), u = R ``axis`` in the world.

    ψ̇ = (u_x u̇_y − u_y u̇_x) / ρ², ρ² = u_x² + u_y². An upright axis points nowhere on the map: below ρ = 0.01, half a
    degree from upright, ψ̇ is computed with 0.01, so that it stays finite.

    ``axis`` (3,) in the frame, by default its x; ``target`` [rad], any number of turns, or a function of time giving it
    or (angle, rate, acceleration), (1,) each.

    Raises:
        InvalidInput: an axis that is zero, a target that is no number. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Yaw
        >>> Yaw("torso", target=0.5, kp=50)
        Yaw[torso](weight=1.0)
    """

    dim, units, labels = 1, "rad", ("yaw",)
    checked: ClassVar[Mapping[str, Any]] = {"axis": unit_axis}

    def __init__(
        self, frame: str, *, target: Any, axis: Any = (1.0, 0.0, 0.0), kp: Any = 100.0, kd: Any = None,
        rate: Any = None, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.axis = axis
        self.target = target

    @staticmethod
    def convert(name: str, value: Any, strict: bool) -> Vec:
        """An angle, as a number or (1,)."""
        return _angle(name, [value] if checks.ndim(value) == 0 else value, strict)

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.direction:yaw", self.frame, numbers=self.axis)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame, moving = model.frame_names[-1], Sinusoid([0.3], amplitude=0.5, frequency=0.7)
        return [cls(frame, target=0.2), cls(frame, target=moving, axis=[0.0, 1.0, 1.0])]


_angle = vector_target(1)
