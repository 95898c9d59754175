"""Layout: which rows and unknowns a stack has at a level, in which order, and what each is called."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NotSupported, UnknownContact
from wbc.models.model import RobotModel
from wbc.qp.problem import Row
from wbc.stack.block import Block, MotionBlock, RowBlock, says_of
from wbc.stack.constraint import Barrier, Constraints, JointInterval, LinearConstraint, Softly, bounds_of
from wbc.stack.contact import AXES, WRENCH, Contact, keys
from wbc.stack.kernel_rows import CENTRE, MOMENTUM, kernel_rows_of
from wbc.stack.level import Level
from wbc.stack.member import EFFORTS, explained
from wbc.stack.stack import Stack
from wbc.stack.task import Exactly, LinearTask, Task, force_of
from wbc.types import Index

#: Levels for what not every level decides.
_DECIDED_BY = {
    "acceleration": "AccelerationLevel() or InverseDynamics()",
    "force": "InverseDynamics()",
    "torque": "InverseDynamics()",
}
_B = TypeVar("_B", bound=Block)


@final
class Layout:
    """The blocks of a stack in the order of their rows, and the names of all rows and unknowns.

    Rows of G: base (6 or none) | range: torques, cones, barriers, linear constraints, soft constraints | soft: linear,
    kinematic tasks | constraints: exact tasks, contacts. Unknowns: base and joints (u first where it is eliminated),
    then contact forces, then the slacks of soft constraints. Motion rows are those of kinematic tasks, exact tasks and
    contacts; tasks on the joints, which have no rows, stand behind them.

    Raises:
        NotSupported: a member the level cannot carry, by name.
    """

    def __init__(self, model: RobotModel, stack: Stack, level: Level, *, prepared: bool = False) -> None:
        self.model, self.level = model, level
        self._per = "/s" if level.order == 1 else "/s²"
        for member in () if prepared else (*stack.tasks, *stack.subject_to, *stack.contacts):
            with explained(f"{member.name}.prepare"):
                member.prepare(model)
        for contact in () if prepared else stack.contacts:
            with explained(f"{contact.name}.cone"):
                refuse_cone(contact)
        constraints = [one for constraint in stack.subject_to for one in self._each(constraint)]
        for member in (*stack.tasks, *constraints):
            self._refuse(member)
        #: Constraints with a slack, above every level.
        self.slack = [Softly(one, weight=one.slack, name=one.name) for one in constraints if _has_slack(one)]
        for soft in self.slack:
            soft.prepare(model)
        exact = [constraint for constraint in constraints if not _has_slack(constraint)]
        linear = [one for one in exact if isinstance(says_of(one), LinearConstraint | LinearTask)]
        tasks: list[Task] = of_kind(stack.tasks, Task)
        intervals: list[JointInterval] = of_kind(exact, JointInterval)
        #: Each limit on a quantity of the joints, with its bounds (nj,).
        self.joint_limits = [(limit, *bounds_of(limit, model)) for limit in intervals]
        self.motion_limits = [limit for limit in intervals if limit.quantity != "torque"]
        self.torque_limits = [limit for limit in intervals if limit.quantity == "torque"]

        #: Names of the rows, then of the unknowns.
        self.names: list[Row] = []
        named = self._of_member
        dynamics, nb, nj, nv = level.dynamics, model.nb, model.nj, model.nv
        self.n_u = nb if dynamics else 0
        self._rows(Row("base dynamics", WRENCH[i], "N" if i < 3 else "N m") for i in range(self.n_u))
        self.torque_row = self._rows(self._of_torques() if dynamics else ()).start
        cones = [
            self._rows(Row(f"friction[{contact.short_name}]", *one) for one in contact.cone_labels() if dynamics)
            for contact in stack.contacts
        ]
        self.barriers = self._blocks(RowBlock, of_kind(exact, Barrier), named)
        self.constraints = self._blocks(RowBlock, linear, named)
        self.soft = self._blocks(RowBlock, [*self.slack, *of_kind(stack.tasks, Softly)], named)
        self.n_range = len(self.names) - self.n_u
        self.linear = self._blocks(RowBlock, of_kind(stack.tasks, LinearTask), named)
        self.motion_row = len(self.names)
        self.kinematic = self._blocks(MotionBlock, [task for task in tasks if not task.on_joints], named)
        self.n_soft = len(self.names) - self.n_u - self.n_range
        self.exact = self._blocks(MotionBlock, [one for one in exact if isinstance(says_of(one), Task)], named)
        self.contact_row = len(self.names)
        self.contacts = self._blocks(MotionBlock, stack.contacts, self._of_contact)
        self.n_rows = len(self.names)
        self.n_equal = self.n_rows - self.n_u - self.n_range - self.n_soft
        self.joints = [MotionBlock(task, self._rows(()), slice(nb, nv)) for task in tasks if task.on_joints]

        self.names += [Row("base", AXES[i], ("m" if i < 3 else "rad") + self._per) for i in range(nb)]
        limit = self.motion_limits[0].name if len(self.motion_limits) == 1 else "joint limits"
        joints = zip(model.joint_names, model.joint_units, strict=True)
        self.names += [Row(limit if self.motion_limits else "joint", joint, unit + self._per) for joint, unit in joints]
        for block, cone in zip(self.contacts, cones, strict=True):
            block.cone = cone
            said = block.member.force_labels()
            block.unknowns = self._unknowns(Row(f"force[{block.member.short_name}]", *one) for one in said if dynamics)
        self.nf = self.n - nv
        # Those of constraints last: a solver may leave them out.
        for row_block in (*self.soft[len(self.slack) :], *self.soft[: len(self.slack)]):
            rows = self.names[row_block.rows]
            row_block.unknowns = self._unknowns(Row(f"{row_block.name}: slack", row.label, row.unit) for row in rows)

        #: What has weights.
        self.objectives: list[Block] = [*self.linear, *self.kinematic, *self.joints, *self.soft]
        #: Who writes motion rows, in the order in which these stand, and who writes others.
        self.motions = [*self.kinematic, *self.exact, *self.contacts, *self.joints]
        self.others = [*self.barriers, *self.constraints, *self.linear, *self.soft]
        first = 0
        for motion in self.motions:
            motion.motion = slice(first, first + motion.dim)
            first += motion.dim
        # Where a command finds its parts in the problem's vector of values [x | 1 | rows].
        self.motion_items, self.force_items = slice(0, nv), slice(nv, nv + self.nf)
        torques = self.n + 1 + self.torque_row
        self.torque_items = slice(torques, torques + (nj if dynamics else 0))

    @property
    def n(self) -> int:
        """How many unknowns there are."""
        return len(self.names) - self.n_rows

    def _rows(self, names: Iterable[Row]) -> slice:
        """The next rows of G."""
        first = len(self.names)
        self.names += names
        return slice(first, len(self.names))

    def _unknowns(self, names: Iterable[Row]) -> slice:
        """The next unknowns."""
        first = self.n
        self.names += names
        return slice(first, self.n)

    def _blocks(self, kind: type[_B], members: Iterable[Any], names: Callable[[Any], Iterable[Row]]) -> list[_B]:
        """The next rows of G, for one member after the other."""
        return [kind(member, self._rows(names(member))) for member in members]

    def _each(self, constraint: Any) -> Sequence[Any]:
        """A constraint, or those that it stands for at this level."""
        if not isinstance(constraint, Constraints):
            return [constraint]
        constraints = constraint.constraints(self.level.bounds)
        for one in constraints:
            one.prepare(self.model)
        return constraints

    def _refuse(self, member: Any) -> None:
        """Refuse what is of no kind, has no rows, or is about what the level does not decide or the robot has not."""
        says, level = says_of(member), self.level
        if not isinstance(says, Task | LinearTask | Barrier | LinearConstraint | JointInterval):
            raise NotSupported(
                f"{member.name} is a {type(says).__name__}, neither a Task nor a LinearTask, Barrier, "
                "LinearConstraint or JointInterval: nothing says what its rows are"
            )
        name = member.constraint.name if isinstance(member, Softly) else member.name
        if isinstance(says, JointInterval):
            quantity, carried = str(says.quantity), level.bounds
        else:
            checks.rows(says.name, says)
            quantity, carried = getattr(says, "on", ""), level.carries
        if quantity and quantity not in carried:
            raise NotSupported(
                f"{name} is about {quantity}, which the {level.name} does not decide; "
                f"use {_DECIDED_BY.get(quantity, ' or '.join(sorted(carried)))}"
            )
        rows = None if self.model.mass > 0.0 else kernel_rows_of(says)
        if rows is not None and {CENTRE, MOMENTUM} & {*rows.of}:
            raise InvalidInput(f"{self.model.name} has no mass, so {name} has no centre of mass to speak of")

    def forces_of(self, member: Any) -> Index:
        """Columns of the wrenches that a member on "force" speaks of; none for others.

        Raises:
            UnknownContact: no contact of that name, or none or several of that frame.
        """
        columns: list[int] = []
        held = {block.member.name: block for block in self.contacts}
        called = dict(keys([block.member for block in self.contacts]))
        for name in force_of(member):
            if name not in called:
                raise UnknownContact(name, called, f"{member.name} is about its force")
            columns += range(self.n)[held[called[name]].unknowns]
        return np.array(columns, dtype=np.intp)

    # ---- names
    def _of_member(self, member: Any) -> list[Row]:
        """Rows of a task or constraint. Limits on motion and barriers are kept in the unknown's unit."""
        says = says_of(member)
        shown = says if isinstance(member, Exactly) else member
        if isinstance(says, JointInterval) and says.quantity != "torque":
            units = [unit + self._per for unit in self.model.joint_units]
        else:
            per = self._per if isinstance(says, Task | Barrier) else ""
            units = [shown.unit(i) + per for i in range(shown.dim)]
        return [Row(member.name, shown.label(i), unit) for i, unit in enumerate(units)]

    def _of_torques(self) -> list[Row]:
        limits = self.torque_limits
        owner = limits[0].name if len(limits) == 1 else "torque limits" if limits else "torque"
        joints = zip(self.model.joint_names, self.model.joint_units, strict=True)
        return [Row(owner, joint, EFFORTS[unit]) for joint, unit in joints]

    def _of_contact(self, contact: Contact) -> list[Row]:
        said = zip(contact.motion_labels(), contact.motion_units(), strict=True)
        return [Row(f"contact[{contact.short_name}]", label, unit + self._per) for label, unit in said]


def refuse_cone(contact: Contact) -> None:
    """Refuse a contact whose sizes do not agree."""
    dim = getattr(contact, "dim", None)
    if dim is None:
        raise InvalidInput(f"{contact.name} has no dim; set it: how many numbers its force has")
    if not contact.bilateral and (len({*contact.wrench_axes} & {*range(6)}) != dim or 2 not in contact.wrench_axes):
        said = f"{contact.name}.wrench_axes is {checks.shown(contact.wrench_axes)}"
        raise InvalidInput(f"{said}; it must be {dim} of 0 to 5, and the normal force, 2, among them")
    cone, labels = checks.array(f"{contact.name}.cone()", contact.cone(), (None, dim)), contact.cone_labels()
    for what, given, wanted in (
        ("cone labels", labels, len(cone)), ("motion units", contact.motion_units(), dim),
        ("motion labels", contact.motion_labels(), dim),
    ):  # fmt: skip
        if len(given) != wanted:
            raise InvalidInput(f"{contact.name} has {len(given)} {what}; it must have {wanted}, one for each row")
    for label in labels:
        if len(checks.items(f"a cone label of {contact.name}", label, "a label and a unit")) != 2:
            raise InvalidInput(
                f"a cone label of {contact.name} is {checks.shown(label)}; it must be a label and a unit"
            )


def _has_slack(constraint: Any) -> bool:
    return not isinstance(constraint, Exactly) and constraint.slack is not None


def of_kind(members: Any, kind: type[Any]) -> list[Any]:
    """Those members that are of this kind, in their order."""
    return [m for m in members if isinstance(m, kind)]
