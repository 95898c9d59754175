"""Checks of tasks, constraints, contacts and methods, also of your own, and strategies for property tests.

``check_task``, ``check_constraint``, ``check_contact`` and ``check_method`` raise :class:`CheckFailed` with the member,
the row or quantity and what differs. ``wbc.testing.strategies`` (for hypothesis) draws states, boxes and matrices.

Example:
    >>> from wbc.tasks import Position
    >>> from wbc.testing import check_task
    >>> check_task(Position("tool", target=[0.4, 0.0, 0.5]))
"""

from __future__ import annotations

from wbc.testing.constraints import check_constraint
from wbc.testing.contacts import check_contact
from wbc.testing.failure import CheckFailed
from wbc.testing.levels import levels_of
from wbc.testing.methods import check_method
from wbc.testing.robots import Moment, moments, robots
from wbc.testing.tasks import check_task

__all__ = [
    "CheckFailed", "Moment", "check_constraint", "check_contact", "check_method", "check_task", "levels_of", "moments",
    "robots",
]  # fmt: skip
