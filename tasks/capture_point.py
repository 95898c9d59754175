"""CapturePoint: tracks the capture point (divergent component of motion), to balance or to follow a walking plan."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, Self, final

import numpy as np

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelLinearTask
from wbc.stack.kernel_rows import CENTRE, KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .required import gravity_down
from .trajectories import Sinusoid


@final
class CapturePoint(Tracking, KernelLinearTask):
    """ξ = c + ċ / ω on the map, ω = √(g / height), converges: ξ̇ = ξ̇_target + rate (ξ_target − ξ).

    Two rows on the accelerations a: c̈ = ω (ξ̇_target + rate (ξ_target − ξ) − ċ). ξ is the divergent part of the linear
    inverted pendulum, whose centre of mass then follows by itself, ċ = ω (ξ − c); with a centre of pressure at p,
    ξ̇ = ω (ξ − p). ``height`` [m] is that of the centre of mass above the ground, ``rate`` [1/s]; ``target`` (2,) [m],
    or a function of time giving it or (position, velocity, acceleration), the last not used. Source: Pratt et al.,
    Humanoids 2006; Englsberger, Ott, Albu-Schäffer, IEEE T-RO 2015.

    Raises:
        InvalidInput: a target of another shape, a height that is not positive; when a stack is compiled, a robot
            without mass. NotSupported: then, gravity that is not along −z.

    Example:
        >>> from wbc.tasks import CapturePoint
        >>> CapturePoint(target=[0.02, 0.0], height=0.8, rate=3.0)
        CapturePoint(weight=1.0)
    """

    on, dim, units, labels, convert = "acceleration", 2, "m/s²", "xy", staticmethod(vector_target(2))

    read_once = frozenset({"height"})
    checked: ClassVar[Mapping[str, Any]] = {"rate": partial(checks.number, low=0.0)}

    def __init__(
        self, *, target: Any, height: float, rate: float = 3.0, weight: Any = 1.0, name: str | None = None
    ) -> None:
        super().__init__(weight=weight, name=name)
        self.height = checks.number(f"{self.name}.height", height, low=0.0, strict=True)
        self.rate = rate
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        gravity_down(self.name, model)
        self._omega = float(np.sqrt(-model.gravity[2] / self.height))

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(
            self, "wbc.tasks.compiled.motion:capture_point", CENTRE, numbers=[self._omega, self.rate]
        )

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        moving = Sinusoid([0.0, 0.0], amplitude=0.1, frequency=0.5)
        return [cls(target=[0.1, 0.0], height=0.8), cls(target=moving, height=0.5, rate=5.0)]
