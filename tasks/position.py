"""Position: where the origin of a frame of the robot is."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.models import plausible
from wbc.models.model import RobotModel, RobotState
from wbc.stack.frame_rows import FrameRows
from wbc.stack.target import vector_target
from wbc.stack.task import Task, TaskRows
from wbc.stack.tracking import Tracking

from .trajectories import Sinusoid

#: Rows of a frame's Jacobian by axes; slices, so that views of the state are taken and not copies.
_ROWS = {
    "xyz": slice(0, 3), "xy": slice(0, 2), "yz": slice(1, 3), "xz": slice(0, 3, 2),
    "x": slice(0, 1), "y": slice(1, 2), "z": slice(2, 3),
}  # fmt: skip


@final
class Position(Tracking, Task):
    """e = p_target − p [m]: one row for each of ``axes``, by default all three, world axes.

    ``target``: as many numbers as there are axes, or a function of time giving them or (position, velocity,
    acceleration).

    Raises:
        InvalidInput: axes that are not some of "xyz" in this order, a target of another shape.
        UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Position
        >>> Position("tool", target=[0.4, 0.0, 0.5]).units, Position("tool", target=[0.5], axes="z").dim
        ('m', 1)
    """

    units = "m"

    def __init__(
        self, frame: str, *, target: Any, axes: str = "xyz", kp: Any = 100.0, kd: Any = None, rate: Any = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        checks.one_of(f"{self.name}.axes", axes, _ROWS)
        self._rows_of_frame, self.dim, self.labels = _ROWS[axes], len(axes), axes
        self.convert = vector_target(self.dim)
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)
        plausible.position(model, f"{self.name}.target", self.reference(0.0).value)

    def fill(self, state: RobotState, out: TaskRows) -> None:
        frame, target, rows = state.frame(self.frame), self.reference(state.t), self._rows_of_frame
        out.J[:] = frame.jacobian()[rows]
        np.subtract(target.value, frame.position[rows], out.e)
        out.drift[:] = frame.drift()[rows]
        if target.has_rates:
            out.rate_ref[:], out.acc_ref[:] = target.rate, target.second

    def compiled_rows(self) -> FrameRows:
        return FrameRows(self.frame, rows=tuple("xyz".index(axis) for axis in self.labels))

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        motion = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9])
        frame = model.frame_names[-1]
        return [cls(frame, target=[0.3, 0.0, 0.5]), cls(frame, target=motion), cls(frame, target=[0.3, 0.5], axes="xz")]
