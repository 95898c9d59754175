"""Stack: an immutable, printable value that says what a robot should do."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.stack.component import Component
from wbc.stack.constraint import Constraint
from wbc.stack.contact import Contact
from wbc.stack.member import Binding
from wbc.stack.task import Exactly, Objective, force_of
from wbc.types import Frozen


@final
@dataclass(frozen=True, init=False, eq=False)
class Stack(Frozen, metaclass=TellsArguments):
    """Tasks in levels, constraints, contacts and components.

    A flat list of tasks is one level; a list of lists is levels. Constraints and contacts stand above every level. What
    the levels mean is the hierarchy's business: :class:`~wbc.stack.hierarchy.Weighted`, the default, knows no
    priorities and adds all tasks of all levels up with their weights; :class:`~wbc.stack.hierarchy.Strict` decides
    level by level, and :class:`~wbc.stack.hierarchy.Scaled` does every task as a whole or in part.

    Raises:
        InvalidInput: something that is not a task, constraint, contact or component in its place; two equal names.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointVelocityLimits, Posture
        >>> robot = wbc.load("arm")
        >>> print(wbc.Stack([Posture(robot.q0)], subject_to=[JointVelocityLimits()]))
        Stack
          level 1: Posture(weight=1.0)
          subject to: JointVelocityLimits
    """

    levels: tuple[tuple[Objective, ...], ...]
    subject_to: tuple[Any, ...]
    contacts: tuple[Contact, ...]
    components: tuple[Component, ...]

    def __init__(
        self,
        tasks: Sequence[Objective] | Sequence[Sequence[Objective]],
        *,
        subject_to: Iterable[Any] = (),
        contacts: Iterable[Contact] = (),
        components: Iterable[Component] = (),
    ) -> None:
        tasks = checks.items("tasks", tasks, _PLACES["tasks"][1])
        nested = any(isinstance(t, list | tuple) for t in tasks)
        if nested and not all(isinstance(t, list | tuple) for t in tasks):
            raise InvalidInput("tasks must be one flat list, or a list of lists (levels), not a mixture")
        levels = tuple(tuple(level) for level in tasks) if nested else (tuple(tasks),)
        others = {"subject_to": subject_to, "contacts": contacts, "components": components}
        others = {where: tuple(checks.items(where, given, _PLACES[where][1])) for where, given in others.items()}
        self._set(levels=levels, **others)
        for where in _PLACES:
            _only(where, getattr(self, where))
        self._refuse_equal_names()

    @property
    def tasks(self) -> tuple[Objective, ...]:
        """All tasks, level after level."""
        return tuple(task for level in self.levels for task in level)

    def standing_on(self, names: Collection[str]) -> Stack:
        """The same stack with only the contacts of these names, and without what is said about the force of others."""

        def holds(member: Any) -> bool:
            return all(contact in known for contact in force_of(member))

        contacts = [contact for contact in self.contacts if contact.name in names]
        known = {contact.name for contact in contacts} | {contact.frame for contact in contacts}
        levels = [[task for task in level if holds(task)] for level in self.levels]
        return Stack(
            [level for level in levels if level],
            subject_to=[constraint for constraint in self.subject_to if holds(constraint)],
            contacts=contacts,
            components=self.components,
        )

    def bound(self, binding: Binding) -> Stack:
        """The same stack of a plan's own copies of the members; components, which have memory, are the same."""
        same = object.__new__(Stack)
        copies = {name: binding.own(getattr(self, name)) for name in ("levels", "subject_to", "contacts")}
        same._set(**copies, components=self.components)
        return same

    def _refuse_equal_names(self) -> None:
        seen: set[str] = set()
        for member in (*self.tasks, *self.subject_to, *self.contacts, *self.components):
            if member.name in seen:
                raise InvalidInput(f"two members of the stack are called {member.name!r}; give one of them a name=")
            seen.add(member.name)

    def __repr__(self) -> str:
        lines = ["Stack"]
        for i, level in enumerate(self.levels, start=1):
            lines.append(f"  level {i}: " + ", ".join(repr(t) for t in level))
        for title, members in (
            ("subject to", self.subject_to),
            ("contacts", self.contacts),
            ("components", self.components),
        ):
            if members:
                lines.append(f"  {title}: " + ", ".join(repr(m) for m in members))
        return "\n".join(lines)


#: What may stand in each place, what to write there, and the method that makes it of another member.
_PLACES: Mapping[str, tuple[Any, str, str]] = {
    "tasks": (Objective, "a task, such as Posture(robot.q0)", "softly"),
    "subject_to": ((Constraint, Exactly), "a constraint, such as JointLimits()", "exactly"),
    "contacts": (Contact, "a contact, such as each of feet(robot)", "with_reaction"),
    "components": (Component, "a component, such as ContactSchedule(…)", ""),
}


def _only(where: str, members: Iterable[Any]) -> None:
    kinds, such, method = _PLACES[where]
    for i, member in enumerate(members):
        if not isinstance(member, kinds):
            if isinstance(member, type):
                raise InvalidInput(f"{where}[{i}] is the class {member.__name__}; write {member.__name__}(…)")
            place = next((f"belongs in {one}" for one, (kind, *_) in _PLACES.items() if isinstance(member, kind)), "")
            hint = f"; its {method}() belongs here" if hasattr(member, method) else ""
            raise InvalidInput(f"{where}[{i}] is {checks.shown(member)}; it {place or f'must be {such}'}{hint}")
