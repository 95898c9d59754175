"""BoxLimits: keeps a frame inside a box."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelBarrier
from wbc.stack.kernel_rows import KernelRows

_AXES = "xyz"


@final
class BoxLimits(KernelBarrier):
    """lower <= p <= upper [m] for the origin p of a frame, world axes: h = p − lower and h = upper − p.

    ``lower``, ``upper`` (3,) or scalar; a side that is infinite has no row.

    Raises:
        InvalidInput: NaN, a lower side that is not below the upper one, no side at all. UnknownFrame: when a stack is
            compiled.

    Example:
        >>> import numpy as np
        >>> from wbc.tasks import BoxLimits
        >>> workspace = BoxLimits("tool", lower=[0.2, -0.5, 0.05], upper=[0.8, 0.5, np.inf])
        >>> workspace.dim, workspace.label(4)
        (5, 'y upper')
    """

    units = "m"

    def __init__(
        self, frame: str, *, lower: Any = -np.inf, upper: Any = np.inf, rate: float = 10.0,
        slack: float | None = 1e6, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(rate=rate, slack=slack, name=name)
        sides = []
        for what, value in (("lower", lower), ("upper", upper)):
            given = np.full(3, value) if checks.ndim(value) == 0 else value
            sides.append(checks.array(f"{self.name}.{what}", given, (3,), finite=False))
        low, high = sides
        for axis, below, above in zip(_AXES, low, high, strict=True):
            if not below < above:
                raise InvalidInput(f"{self.name}: {axis} is left no room: lower {below:g}, upper {above:g}")
        self._low, self._high = np.flatnonzero(np.isfinite(low)), np.flatnonzero(np.isfinite(high))
        self._axes = np.concatenate([self._low, self._high])
        self.dim = len(self._axes)
        if not self.dim:
            raise InvalidInput(f"{self.name} has no finite side")
        self._sign = np.concatenate([np.ones(len(self._low)), -np.ones(len(self._high))])
        self._offset = np.concatenate([low[self._low], -high[self._high]])

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        normals = self._sign[:, None] * np.eye(3)[self._axes]
        return KernelRows(
            "wbc.tasks.compiled.limit:half_spaces", (self.frame,), np.column_stack([normals, self._offset]).ravel()
        )

    def label(self, row: int) -> str:
        return f"{_AXES[self._axes[row]]} {'lower' if row < len(self._low) else 'upper'}"

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame = model.frame_names[-1]
        return [cls(frame, lower=-0.5, upper=0.5), cls(frame, upper=[0.3, np.inf, 0.4])]
