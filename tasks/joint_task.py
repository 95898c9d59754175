"""JointTask and TorqueTask: tasks with one row a joint, of all joints or of those named."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from wbc.errors import InvalidInput, UnknownJoint
from wbc.models.model import RobotModel, RobotState
from wbc.stack.by_name import ByName, all_meant, patterns
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.member import EFFORTS
from wbc.stack.target import Convert
from wbc.stack.task import LinearTask, Task, TaskRows
from wbc.stack.tracking import joints_target
from wbc.types import Index, Mat, Vec


def linear_rows(offset: Vec, J: Mat) -> KernelRows:
    """e = offset − J q, a row for each of ``offset`` (dim,); J (dim, nv) has nothing of the base."""
    numbers = np.concatenate([offset, J.ravel()])
    return KernelRows("wbc.tasks.compiled.joint:linear", numbers=numbers, constant=J)


class JointTask(Task):
    """A task whose Jacobian is the identity on the joints: (nj,) rows, e, rate_ref and acc_ref are written.

    ``joints``: names or patterns (regular expressions that match a whole name), the order of the model for those that
    one pattern matches; None: all joints. Joints that are not named have no weight, no gains and no error; a task made
    a constraint, by ``exactly``, ``within`` or ``with_reaction``, has no rows for them. Weights and gains: one number,
    (nj,), one for each joint named, in that order, or {name or pattern: number}, of which the last that matches holds.
    Joints that match none have the weight 1 and the gains that the task has by default.

    Which joints are meant is found when a stack is compiled, or a weight assigned: ticks have numbers only.

    Raises:
        InvalidInput: no names, one twice, all joints in another order than the model's, numbers of another size.
        UnknownJoint: a name or pattern that matches no joint, when a stack is compiled.
    """

    on_joints = True
    unknown_row = UnknownJoint
    read_once = frozenset({"joints"})
    joints: tuple[str, ...] | None = None
    convert_rate: Convert | None = None
    #: The joints named; None for all.
    _chosen: Index | None = None

    def __init__(self, *, joints: Sequence[str] | None = None, **settings: Any) -> None:
        if joints is not None:
            self.joints = patterns(f"{type(self).__name__}.joints", joints)
            if not self.subject:
                self.subject = ", ".join(self.joints)
        super().__init__(**settings)

    def prepare(self, model: RobotModel) -> None:
        self.dim, self.units, self.labels = model.nj, model.joint_units, model.joint_names
        self._chosen = None
        if self.joints is not None:
            found = all_meant(f"{self.name}.joints", self.joints, model.joint_names)
            if len(found) == model.nj and found != sorted(found):
                raise InvalidInput(f"{self.name}.joints are all joints in another order than the model's; leave it out")
            self._chosen = np.array(found, dtype=np.intp)

    def _rows(self, what: str, value: float | Vec | ByName) -> Vec:
        chosen = self._chosen
        if chosen is None:
            return super()._rows(what, value)
        rows = np.zeros(self.dim)
        if isinstance(value, ByName):
            rows[chosen] = value.rows([self.labels[i] for i in chosen], self._default(what), self.unknown_row)
        else:  # a number, one for each joint, or one for each that is named
            given = np.asarray(value)
            given = given[chosen] if given.shape == rows.shape else given
            if given.shape not in ((), chosen.shape):
                shapes = f"({len(chosen)},) or ({self.dim},)"
                raise InvalidInput(f"{self.name}.{what} must have shape {shapes}, not {given.shape}")
            rows[chosen] = given
        return rows

    def own_rows(self, values: Vec) -> Vec:
        if self._chosen is None:
            return values
        own = np.zeros_like(values)
        own[self._chosen] = values[self._chosen]
        return own

    def _read_targets(self, model: RobotModel, full: int) -> None:
        """Targets are (nj,), (full,) with the joints last, or (joints named,); to be called in ``prepare``."""
        self.convert = joints_target(model, full, self._chosen, model.q0[-model.nj :])
        self.convert_rate = joints_target(model, model.nj, self._chosen)

    def _as_constraint(self, model: RobotModel) -> Task:
        self.prepare(model)
        return self if self._chosen is None else _Chosen(self, self._chosen, model)


@final
class _Chosen(Task):
    """The rows of those joints alone that a task names."""

    unknown_row = UnknownJoint

    def __init__(self, task: JointTask, chosen: Index, model: RobotModel) -> None:
        super().__init__(name=task.name)
        self._task, self._of, self.dim = task, chosen, len(chosen)
        self.units = tuple(task.unit(int(i)) for i in chosen)
        self.labels = tuple(task.label(int(i)) for i in chosen)
        self._J, self._all = np.eye(model.nv)[model.nb :][chosen], TaskRows()
        self._all.e, self._all.rate_ref, self._all.acc_ref = np.zeros((3, model.nj))

    def gains(self) -> tuple[Vec, Vec, Vec]:
        kp, kd, rate = self._task.gains()
        return kp[self._of], kd[self._of], rate[self._of]

    def fill(self, state: RobotState, out: TaskRows) -> None:
        rows = self._all
        rows.rate_ref[:], rows.acc_ref[:] = 0.0, 0.0
        self._task.fill(state, rows)
        out.e[:], out.J[:], out.drift[:] = rows.e[self._of], self._J, 0.0
        out.rate_ref[:], out.acc_ref[:] = rows.rate_ref[self._of], rows.acc_ref[self._of]


class TorqueTask(LinearTask):
    """τ = what a subclass writes, one row a joint [N m, N].

    ``joints``: names or patterns (regular expressions that match whole names), for these alone, in that order, those of
    a pattern in the order of the model; None: all. Weights by name: see :class:`~wbc.stack.objective.Objective`.

    Raises:
        InvalidInput: no names, or one twice. UnknownJoint: when a stack is compiled.
    """

    on, unknown_row = "torque", UnknownJoint
    read_once = frozenset({"joints"})
    joints: tuple[str, ...] | None = None
    #: Of each row, its joint.
    _index: Index

    def __init__(self, *, joints: Sequence[str] | None = None, weight: Any = 1.0, name: str | None = None) -> None:
        self.joints = None if joints is None else patterns(f"{type(self).__name__}.joints", joints)
        self.subject = ", ".join(self.joints or ())
        super().__init__(weight=weight, name=name)

    def prepare(self, model: RobotModel) -> None:
        index = all_meant(f"{self.name}.joints", self.joints or (".*",), model.joint_names)
        self._index, self.dim = np.array(index, dtype=np.intp), len(index)
        self.labels = tuple(model.joint_names[i] for i in index)
        self.units = tuple(EFFORTS[model.joint_units[i]] for i in index)
        self._rows_of_joints = np.eye(model.nj)[index]
