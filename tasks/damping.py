"""Damping: penalises joint velocity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows

from .joint_task import JointTask


@final
class Damping(JointTask, KernelTask):
    """Velocity level: v_joints = 0. Acceleration level: a_joints = −kd v_joints, kd [1/s]. One row a joint.

    ``joints``, weight and gain: by name or pattern too, see :class:`~tasks.joint_task.JointTask`.

    Example:
        >>> from wbc.tasks import Damping
        >>> Damping(kd=10, weight=1e-3)
        Damping(weight=0.001)
    """

    _kd = 10.0

    def __init__(
        self, *, joints: Sequence[str] | None = None, kd: Any = 10.0, weight: Any = 1.0, name: str | None = None
    ) -> None:
        super().__init__(joints=joints, kp=0.0, kd=kd, weight=weight, name=name)

    def kernel_rows(self) -> KernelRows:
        return KernelRows("wbc.tasks.compiled.motion:velocity")
