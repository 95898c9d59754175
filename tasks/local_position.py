"""LocalPosition: tracks the position of a frame along its own axes: a drill that is free along its axis."""

from __future__ import annotations

from typing import Any, Self, final

from wbc import checks
from wbc.models import plausible
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .position import AXES
from .trajectories import Sinusoid


@final
class LocalPosition(Tracking, KernelTask):
    """e = Rᵀ (p_target − p) [m]: one row for each of ``axes`` of the frame itself, by default all three.

    With one or two axes, or other weights for each, the rest of the way to the target is free or matters less, and
    turns with the frame: as masks and costs of TSID, Pink and mink do. :class:`~tasks.Position` has world axes.
    J v = ν + ω × e, ν and ω being the frame's velocities in its own axes.

    ``target`` (3,): a point of the world, or a function of time giving it or (position, velocity, acceleration).

    Raises:
        InvalidInput: axes that are not some of "xyz" in this order, a target of another shape.
        UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import LocalPosition
        >>> LocalPosition("tool", target=[0.4, 0.0, 0.5], axes="xy").dim  # anywhere on a line along the tool's z
        2
    """

    units, convert = "m", staticmethod(vector_target(3))
    target_dim = 3

    def __init__(
        self, frame: str, *, target: Any, axes: str = "xyz", kp: Any = 100.0, kd: Any = None, rate: Any = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        checks.one_of(f"{self.name}.axes", axes, AXES)
        self.dim, self.labels = len(axes), axes
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)
        plausible.position(model, f"{self.name}.target", self.reference(0.0).value)

    def kernel_rows(self) -> KernelRows:
        axes = ["xyz".index(axis) for axis in self.labels]
        return KernelRows.tracking(self, "frame.own_position", self.frame, numbers=axes)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        motion = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9])
        frame = model.frame_names[-1]
        return [cls(frame, target=[0.3, 0.0, 0.5]), cls(frame, target=motion), cls(frame, target=motion, axes="xz")]
