"""Layout: which rows and unknowns a stack has at a level, in which order, and what each is called."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, final

import numpy as np

from wbc.errors import InvalidInput, NotSupported
from wbc.models.model import RobotModel
from wbc.qp.problem import Row
from wbc.stack.constraint import Barrier, Constraints, JointInterval, LinearConstraint, Softly
from wbc.stack.contact import Contact
from wbc.stack.level import Level
from wbc.stack.stack import Stack
from wbc.stack.task import Exactly, LinearTask, Task, force_of
from wbc.types import Index

_AXES = ("x", "y", "z", "roll", "pitch", "yaw")
_WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


@final
class Layout:
    """Members of a stack sorted by what they write, with the row each starts at.

    Rows of G: base (6 or none) | range: torques, cones, barriers, linear constraints, soft constraints | soft: linear,
    kinematic tasks | constraints: exact tasks, contacts. Unknowns: base and joints (u first where it is eliminated),
    then contact forces, then the slacks of soft constraints.

    Raises:
        NotSupported: a member the level cannot carry, by name.
    """

    def __init__(self, model: RobotModel, stack: Stack, level: Level, *, prepared: bool = False) -> None:
        self.model, self.level = model, level
        self.contacts: list[Contact] = list(stack.contacts)
        self.linear: list[LinearTask] = of_kind(stack.tasks, LinearTask)
        self.kinematic: list[Task] = [t for t in of_kind(stack.tasks, Task) if not t.on_joints]
        self.on_joints: list[Task] = [t for t in of_kind(stack.tasks, Task) if t.on_joints]
        for member in () if prepared else (*stack.tasks, *stack.subject_to, *stack.contacts):
            member.prepare(model)
        constraints = [one for constraint in stack.subject_to for one in self._each(constraint)]
        #: Constraints with a slack, above every level.
        self.slack = [
            Softly(constraint, weight=constraint.slack, name=constraint.name)
            for constraint in constraints
            if _has_slack(constraint)
        ]
        self.soft_constraints: list[Softly] = [*self.slack, *of_kind(stack.tasks, Softly)]
        exact = [constraint for constraint in constraints if not _has_slack(constraint)]
        self.exact: list[Exactly] = of_kind(exact, Exactly)
        self.barriers: list[Barrier] = of_kind(exact, Barrier)
        self.constraints: list[LinearConstraint] = of_kind(exact, LinearConstraint)
        intervals: list[JointInterval] = of_kind(exact, JointInterval)
        self.motion_limits = [constraint for constraint in intervals if constraint.quantity != "torque"]
        self.torque_limits = [constraint for constraint in intervals if constraint.quantity == "torque"]
        self._refuse_what_has_no_kind([*stack.tasks, *constraints])
        for soft in self.slack:
            soft.prepare(model)
        self._refuse_what_the_level_cannot_carry()

        dynamics = level.dynamics
        self.n_u = model.nb if dynamics else 0
        self.nf = sum(c.dim for c in self.contacts) if dynamics else 0
        self.n = model.nv + self.nf + sum(soft.dim for soft in self.soft_constraints)
        self.n_torque = model.nj if dynamics else 0
        self.n_cone = sum(len(c.cone()) for c in self.contacts) if dynamics else 0

        row = self.n_u
        self.torque_row = row
        row += self.n_torque
        self.cone_row = row
        row += self.n_cone
        self.barrier_rows, row = _starts(self.barriers, row)
        self.constraint_rows, row = _starts(self.constraints, row)
        self.soft_constraint_rows, row = _starts(self.soft_constraints, row)
        self.n_range = row - self.n_u
        self.linear_rows, row = _starts(self.linear, row)
        self.motion_row = row
        self.kinematic_rows, row = _starts(self.kinematic, row)
        self.n_soft = row - self.n_u - self.n_range
        self.exact_rows, row = _starts([constraint.task for constraint in self.exact], row)
        self.contact_row = row
        self.contact_rows, row = _starts(self.contacts, row)
        self.n_equal = row - self.n_u - self.n_range - self.n_soft
        self.force_columns, _ = _starts(self.contacts, model.nv)
        self.slack_columns, _ = _starts(self.soft_constraints, model.nv + self.nf)
        self.n_rows = row
        # Where a command finds its parts in the problem's vector of values [x | 1 | rows].
        self.motion_items, self.force_items = slice(0, model.nv), slice(model.nv, model.nv + self.nf)
        self.torque_items = slice(self.n + 1 + self.torque_row, self.n + 1 + self.torque_row + self.n_torque)

    def _each(self, constraint: Any) -> Sequence[Any]:
        """A constraint, or those that it stands for at this level."""
        if not isinstance(constraint, Constraints):
            return [constraint]
        constraints = constraint.constraints(self.level.bounds)
        for one in constraints:
            one.prepare(self.model)
        return constraints

    def _refuse_what_has_no_kind(self, members: Sequence[Any]) -> None:
        sorted_members: list[object] = [*self.linear, *self.kinematic, *self.on_joints, *self.exact, *self.barriers]
        sorted_members += [*self.constraints, *self.motion_limits, *self.torque_limits, *self.soft_constraints]
        sorted_members += [soft.constraint for soft in self.slack]
        for member in members:
            if not any(member is known for known in sorted_members):
                raise NotSupported(
                    f"{member.name} is a {type(member).__name__}, neither a Task nor a LinearTask, Barrier, "
                    "LinearConstraint or JointInterval: nothing says what its rows are"
                )
        tasks = [*self.linear, *self.kinematic, *self.on_joints, *(constraint.task for constraint in self.exact)]
        sizes = [(task.name, getattr(task, "dim", None)) for task in tasks]
        constraints: list[Any] = [*self.barriers, *self.constraints, *of_kind(members, Softly)]
        constraints += [soft.constraint for soft in self.slack if not isinstance(soft.constraint, JointInterval)]
        sizes += [(constraint.name, getattr(constraint, "dim", None)) for constraint in constraints]
        for name, dim in sizes:
            if dim is None or dim < 1:
                raise InvalidInput(
                    f"{name}.dim is {dim}; set it, and units, in __init__: a member has at least one row"
                )

    def _refuse_what_the_level_cannot_carry(self) -> None:
        level = self.level
        soft = [member.constraint for member in self.soft_constraints]
        intervals: list[JointInterval] = [*self.motion_limits, *self.torque_limits, *of_kind(soft, JointInterval)]
        limits = [(constraint.name, constraint.quantity, level.bounds) for constraint in intervals]
        rows = [(task.name, task.on, level.carries) for task in self.linear]
        linear: list[LinearConstraint] = [*self.constraints, *of_kind(soft, LinearConstraint)]
        rows += [(constraint.name, constraint.on, level.carries) for constraint in linear]
        for name, quantity, carried in [*limits, *rows]:
            if quantity not in carried:
                raise NotSupported(
                    f"{name} is about {quantity}, which the {level.name} does not decide; "
                    f"it carries {', '.join(sorted(carried))}"
                )

    def forces_of(self, member: LinearTask | LinearConstraint) -> Index:
        """Columns of the wrenches that a member on "force" speaks of.

        Raises:
            UnknownName: no contact of that name or frame.
        """
        from wbc.errors import UnknownName

        columns: list[int] = []
        for name in force_of(member):
            for contact, first in zip(self.contacts, self.force_columns, strict=True):
                if name in (contact.name, contact.frame):
                    columns += range(first, first + contact.dim)
                    break
            else:
                raise UnknownName(name, [c.frame for c in self.contacts], f"{member.name} needs a contact")
        return np.array(columns, dtype=np.intp)

    def size_of(self, member: LinearTask | LinearConstraint) -> int:
        """Size of the quantity that a member is about."""
        if member.on == "force":
            return len(self.forces_of(member))
        return self.model.nj if member.on == "torque" else self.model.nv

    # ---- names
    def names(self) -> list[Row]:
        """Owner, label and unit of every row of G, then of every unknown."""
        model, level = self.model, self.level
        suffix = "/s" if level.order == 1 else "/s²"
        rows = [Row("base dynamics", label, "N" if i < 3 else "N m") for i, label in enumerate(_WRENCH[: self.n_u])]
        if self.n_torque:
            owner = self.torque_limits[0].name if self.torque_limits else "torque"
            effort = ["N" if unit == "m" else "N m" for unit in model.joint_units]
            rows += [Row(owner, joint, unit) for joint, unit in zip(model.joint_names, effort, strict=True)]
        if level.dynamics:
            for contact in self.contacts:
                rows += [Row(f"friction[{contact.short_name}]", label, unit) for label, unit in contact.cone_labels()]
        for barrier in self.barriers:
            rows += [Row(barrier.name, barrier.label(i), barrier.unit(i) + suffix) for i in range(barrier.dim)]
        for constraint in self.constraints:
            rows += [Row(constraint.name, constraint.label(i), constraint.unit(i)) for i in range(constraint.dim)]
        for soft in self.soft_constraints:
            rows += [Row(soft.name, soft.label(i), self._soft_unit(soft, i)) for i in range(soft.dim)]
        for linear in self.linear:
            rows += [Row(linear.name, linear.label(i), linear.unit(i)) for i in range(linear.dim)]
        for task in self.kinematic:
            rows += [Row(task.name, task.label(i), task.unit(i) + suffix) for i in range(task.dim)]
        for exact in self.exact:
            rows += [Row(exact.name, exact.task.label(i), exact.task.unit(i) + suffix) for i in range(exact.task.dim)]
        for contact in self.contacts:
            labels = zip(contact.motion_labels(), contact.motion_units(), strict=True)
            rows += [Row(f"contact[{contact.short_name}]", label, unit + suffix) for label, unit in labels]
        return rows + list(self._unknowns(suffix))

    def _unknowns(self, suffix: str) -> Iterator[Row]:
        model = self.model
        for i in range(model.nb):
            yield Row("base", _AXES[i], ("m" if i < 3 else "rad") + suffix)
        owner = self.motion_limits[0].name if len(self.motion_limits) == 1 else "joint limits"
        for joint, unit in zip(model.joint_names, model.joint_units, strict=True):
            yield Row(owner if self.motion_limits else "joint", joint, unit + suffix)
        if self.level.dynamics:
            for contact in self.contacts:
                for label, unit in contact.force_labels():
                    yield Row(f"force[{contact.short_name}]", label, unit)
        for soft in self.soft_constraints:
            for i in range(soft.dim):
                yield Row(f"{soft.name}: slack", soft.label(i), self._soft_unit(soft, i))

    def _soft_unit(self, soft: Softly, i: int) -> str:
        """Limits on motion and barriers are kept in the unknown's unit, whatever they are about."""
        constraint, suffix = soft.constraint, "/s" if self.level.order == 1 else "/s²"
        if isinstance(constraint, JointInterval) and constraint.quantity != "torque":
            return self.model.joint_units[i] + suffix
        return soft.unit(i) + (suffix if isinstance(constraint, Barrier) else "")


def _has_slack(constraint: Any) -> bool:
    return not isinstance(constraint, Exactly) and constraint.slack is not None


def of_kind(members: Any, kind: type[Any]) -> list[Any]:
    """Those members that are of this kind, in their order."""
    return [m for m in members if isinstance(m, kind)]


def _starts(members: Any, first: int) -> tuple[list[int], int]:
    """First row of each member, and the row behind the last."""
    starts = []
    for member in members:
        starts.append(first)
        first += member.dim
    return starts, first
