"""Damping: joints would rather not move."""

from __future__ import annotations

from typing import Any, final

from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import Task, TaskRows


@final
class Damping(Task):
    """Velocity level: v_joints = 0. Acceleration level: a_joints = −kd v_joints, kd [1/s]. One row a joint.

    Example:
        >>> from wbc.tasks import Damping
        >>> Damping(kd=10, weight=1e-3)
        Damping(weight=0.001)
    """

    on_joints = True

    def __init__(self, *, kd: Any = 10.0, weight: Any = 1.0, name: str | None = None) -> None:
        super().__init__(kp=0.0, kd=kd, weight=weight, name=name)

    def prepare(self, model: RobotModel) -> None:
        self.dim, self.units, self.labels = model.nj, model.joint_units, model.joint_names

    def fill(self, state: RobotState, out: TaskRows) -> None:
        out.e[:] = 0.0
