"""Component: the only member of a stack with state. A Schedule is the component that selects the active contacts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.models.model import RobotModel, RobotState
from wbc.stack.overrides import Overrides
from wbc.stack.plan_view import PlanView
from wbc.types import Vec


class Component(metaclass=TellsArguments):
    """A member with state between ticks: an observer, an adaptive controller, a schedule. It serves one controller at a
    time, the last that was made or started with it: the status of any other is not ok until its ``reset()``.
    ``copy.copy(controller)`` copies its components too.

    In each tick ``before`` returns its changes as an :class:`~wbc.stack.overrides.Overrides`, or None. ``after`` gets
    the command; the recorder writes ``signals``. A :class:`Schedule` selects the active contacts. If a component raises
    or returns an invalid value, the command of the tick is a bounded fallback, its status is not ok, and
    ``controller.why`` names the component.
    """

    _name: str | None = None
    #: The plan of all contacts of the controller that it serves.
    serves: PlanView | None = None

    def __init__(self, *, name: str | None = None) -> None:
        self._name = None if name is None else checks.text("name", name)

    @property
    def name(self) -> str:
        """Given, or the class."""
        return self._name or type(self).__name__

    def __getstate__(self) -> dict[str, Any]:
        """The state without the last plan: a copy or a pickle gets a plan of its own."""
        return {name: value for name, value in self.__dict__.items() if not isinstance(value, PlanView)}

    def prepare(self, model: RobotModel) -> None:
        """Called once when a stack is compiled: fix sizes."""

    def reset(self, state: RobotState) -> None:
        """Called before the first tick, and whenever the controller starts again."""

    def check(self, plan: PlanView) -> None:
        """Called once when a controller is made, with the plan of all contacts: raise if the stack lacks a member."""

    def before(self, state: RobotState, last: object, plan: PlanView) -> Overrides | None:
        """The changes of this tick; called before the plan is filled.

        ``last`` is the previous Command or None. ``plan`` is read-only and has the values of the tick before.
        """

    def after(self, state: RobotState, command: object) -> None:
        """Called in each tick with the command just decided."""

    def signals(self) -> Mapping[str, Vec | float]:
        """Numbers and vectors for the record of each tick, by name; their sizes do not change.

        If they cannot be recorded, the tick is recorded without them; ``run.meta["silent"]`` says why.
        """
        return {}

    def __repr__(self) -> str:
        return self.name


class Schedule(Component):
    """Selects the active contacts of the stack in each tick. A stack has at most one schedule.

    The controller then uses the plan that was compiled for this set of contacts. A new contact is made where the robot
    is, or at its target. When a contact is removed, its force variables and all tasks on its force are removed too.
    Contacts are selected by their name, or by their frame if it has no other contact.
    """

    @abstractmethod
    def contact_sets(self) -> Iterable[Iterable[str]]:
        """The sets that ``contacts`` can name; their plans are compiled before the first tick."""

    @abstractmethod
    def contacts(self, state: RobotState, last: object) -> Iterable[str]:
        """The set of this tick, called before any component's ``before``; ``last`` is the previous Command or None.

        A set that has no plan yet is compiled outside the tick; until then the present plan holds.
        """
