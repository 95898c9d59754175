"""FrozenJoints: keeps some joints where they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, UnknownJoint
from wbc.models.model import RobotModel
from wbc.stack.by_name import all_meant, meant, patterns
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows

from .joint_task import linear_rows


@final
class FrozenJoints(KernelTask):
    """The joints named do not move: one row each [rad, m]. ``FrozenJoints(…).exactly()`` in ``subject_to`` lets their
    motors hold them, ``FrozenJoints(…).with_reaction()`` in ``contacts`` a brake.

    By a list of names: v = 0 at the velocity level, a = −kd v at the acceleration level; where a joint stops is left
    open. By {joint: position}: e = position − q, so that it comes back there, with ``kp`` (default 100).
    A name may be a pattern, a regular expression that matches whole names; of several positions of a joint the last
    holds.

    Raises:
        InvalidInput: no joints, one twice, a position that is not finite. UnknownJoint: when a stack is compiled.

    Example:
        >>> from wbc.tasks import FrozenJoints
        >>> FrozenJoints(["wrist_roll", "wrist_pitch"]).exactly()
        FrozenJoints[wrist_roll, wrist_pitch] exactly
        >>> FrozenJoints({"elbow": 1.2, "wrist_.*": 0.0}, kp=400)
        FrozenJoints[elbow, wrist_.*](weight=1.0)
    """

    _kd = 20.0
    read_once = frozenset({"joints", "positions"})

    def __init__(
        self, joints: Sequence[str] | Mapping[str, float], *, kp: Any = None, kd: Any = None, rate: Any = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.joints = patterns("FrozenJoints.joints", joints)
        self.subject, self._name = ", ".join(self.joints), name
        held = isinstance(joints, Mapping)
        self.positions = (
            {joint: checks.number(f"{self.name}.joints[{joint!r}]", joints[joint]) for joint in joints}
            if isinstance(joints, Mapping)
            else None
        )
        if kp is not None and not held:
            raise InvalidInput(f"{self.name}.kp is {kp}, but there are no positions to hold; give {{joint: position}}")
        kp = (100.0 if held else 0.0) if kp is None else kp
        super().__init__(kp=kp, kd=self._kd if kd is None and not held else kd, rate=rate, weight=weight, name=name)

    def prepare(self, model: RobotModel) -> None:
        names = model.joint_names
        self._index = all_meant(f"{self.name}.joints", self.joints, names)
        self.dim, self.labels = len(self._index), tuple(names[i] for i in self._index)
        self._J = np.eye(model.nv)[model.nb :][self._index]
        self.units = tuple(model.joint_units[i] for i in self._index)
        if self.positions is not None:
            self._positions = np.zeros(self.dim)
            for joint, position in self.positions.items():
                self._positions[meant(self.name, joint, self.labels, UnknownJoint)] = position

    def kernel_rows(self) -> KernelRows:
        if self.positions is None:
            return KernelRows("wbc.tasks.compiled.motion:velocity", constant=self._J)
        return linear_rows(self._positions, self._J)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        first, second = model.joint_names[:2]
        return [cls([second, first]), cls({".*": 0.3, first: -0.1})]
