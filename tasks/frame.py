"""Frame: position and orientation of a frame of the robot."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from tasks.motions import pose_motion, swing
from tasks.trajectories import Sinusoid
from wbc import checks
from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import Task, TaskRows
from wbc.stack.tracking import Tracking, pose_target, rotation_error


@final
class Frame(Tracking, Task):
    """e = (p_target − p, log(R_target Rᵀ)): six rows, position [m] then orientation [rad], world axes.

    ``target``: pinocchio.SE3 or 4x4 matrix; its rate and acceleration (6,) are linear before angular, world axes.
    ``weight`` is a scalar or (6,); ``position_weight`` and ``orientation_weight`` replace it for three rows each.

    Raises:
        InvalidInput: a target that is no pose. UnknownFrame: when a stack is compiled.

    Example:
        >>> import numpy as np
        >>> from tasks import Frame
        >>> Frame("tool", target=np.eye(4), kp=400, orientation_weight=0.1).name
        'Frame[tool]'
    """

    dim, units, convert = 6, ("m", "m", "m", "rad", "rad", "rad"), staticmethod(pose_target)

    def __init__(
        self, frame: str, *, target: Any, kp: Any = 100.0, kd: Any = None, rate: Any = None, weight: Any = 1.0,
        position_weight: float | None = None, orientation_weight: float | None = None, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        if position_weight is not None or orientation_weight is not None:
            halves = (weight if half is None else half for half in (position_weight, orientation_weight))
            weight = np.repeat([checks.number(f"{frame}: weight", half) for half in halves], 3)
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def fill(self, state: RobotState, out: TaskRows) -> None:
        frame, target = state.frame(self.frame), self.reference(state.t)
        rotation, position = target.value
        out.J[:] = frame.jacobian()
        np.subtract(position, frame.position, out.e[:3])
        out.e[3:] = rotation_error(rotation, frame.rotation)
        out.drift[:] = frame.drift()
        out.rate_ref[:], out.acc_ref[:] = target.rate, target.second

    def label(self, row: int) -> str:
        return ("x", "y", "z", "roll", "pitch", "yaw")[row]

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        circle = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9])
        motion = pose_motion(circle, swing(np.eye(3), [1, 2, 3], angle=0.4, frequency=0.6))
        return [cls(model.frame_names[-1], target=np.eye(4)), cls(model.frame_names[-1], target=motion)]
