"""PlanView: what components read of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

from wbc.models.model import RobotModel
from wbc.stack.contact import Contact
from wbc.stack.level import Level
from wbc.stack.member import Binding
from wbc.stack.objective import Objective
from wbc.stack.overrides import Actuators
from wbc.types import Vec

if TYPE_CHECKING:  # these load the compiler, and components read views
    from wbc.stack.applied import Applied
    from wbc.stack.interval import JointIntervals


class Members(Protocol):
    """The members of a stack; :class:`~wbc.stack.stack.Stack` has them."""

    @property
    def tasks(self) -> tuple[Objective, ...]:
        """All tasks, level after level."""

    @property
    def subject_to(self) -> tuple[Any, ...]:
        """Limits and other constraints."""

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """All that a schedule can choose from."""

    @property
    def components(self) -> Sequence[Any]:
        """What remembers."""


class PlanView:
    """Of which members a plan is made, and what holds in the present tick. Nothing here can be written."""

    __slots__ = (
        "all_tasks", "applied", "binding", "dt", "extra_bias", "intervals", "level", "model", "stack", "torque_bounds",
    )  # fmt: skip

    model: RobotModel
    level: Level
    dt: float
    #: With the contacts that are closed in this tick alone.
    stack: Members
    #: The tasks of the whole stack, also those on the force of contacts that are open.
    all_tasks: tuple[Objective, ...]
    binding: Binding
    intervals: JointIntervals
    applied: Applied
    #: Added to h (nv,) in this tick [N, N m], read-only.
    extra_bias: Vec
    #: Bounds on the torques (lower, upper), (nj,) each [N m, N], read-only.
    torque_bounds: tuple[Vec, Vec]

    def bounds(self, quantity: str) -> tuple[Vec, Vec]:
        """Bounds (nj,) on each joint's "position", "velocity", "acceleration" or "jerk" in this tick, copies.

        Raises:
            InvalidInput: no such quantity.
        """
        return self.intervals.bounds(quantity)

    @property
    def actuators(self) -> Actuators:
        """What motors make of a command in this tick."""
        return self.applied.actuators
