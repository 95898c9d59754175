"""CenterOfMass: tracks a position of the centre of mass."""

from __future__ import annotations

from typing import Any, Self, final

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import CENTRE, KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .trajectories import Sinusoid


@final
class CenterOfMass(Tracking, KernelTask):
    """e = c_target − c [m]: three rows, world axes.

    ``target``: (3,), or a function of time giving it or (position, velocity, acceleration).

    Raises:
        InvalidInput: a target of another shape; when a stack is compiled, a robot without mass.

    Example:
        >>> from wbc.tasks import CenterOfMass, Sinusoid
        >>> sway = Sinusoid([0.0, 0.0, 0.8], amplitude=[0.0, 0.05, 0.0], frequency=0.4)
        >>> CenterOfMass(target=sway, kp=100)
        CenterOfMass(weight=1.0)
    """

    dim, units, labels, convert = 3, "m", "xyz", staticmethod(vector_target(3))

    def __init__(
        self, *, target: Any, kp: Any = 100.0, kd: Any = None, rate: Any = None, weight: Any = 1.0,
        name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.frame:position", CENTRE, numbers=range(3), leads=True)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(target=Sinusoid([0.0, 0.0, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9]))]
