"""Posture: tracks joint positions. With a low weight it uses the freedom that other tasks leave."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, final

from wbc.models import plausible
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.tracking import Tracking

from .joint_task import JointTask
from .trajectories import Sinusoid


@final
class Posture(Tracking, JointTask, KernelTask):
    """e = q_target − q: one row a joint [rad, m].

    ``target``: joint positions (nj,), or of the joints named alone, or a configuration (nq,) whose base is not read, or
    a function of time giving one or (positions, velocities, accelerations), the last two (nj,) or of the joints named.
    ``joints``, weight and gains: by name or pattern too, see :class:`~tasks.joint_task.JointTask`.

    Raises:
        InvalidInput: when a stack is compiled: a target, weight or gain of another size.
        UnknownJoint: when a stack is compiled: a name or pattern that matches no joint.

    Example:
        >>> import wbc
        >>> from wbc.tasks import Posture
        >>> Posture(wbc.load("arm").q0, kp=10, weight=1e-3)
        Posture(weight=0.001)
        >>> Posture([0.1, -0.2], joints=["elbow", "wrist_roll"], weight={"wrist_.*": 0.01})
        Posture[elbow, wrist_roll](weight={'wrist_.*': 0.01})
    """

    def __init__(
        self, target: Any, *, joints: Sequence[str] | None = None, kp: Any = 100.0, kd: Any = None, rate: Any = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(joints=joints, kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        super().prepare(model)
        self._read_targets(model, model.nq)
        self.target = self.target
        plausible.joints(model, f"{self.name}.target", self.reference(0.0).value)

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.joint:position")

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        joints = model.q0[-model.nj :]
        first, *_, last = model.joint_names
        # Of a robot of two joints that would be all of them in another order, which is refused.
        named = [last, first] if model.nj > 2 else [first, last]
        some = cls([0.2, -0.1], joints=named, kp={first: 30.0}, weight={last: 0.0})
        return [cls(model.q0), cls(joints), cls(Sinusoid(joints, amplitude=0.1, frequency=0.5)), some]
