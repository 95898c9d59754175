"""Position: where the origin of a frame of the robot is."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from tasks.trajectories import Sinusoid
from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import Task, TaskRows, vector_target
from wbc.stack.tracking import Tracking


@final
class Position(Tracking, Task):
    """e = p_target − p [m]: three rows, world axes.

    ``target``: (3,), or a function of time giving it or (position, velocity, acceleration).

    Raises:
        InvalidInput: a target of another shape. UnknownFrame: when a stack is compiled.

    Example:
        >>> from tasks import Position
        >>> Position("tool", target=[0.4, 0.0, 0.5]).units
        'm'
    """

    dim, units, labels, convert = 3, "m", "xyz", staticmethod(vector_target(3))

    def __init__(
        self, frame: str, *, target: Any, kp: Any = 100.0, kd: Any = None, rate: Any = None, weight: Any = 1.0,
        name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def fill(self, state: RobotState, out: TaskRows) -> None:
        frame, target = state.frame(self.frame), self.reference(state.t)
        out.J[:] = frame.jacobian()[:3]
        np.subtract(target.value, frame.position, out.e)
        out.drift[:] = frame.drift()[:3]
        out.rate_ref[:], out.acc_ref[:] = target.rate, target.second

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        motion = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9])
        return [cls(model.frame_names[-1], target=[0.3, 0.0, 0.5]), cls(model.frame_names[-1], target=motion)]
