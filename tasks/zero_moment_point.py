"""ZeroMomentPoint: tracks the zero-moment point: the centre of pressure of all contacts on level ground."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self, final

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelLinearTask
from wbc.stack.kernel_rows import CENTRE, MOMENTUM, KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .required import gravity_down
from .trajectories import Sinusoid


@final
class ZeroMomentPoint(Tracking, KernelLinearTask):
    """The centre of pressure of the whole robot is at ``target`` (2,) [m] on the ground of height ``ground``: two rows.

    The environment acts on a robot with a force F = m (c̈ − g) and, about the target o, a moment N = k̇ + (c − o) × F,
    without a horizontal part where o is the zero moment point. Both are linear in a, so no contact force is needed, on
    one foot or on many. The rows are (−N_y, N_x) / (m |g|): metres by which the point misses the target, as long as the
    robot carries its own weight.
    Source: Vukobratović, Borovac, IJHR 2004; Orin, Goswami, Lee, Autonomous Robots 2013.

    Raises:
        InvalidInput: a target of another shape; when a stack is compiled, a robot without mass. NotSupported: then,
            gravity that is not along −z.

    Example:
        >>> from wbc.tasks import ZeroMomentPoint
        >>> ZeroMomentPoint(target=[0.02, 0.0], weight=10.0)
        ZeroMomentPoint(weight=10.0)
    """

    on, dim, units, labels, convert = "acceleration", 2, "m", "xy", staticmethod(vector_target(2))
    checked: ClassVar[Mapping[str, Any]] = {"ground": checks.number}

    def __init__(self, *, target: Any, ground: float = 0.0, weight: Any = 1.0, name: str | None = None) -> None:
        super().__init__(weight=weight, name=name)
        self.ground = ground
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        gravity_down(self.name, model)
        self._mass, self._gravity = model.mass, model.gravity

    def kernel_rows(self) -> KernelRows:
        numbers = [self._mass, self.ground, *self._gravity]
        return KernelRows.tracking(
            self, "wbc.tasks.compiled.motion:zero_moment_point", MOMENTUM, CENTRE, numbers=numbers
        )

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(target=[0.1, 0.0]), cls(target=Sinusoid([0.0, 0.0], amplitude=0.1, frequency=0.5), ground=-0.2)]
