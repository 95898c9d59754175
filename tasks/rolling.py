"""Rolling: lets a wheel roll on level ground without slip."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self, final

import numpy as np

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows

from .wheels import Wheel, height


@final
class Rolling(KernelTask):
    """The material point of a wheel that touches the ground stands still: rows along the heading and across it [m].

    v_c = ṗ − radius ω × m = 0, m from the touching point to the wheel's centre p (see :class:`~tasks.wheels.Wheel`).
    With ``ground``, the height [m] of the ground, a third row holds the wheel on it: e = ground − z_c. The first two
    rows cannot be integrated to positions and have none; at the acceleration level a slip decays as e^(−kd t). As a
    constraint (``Rolling(…).exactly()``) it makes a driven base of a floating one; with ``InverseDynamics`` the ground
    has to carry and push it, ``Rolling(…, ground=0.0).with_reaction()`` in ``contacts``.

    ``frame`` turns with the wheel, its origin in the centre; ``axle`` (3,) is the axle in it. A wheel that leans more
    than 0.06 degrees short of flat has a heading; beyond, its lean counts as that.

    Raises:
        InvalidInput: a radius that is not positive, an axle that is zero. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Rolling
        >>> Rolling("left_wheel", radius=0.1).exactly(), Rolling("left_wheel", radius=0.1, ground=0.0).dim
        (Rolling[left_wheel] exactly, 3)
    """

    units = "m"
    read_once = frozenset({"wheel"})
    checked: ClassVar[Mapping[str, Any]] = {"ground": height}

    def __init__(
        self, frame: str, *, radius: float, axle: Any = (0.0, 1.0, 0.0), ground: float | None = None,
        kp: float = 100.0, kd: float = 20.0, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        self.labels = ("along", "across") if ground is None else ("along", "across", "height")
        self.dim, self._name = len(self.labels), name
        self.wheel = Wheel(self.name, frame, radius, axle)
        self.ground = ground
        kp = checks.number(f"{self.name}.kp", kp, low=0.0)
        super().__init__(kp=[0.0, 0.0, kp][: self.dim], kd=kd, weight=weight, name=name)

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        return KernelRows(
            "wbc.tasks.compiled.frame:wheel",
            (self.frame,),
            [*self.wheel.numbers(self.ground), *np.eye(3)[: self.dim].ravel()],
        )

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame = model.frame_names[-1]
        return [cls(frame, radius=0.1), cls(frame, radius=0.2, axle=np.ones(3), ground=0.1, kp=25.0)]
