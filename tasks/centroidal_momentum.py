"""CentroidalMomentum: tracks the linear and angular momentum of the whole robot."""

from __future__ import annotations

from typing import Any, Self, final

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import MOMENTUM, KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .trajectories import Sinusoid


@final
class CentroidalMomentum(Tracking, KernelTask):
    """h = A_G v: six rows, linear momentum [kg m/s], then angular [kg m²/s] about the centre of mass, world axes.

    Velocity level: h = h_target. Acceleration level: ḣ = ḣ_target + kd (h_target − h), kd [1/s]; ḣ is the wrench of
    gravity and contacts on the robot. ``target``: (6,), by default zero, or a function of time giving it or (momentum,
    its first, its second derivative); the second is not used. Source: Orin, Goswami, Lee, Autonomous Robots 2013.

    Raises:
        InvalidInput: a target of another shape; when a stack is compiled, a robot without mass.

    Example:
        >>> from wbc.tasks import CentroidalMomentum
        >>> CentroidalMomentum(weight=[1, 1, 1, 10, 10, 10]).units
        ('kg m', 'kg m', 'kg m', 'kg m²', 'kg m²', 'kg m²')
    """

    dim, units, convert = 6, ("kg m",) * 3 + ("kg m²",) * 3, staticmethod(vector_target(6))
    labels = ("x", "y", "z", "about x", "about y", "about z")

    def __init__(self, *, target: Any = (0.0,) * 6, kd: Any = 10.0, weight: Any = 1.0, name: str | None = None) -> None:
        super().__init__(kp=0.0, kd=kd, weight=weight, name=name)
        self.target = target

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.motion:velocity", MOMENTUM, numbers=[1.0, *range(6)])

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(), cls(target=Sinusoid([0.0] * 6, amplitude=2.0, frequency=0.5))]
