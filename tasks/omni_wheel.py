"""OmniWheel: lets a wheel with rollers on its rim roll in its plane and slip along its rollers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, Self, final

import numpy as np

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows

from .wheels import Wheel, height


@final
class OmniWheel(KernelTask):
    """The touching point of a wheel does not move along the axle of the roller it stands on: one row [m].

    v_c · (cos γ t + sin γ l) = 0, t the wheel's heading, l across it, γ = ``roller`` [rad]: 0 for an omni wheel, whose
    rollers let it go sideways, ±π/4 for a mecanum wheel. The model assumes that there is always a roller under the
    wheel. With ``ground``, the height [m] of the ground, a second row holds the wheel on it. Other arguments and what
    the rows mean: :class:`~tasks.rolling.Rolling`. Source: Campion, Bastin, d'Andréa-Novel, IEEE T-RA 1996.

    Raises:
        InvalidInput: a radius that is not positive, an axle that is zero, |γ| >= π/2 (nothing would drive).
        UnknownFrame: when a stack is compiled.

    Example:
        >>> import numpy as np
        >>> from wbc.tasks import OmniWheel
        >>> OmniWheel("front_left_wheel", radius=0.1, roller=np.pi / 4).exactly()
        OmniWheel[front_left_wheel] exactly
    """

    units = "m"
    read_once = frozenset({"wheel"})
    checked: ClassVar[Mapping[str, Any]] = {
        "roller": partial(checks.number, low=-1.57, high=1.57), "ground": height,
    }  # fmt: skip

    def __init__(
        self, frame: str, *, radius: float, axle: Any = (0.0, 1.0, 0.0), roller: float = 0.0,
        ground: float | None = None, kp: float = 100.0, kd: float = 20.0, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        self.labels = ("drive",) if ground is None else ("drive", "height")
        self.dim, self._name = len(self.labels), name
        self.wheel = Wheel(self.name, frame, radius, axle)
        self.roller = roller
        self.ground = ground
        kp = checks.number(f"{self.name}.kp", kp, low=0.0)
        super().__init__(kp=[0.0, kp][: self.dim], kd=kd, weight=weight, name=name)

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        shares = [np.cos(self.roller), np.sin(self.roller), 0.0, 0.0, 0.0, 1.0][: 3 * self.dim]
        return KernelRows("wbc.tasks.compiled.frame:wheel", (self.frame,), [*self.wheel.numbers(self.ground), *shares])

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame = model.frame_names[-1]
        return [cls(frame, radius=0.1), cls(frame, radius=0.2, axle=np.ones(3), roller=-0.8, ground=0.1, kp=25.0)]
