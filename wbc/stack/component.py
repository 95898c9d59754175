"""Component: memory. The only thing in a stack with state. A Schedule is the one that says which contacts hold."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any

from wbc import checks
from wbc.models.model import RobotModel, RobotState
from wbc.stack.overrides import Overrides
from wbc.stack.plan_view import PlanView
from wbc.types import Vec


class Component(ABC):
    """An observer, an adaptive law, a schedule: it remembers between ticks.

    In each tick ``before`` returns what it changes there, an :class:`~wbc.stack.overrides.Overrides`, or None;
    ``after`` sees what was decided; ``signals`` is what the recorder writes. Which contacts hold is said by a
    :class:`Schedule`. A component that raises, or returns what makes no sense, costs the tick its
    answer: the command is a bounded fallback, its status is not ok, and ``controller.why`` names the component.
    """

    _name: str | None = None

    def __init__(self, *, name: str | None = None) -> None:
        self._name = None if name is None else checks.text("name", name)

    @property
    def name(self) -> str:
        """Given, or the class."""
        return self._name or type(self).__name__

    def __getstate__(self) -> dict[str, Any]:
        """What is remembered, without the plan that was seen last: a copy, or a pickle, sees another one."""
        return {name: value for name, value in self.__dict__.items() if not isinstance(value, PlanView)}

    def prepare(self, model: RobotModel) -> None:
        """Called once when a stack is compiled: fix sizes."""

    def reset(self, state: RobotState) -> None:
        """Called before the first tick, and whenever the controller starts again."""

    def check(self, plan: PlanView) -> None:
        """Called once when a controller is made, with the plan of all contacts: refuse what the stack lacks."""

    def before(self, state: RobotState, last: object, plan: PlanView) -> Overrides | None:
        """What holds in this tick; called before the plan is filled.

        ``last`` is the previous Command or None. ``plan`` is to be read: it holds what was in force in the tick before.
        """

    def after(self, state: RobotState, command: object) -> None:
        """Called in each tick with the command just decided."""

    def signals(self) -> Mapping[str, Vec | float]:
        """What to record each tick, by name; sizes do not change."""
        return {}

    def __repr__(self) -> str:
        return self.name


class Schedule(Component):
    """Names, in each tick, those of the stack's contacts that hold; a stack has at most one.

    The controller then uses the plan compiled for that set: a contact that was not in the set before is made where the
    robot is (or at its target), one that is no longer named is gone, and what is said about its force with it.
    Contacts are named by their name, or by their frame where no other contact is on it.
    """

    @abstractmethod
    def contact_sets(self) -> Iterable[Iterable[str]]:
        """The sets that ``contacts`` can name; their plans are compiled before the first tick."""

    @abstractmethod
    def contacts(self, state: RobotState, last: object) -> Iterable[str]:
        """The set of this tick, asked for before any component's ``before``; ``last`` is the previous Command or None.

        A set that has no plan yet is compiled outside the tick; until then the present plan holds.
        """
