"""JointCoupling: couples a joint to others: gears, mimic joints, differentials."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows

from .joint_task import linear_rows


@final
class JointCoupling(KernelTask):
    """e = offset + Σ ratio_k q_k − q_joint: one row [rad, m].

    ``to``: {other joint: ratio}; a ratio has the unit of the joint per unit of the other (a rack and its pinion: m per
    rad). As a task it is met as well as others allow. ``JointCoupling(…).exactly()`` in ``subject_to`` makes motors do
    what a gear would; ``JointCoupling(…).with_reaction()`` in ``contacts`` is the gear: its own force holds the row,
    and ``Torque(0.0, joints=[joint]).exactly()`` says that only the other joints have motors. At every level q_joint
    returns to its coupled value, with kp and kd.

    Raises:
        InvalidInput: no other joint, the joint coupled to itself, a ratio that is zero or not finite.
        UnknownJoint: when a stack is compiled.

    Example:
        >>> from wbc.tasks import JointCoupling
        >>> JointCoupling("elbow", to={"shoulder_pitch": -2.0}).exactly()
        JointCoupling[elbow] exactly
    """

    dim = 1
    read_once = frozenset({"joint", "ratios"})
    checked: ClassVar[Mapping[str, Any]] = {"offset": checks.number}

    def __init__(
        self, joint: str, *, to: Mapping[str, float], offset: float = 0.0, kp: Any = 100.0, kd: Any = None,
        rate: Any = None, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.joint = self.subject = checks.text("JointCoupling.joint", joint)
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        checks.instance(f"{self.name}.to", to, Mapping, "{joint: ratio}")
        self.ratios = {other: checks.number(f"{self.name}.to[{other!r}]", ratio) for other, ratio in to.items()}
        self.offset = offset
        if not self.ratios or joint in self.ratios or 0.0 in self.ratios.values():
            raise InvalidInput(f"{self.name}.to is {dict(to)}; it must give other joints a ratio that is not zero")

    def prepare(self, model: RobotModel) -> None:
        joint = model.joint(self.joint)
        self._J = np.zeros((1, model.nv))
        self._J[0, model.nb + joint] = 1.0
        for other, ratio in self.ratios.items():
            self._J[0, model.nb + model.joint(other)] = -ratio
        self.units, self.labels = model.joint_units[joint], (self.joint,)

    def kernel_rows(self) -> KernelRows:
        return linear_rows(np.array([self.offset]), self._J)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        first, *others = model.joint_names[:3]
        return [cls(first, to={others[0]: -2.0}), cls(first, to=dict.fromkeys(others, 0.5), offset=0.3)]
