"""LinearMomentum: tracks the linear momentum of the robot."""

from __future__ import annotations

from typing import Any, Self, final

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import CENTRE, KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .trajectories import Sinusoid


@final
class LinearMomentum(Tracking, KernelTask):
    """l = m ċ [kg m/s]: three rows, world axes.

    Velocity level: l = l_target. Acceleration level: l̇ = l̇_target + kd (l_target − l), kd [1/s].
    ``target``: (3,), by default rest, or a function of time giving it or (momentum, its first, its second derivative);
    the second is not used.

    Raises:
        InvalidInput: a target of another shape; when a stack is compiled, a robot without mass.

    Example:
        >>> from wbc.tasks import LinearMomentum
        >>> LinearMomentum(kd=20.0, weight=1e-3)
        LinearMomentum(weight=0.001)
    """

    dim, units, labels, convert = 3, "kg m", "xyz", staticmethod(vector_target(3))

    def __init__(
        self, *, target: Any = (0.0, 0.0, 0.0), kd: Any = 10.0, weight: Any = 1.0, name: str | None = None
    ) -> None:
        super().__init__(kp=0.0, kd=kd, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        self._mass = model.mass

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.motion:velocity", CENTRE, numbers=[self._mass, 0, 1, 2])

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(), cls(target=Sinusoid([0.0] * 3, amplitude=5.0, frequency=[0.5, 0.7, 0.9]))]
