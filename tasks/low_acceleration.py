"""LowAcceleration: joints would rather go on as they are."""

from __future__ import annotations

from typing import Any, final

from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import Task, TaskRows


@final
class LowAcceleration(Task):
    """Velocity level: v_joints = the velocity measured now. Acceleration level: a_joints = 0. One row a joint.

    It makes commands smooth at the cost of lag, and needs no memory: what was commanded last is the velocity of the
    state, as far as the robot followed.

    Example:
        >>> from wbc.tasks import LowAcceleration
        >>> LowAcceleration(weight=1e-2)
        LowAcceleration(weight=0.01)
    """

    on_joints = True

    def __init__(self, *, weight: Any = 1.0, name: str | None = None) -> None:
        super().__init__(kp=0.0, kd=0.0, weight=weight, name=name)

    def prepare(self, model: RobotModel) -> None:
        self.dim, self.units, self.labels = model.nj, model.joint_units, model.joint_names

    def fill(self, state: RobotState, out: TaskRows) -> None:
        out.e[:] = 0.0
        out.rate_ref[:] = state.v_joints
