"""LowAcceleration: minimises joint acceleration: keeps the current joint velocities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows

from .joint_task import JointTask


@final
class LowAcceleration(JointTask, KernelTask):
    """Velocity level: v_joints = the velocity measured now. Acceleration level: a_joints = 0. One row a joint.

    It makes commands smooth at the cost of lag, and needs no memory: the velocity of the state is the last command, as
    far as the robot followed it. ``joints`` and weight: by name or pattern too, see
    :class:`~tasks.joint_task.JointTask`.

    Example:
        >>> from wbc.tasks import LowAcceleration
        >>> LowAcceleration(weight=1e-2)
        LowAcceleration(weight=0.01)
    """

    def __init__(self, *, joints: Sequence[str] | None = None, weight: Any = 1.0, name: str | None = None) -> None:
        super().__init__(joints=joints, kp=0.0, kd=0.0, weight=weight, name=name)

    def kernel_rows(self) -> KernelRows:
        return KernelRows("wbc.tasks.compiled.joint:steady")
