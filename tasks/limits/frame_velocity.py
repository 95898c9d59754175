"""FrameVelocityLimits: limits the linear and angular velocity of a frame."""

from __future__ import annotations

from typing import Any, ClassVar, Literal, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.constraint import ConstraintRows, LinearConstraint
from wbc.stack.kernel_members import KernelMember
from wbc.stack.kernel_rows import KernelRows

_LABELS = ("x", "y", "z", "roll", "pitch", "yaw")


@final
class FrameVelocityLimits(LinearConstraint, KernelMember):
    """|J v| <= v_max at the end of the tick, row by row: velocity of a frame's origin [m/s] and its angular velocity
    [rad/s], world axes.

    ``linear``, ``angular``: scalar or (3,), inf for axes without a limit. A frame of a floating base limits the base.
    At levels with accelerations the limits hold for v + a dt, with the current Jacobian. A frame that is too fast would
    have to slow down within one tick; so by default the rows have a slack s [m/s, rad/s] at the cost ½ slack s².

    Raises:
        InvalidInput: zero, negative, NaN, or no limit at all. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import FrameVelocityLimits
        >>> FrameVelocityLimits("tool", linear=0.25, angular=1.0).dim  # at most 0.25 m/s beside people
        6
    """

    on: ClassVar[Literal["velocity"]] = "velocity"
    units = "m/s or rad/s"

    def __init__(
        self, frame: str, *, linear: Any = np.inf, angular: Any = np.inf, slack: float | None = 1e10,
        name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(name=name)
        self.slack = None if slack is None else checks.number(f"{self.name}.slack", slack, low=0.0, strict=True)
        limits = []
        for what, value in (("linear", linear), ("angular", angular)):
            given = np.full(3, value) if checks.ndim(value) == 0 else value
            limit = checks.array(f"{self.name}.{what}", given, (3,), finite=False)
            if not (limit > 0.0).all():
                i = int(np.argmin(limit > 0.0))
                raise InvalidInput(f"{self.name}.{what}[{i}] is {limit[i]:g}; a limit is positive (inf: none)")
            limits.append(limit)
        all_limits = np.concatenate(limits)
        self._rows = np.flatnonzero(np.isfinite(all_limits))
        self._v_max = all_limits[self._rows]
        self.dim = len(self._rows)
        if not self.dim:
            raise InvalidInput(f"{self.name} limits nothing; give linear= or angular=")
        if self._rows[-1] < 3 or self._rows[0] >= 3:
            self.units = "m/s" if self._rows[0] < 3 else "rad/s"

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        return KernelRows("wbc.tasks.compiled.motion:velocity", (self.frame,), [1.0, *self._rows])

    def fill(self, state: RobotState, out: ConstraintRows) -> None:
        out.A[:], out.lo[:], out.hi[:] = self._called(state).J, -self._v_max, self._v_max

    def label(self, row: int) -> str:
        return _LABELS[self._rows[row]]

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame = model.frame_names[-1]
        return [cls(frame, linear=0.5), cls(frame, linear=[1.0, np.inf, 0.2], angular=1.0)]
