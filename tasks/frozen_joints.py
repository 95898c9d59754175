"""FrozenJoints: some joints stay where they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import Task, TaskRows


@final
class FrozenJoints(Task):
    """The joints named do not move: one row each [rad, m]. ``FrozenJoints(…).exactly()`` in ``subject_to`` lets their
    motors hold them, ``FrozenJoints(…).with_reaction()`` in ``contacts`` a brake.

    By a list of names: v = 0 at the velocity level, a = −kd v at the acceleration level; where a joint stops is left
    open. By {joint: position}: e = position − q, so that it comes back there, with ``kp`` (default 100).

    Raises:
        InvalidInput: no joints, one twice, a position that is not finite. UnknownJoint: when a stack is compiled.

    Example:
        >>> from wbc.tasks import FrozenJoints
        >>> FrozenJoints(["wrist_roll", "wrist_pitch"]).exactly()
        FrozenJoints[wrist_roll, wrist_pitch] exactly
        >>> FrozenJoints({"elbow": 1.2}, kp=400).dim
        1
    """

    def __init__(
        self, joints: Sequence[str] | Mapping[str, float], *, kp: Any = None, kd: Any = None, rate: Any = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.joints = self.labels = checks.names("FrozenJoints.joints", joints)
        self.dim, self.subject = len(self.joints), ", ".join(self.joints)
        self._name = name
        held = isinstance(joints, Mapping)
        self.positions = (
            np.array([checks.number(f"{self.name}.joints[{j!r}]", joints[j]) for j in joints])
            if isinstance(joints, Mapping)
            else None
        )
        if kp is not None and not held:
            raise InvalidInput(f"{self.name}.kp is {kp}, but there are no positions to hold; give {{joint: position}}")
        kp = (100.0 if held else 0.0) if kp is None else kp
        super().__init__(kp=kp, kd=20.0 if kd is None and not held else kd, rate=rate, weight=weight, name=name)

    def prepare(self, model: RobotModel) -> None:
        self._index = [model.joint(joint) for joint in self.joints]
        self._J = np.eye(model.nv)[model.nb :][self._index]
        self.units = tuple(model.joint_units[i] for i in self._index)

    def fill(self, state: RobotState, out: TaskRows) -> None:
        out.e[:] = 0.0 if self.positions is None else self.positions - state.q_joints[self._index]
        out.J[:], out.drift[:] = self._J, 0.0

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        first, second = model.joint_names[:2]
        return [cls([second, first]), cls({second: 0.3, first: -0.1})]
