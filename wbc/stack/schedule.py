"""Schedule: the component that says which contacts hold."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from wbc.models.model import RobotState
from wbc.stack.component import Component


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
