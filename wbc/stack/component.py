"""Component: memory. The only thing in a stack with state."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from typing import TYPE_CHECKING

from wbc.models.model import RobotModel, RobotState
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.stack.plan import Plan


class Component(ABC):
    """An observer, an adaptive law, a schedule: it remembers between ticks.

    ``before`` may change targets, weights and bounds (``plan.torque_bounds``, ``plan.normal_limits``) and add to the
    model's bias (``plan.extra_bias``) and inertia (``plan.add_inertia``), which are its own again at the start of each
    tick, never sizes; ``after`` sees what was decided; ``signals`` is what the recorder writes. Which contacts hold is
    said by a :class:`~wbc.stack.schedule.Schedule`.
    """

    _name: str | None = None

    def __init__(self, *, name: str | None = None) -> None:
        self._name = name

    @property
    def name(self) -> str:
        """Given, or the class."""
        return self._name or type(self).__name__

    def prepare(self, model: RobotModel) -> None:
        """Called once when a stack is compiled: fix sizes."""

    def reset(self, state: RobotState) -> None:
        """Called before the first tick, and whenever the controller starts again."""

    def before(self, state: RobotState, last: object, plan: Plan) -> None:
        """Called in each tick before the plan is filled; ``last`` is the previous Command or None."""

    def after(self, state: RobotState, command: object) -> None:
        """Called in each tick with the command just decided."""

    def signals(self) -> Mapping[str, Vec | float]:
        """What to record each tick, by name; sizes do not change."""
        return {}

    def __repr__(self) -> str:
        return self.name
