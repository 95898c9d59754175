"""Position: tracks the position of the origin of a frame."""

from __future__ import annotations

from typing import Any, ClassVar, Self, final

from wbc import checks
from wbc.models import plausible
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .trajectories import Sinusoid

_AXES = ("xyz", "xy", "yz", "xz", "x", "y", "z")


class _AlongAxes(Tracking, KernelTask):
    """The position of a frame, one row for each of ``axes``. Whose axes these are, the kernel of a subclass says.

    Raises:
        InvalidInput: axes that are not some of "xyz" in this order, a target of another shape.
        UnknownFrame: when a stack is compiled.
    """

    units = "m"
    _kernel: ClassVar[str]
    _leads = False

    def __init__(
        self, frame: str, *, target: Any, axes: str = "xyz", kp: Any = 100.0, kd: Any = None, rate: Any = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        checks.one_of(f"{self.name}.axes", axes, _AXES)
        self.dim, self.labels = len(axes), axes
        self.convert = vector_target(self.target_dim or self.dim)
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)
        plausible.position(model, f"{self.name}.target", self.reference(0.0).value)

    def kernel_rows(self) -> KernelRows:
        axes = ["xyz".index(axis) for axis in self.labels]
        return KernelRows.tracking(self, self._kernel, self.frame, numbers=axes, leads=self._leads)


@final
class Position(_AlongAxes):
    """e = p_target − p [m]: one row for each of ``axes``, by default all three, world axes.

    ``target``: as many numbers as there are axes, or a function of time giving them or (position, velocity,
    acceleration).

    Raises:
        InvalidInput: axes that are not some of "xyz" in this order, a target of another shape.
        UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Position
        >>> Position("tool", target=[0.4, 0.0, 0.5]).units, Position("tool", target=[0.5], axes="z").dim
        ('m', 1)
    """

    _kernel = "wbc.tasks.compiled.frame:position"
    _leads = True

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        motion = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9])
        frame = model.frame_names[-1]
        return [cls(frame, target=[0.3, 0.0, 0.5]), cls(frame, target=motion), cls(frame, target=[0.3, 0.5], axes="xz")]
