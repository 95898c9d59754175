"""JointVelocity: how fast every joint moves."""

from __future__ import annotations

from typing import Any, Self, final

from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import Task, TaskRows
from wbc.stack.tracking import Tracking, joints_target

from .trajectories import Sinusoid


@final
class JointVelocity(Tracking, Task):
    """Velocity level: v_joints = v_target. Acceleration level: a_joints = v̇_target + kd (v_target − v_joints).

    ``target``: joint velocities (nj,) or a velocity (nv,) whose base is not read [rad/s, m/s], or a function of time
    giving one or (velocity, its first, its second derivative), the last two (nj,); the second is not used.

    Raises:
        InvalidInput: when a stack is compiled: a target, weight or gain of another size.

    Example:
        >>> from wbc.tasks import JointVelocity
        >>> JointVelocity([0.1, 0.0, 0.0, -0.1, 0.0, 0.0, 0.0], kd=20)
        JointVelocity(weight=1.0)
    """

    on_joints = True

    def __init__(self, target: Any, *, kd: Any = 10.0, weight: Any = 1.0, name: str | None = None) -> None:
        super().__init__(kp=0.0, kd=kd, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        self.dim, self.units, self.labels = model.nj, model.joint_units, model.joint_names
        self.convert = joints_target(model, model.nv)
        self.target = self.target

    def fill(self, state: RobotState, out: TaskRows) -> None:
        target = self.reference(state.t)
        out.e[:] = 0.0
        out.rate_ref[:], out.acc_ref[:] = target.value, target.rate

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls([0.1] * model.nj), cls(Sinusoid([0.0] * model.nj, amplitude=0.1, frequency=0.5))]
