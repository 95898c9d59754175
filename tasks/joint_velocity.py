"""JointVelocity: tracks joint velocities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, final

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.tracking import Tracking

from .joint_task import JointTask
from .trajectories import Sinusoid


@final
class JointVelocity(Tracking, JointTask, KernelTask):
    """Velocity level: v_joints = v_target. Acceleration level: a_joints = v̇_target + kd (v_target − v_joints).

    ``target``: joint velocities (nj,), or of the joints named alone, or a velocity (nv,) whose base is not read
    [rad/s, m/s], or a function of time giving one or (velocity, its first, its second derivative); the second is not
    used. ``joints``, weight and gain: by name or pattern too, see :class:`~tasks.joint_task.JointTask`.

    Raises:
        InvalidInput: when a stack is compiled: a target, weight or gain of another size.
        UnknownJoint: when a stack is compiled: a name or pattern that matches no joint.

    Example:
        >>> from wbc.tasks import JointVelocity
        >>> JointVelocity([0.1, 0.0, 0.0, -0.1, 0.0, 0.0, 0.0], kd=20)
        JointVelocity(weight=1.0)
        >>> JointVelocity([3.0, 3.0], joints=["wheel_.*"])
        JointVelocity[wheel_.*](weight=1.0)
    """

    _kd = 10.0

    def __init__(
        self, target: Any, *, joints: Sequence[str] | None = None, kd: Any = 10.0, weight: Any = 1.0,
        name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(joints=joints, kp=0.0, kd=kd, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        super().prepare(model)
        self._read_targets(model, model.nv)
        self.target = self.target

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.motion:velocity")

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        some = cls(Sinusoid([0.5], amplitude=0.1, frequency=0.5), joints=[model.joint_names[1]])
        return [cls([0.1] * model.nj), cls(Sinusoid([0.0] * model.nj, amplitude=0.1, frequency=0.5)), some]
