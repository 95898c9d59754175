"""TorqueTask: a linear task on the torques of all joints, or of those named."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wbc.errors import UnknownJoint
from wbc.models.model import RobotModel
from wbc.stack.by_name import all_meant, patterns
from wbc.stack.task import LinearTask
from wbc.types import Index


class TorqueTask(LinearTask):
    """τ = what a subclass writes, one row a joint [N m, N].

    ``joints``: names or patterns (regular expressions that match whole names), for these alone, in that order, those of
    a pattern in the order of the model; None: all. Weights by name: see :class:`~wbc.stack.objective.Objective`.

    Raises:
        InvalidInput: no names, or one twice. UnknownJoint: when a stack is compiled.
    """

    on, unknown_row = "torque", UnknownJoint
    joints: tuple[str, ...] | None = None
    #: Of each row, its joint.
    _index: Index

    def __init__(self, *, joints: Sequence[str] | None = None, weight: Any = 1.0, name: str | None = None) -> None:
        self.joints = None if joints is None else patterns(f"{type(self).__name__}.joints", joints)
        self.subject = ", ".join(self.joints or ())
        super().__init__(weight=weight, name=name)

    def prepare(self, model: RobotModel) -> None:
        index = all_meant(f"{self.name}.joints", self.joints or (".*",), model.joint_names, UnknownJoint)
        self._index, self.dim = np.array(index, dtype=np.intp), len(index)
        self.labels = tuple(model.joint_names[i] for i in index)
        self.units = tuple("N" if model.joint_units[i] == "m" else "N m" for i in index)
        self._rows_of_joints = np.eye(model.nj)[index]
