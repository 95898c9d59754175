"""levels_of: at which levels a member of a stack serves, found by compiling it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.models.model import RobotModel, RobotState
from wbc.stack.component import Component
from wbc.stack.contact import Contact
from wbc.stack.formulation import AccelerationLevel, Formulation, InverseDynamics, VelocityLevel
from wbc.stack.member import Member
from wbc.stack.stack import Stack
from wbc.stack.task import Objective, Task, TaskRows

LEVELS: tuple[Formulation, ...] = (VelocityLevel(), AccelerationLevel(), InverseDynamics())


def stack_with(member: Any, contacts: Iterable[Contact] = ()) -> Stack:
    """A stack of one member in its place, and a task that damps the joints."""
    places: dict[str, list[Any]] = {"tasks": [_Still()], "subject_to": [], "contacts": [*contacts], "components": []}
    kinds = ((Objective, "tasks"), (Contact, "contacts"), (Component, "components"))
    places[next((place for kind, place in kinds if isinstance(member, kind)), "subject_to")].append(member)
    return Stack(places.pop("tasks"), **places)


def levels_of(member: Any, model: RobotModel, *, contacts: Iterable[Contact] = ()) -> tuple[Formulation, ...]:
    """The levels that carry a task, constraint, contact or component on ``model``.

    ``contacts``: those that the member speaks of, if it does.

    Example:
        >>> import wbc
        >>> from wbc.tasks import TorqueLimits
        >>> from wbc.testing import levels_of
        >>> [level.name for level in levels_of(TorqueLimits(), wbc.load("arm"))]
        ['inverse dynamics']
    """
    checks.instance("model", model, RobotModel, "a robot from wbc.load(...)")
    if not isinstance(member, Member | Component):
        raise InvalidInput(f"member is {checks.shown(member)}; it must be a task, constraint, contact or component")
    stack, found = stack_with(member, checks.items("contacts", contacts, "contacts")), []
    for level in LEVELS:
        try:
            level.compile(model, stack, dt=1e-3)
        except NotSupported:
            continue
        found.append(level)
    return tuple(found)


class _Still(Task):
    """Damping of all joints, so that every problem has a unique solution."""

    on_joints = True

    def __init__(self) -> None:
        super().__init__(kp=0.0, kd=1.0, weight=1e-6, name="still")

    def prepare(self, model: RobotModel) -> None:
        self.dim, self.units = model.nj, model.joint_units

    def fill(self, state: RobotState, out: TaskRows) -> None:
        out.e[:] = 0.0
