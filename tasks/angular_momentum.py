"""AngularMomentum: tracks the angular momentum about the centre of mass."""

from __future__ import annotations

from typing import Any, Self, final

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import MOMENTUM, KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .trajectories import Sinusoid


@final
class AngularMomentum(Tracking, KernelTask):
    """k = A_k v [kg m²/s], about the centre of mass: three rows, world axes.

    Velocity level: k = k_target. Acceleration level: k̇ = k̇_target + kd (k_target − k), kd [1/s]. There is no angle
    whose rate it is, so no task is about one. ``target``: (3,), by default none at all, or a function of time
    giving it or (momentum, its first, its second derivative); the second is not used.
    Source: Orin, Goswami, Lee, Autonomous Robots 2013.

    Raises:
        InvalidInput: a target of another shape; when a stack is compiled, a robot without mass.

    Example:
        >>> from wbc.tasks import AngularMomentum
        >>> AngularMomentum(kd=20.0, weight=1e-2)
        AngularMomentum(weight=0.01)
    """

    dim, units, labels, convert = 3, "kg m²", "xyz", staticmethod(vector_target(3))

    def __init__(
        self, *, target: Any = (0.0, 0.0, 0.0), kd: Any = 10.0, weight: Any = 1.0, name: str | None = None
    ) -> None:
        super().__init__(kp=0.0, kd=kd, weight=weight, name=name)
        self.target = target

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.motion:velocity", MOMENTUM, numbers=[1.0, 3, 4, 5])

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(), cls(target=Sinusoid([0.0] * 3, amplitude=0.5, frequency=[0.5, 0.7, 0.9]))]
