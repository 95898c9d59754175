"""Objective: what can stand among the tasks of a stack."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, UnknownName
from wbc.models.model import RobotModel
from wbc.stack.by_name import ByName
from wbc.stack.member import Member, setting
from wbc.types import Vec, read_only


class Objective(Member):
    """Anything that can stand among the tasks of a stack: a name, a weight, a switch.

    ``weight`` is a scalar, one number per row, or {label of a row, or pattern: number}, and multiplies the squared
    error: the cost is ½ Σ wᵢ rᵢ². A pattern is a regular expression that matches the whole label; of several that match
    the last holds, and rows that match none have weight 1. ``weight`` and ``active`` may be assigned between ticks;
    sizes may not change.
    """

    #: What is raised for a label that does not exist.
    unknown_row: ClassVar[type[UnknownName]] = UnknownName
    # Defaults at class level, so that a subclass which forgets super().__init__ still works.
    _weight: float | Vec | ByName = 1.0
    _active: bool = True
    #: Whether it may be done in part, all its rows alike; see :meth:`Task.scaled`.
    is_scaled: bool = False
    read_once = frozenset({"is_scaled"})

    def __init__(self, *, name: str | None = None, weight: Any = 1.0) -> None:
        self._name = name
        self.weight = weight

    def _numbers(self, what: str, value: Any) -> float | Vec | ByName:
        """A weight or gain as it is given: >= 0, and of the right size or labels as soon as these are known."""
        name = f"{self.name}.{what}"
        given: Vec | ByName
        if isinstance(value, Mapping):
            given = ByName(name, value)
        elif checks.ndim(value) == 0:
            return checks.number(name, value, low=0.0)
        else:
            # Assign to change it: writing into it would go unseen.
            given = read_only(checks.array(name, value, (None,), low=0.0))
        if hasattr(self, "dim"):
            self._rows(what, given)
        return given

    def _truth(self, what: str, value: Any) -> bool:
        return checks.truth(f"{self.name}.{what}", value)

    weight = setting("weight", "Weight of the squared error, scalar, (dim,) or by label.", _numbers)
    active = setting("active", "Whether it counts in the cost; as a constraint (``exactly``) it holds anyway.", _truth)

    def weights(self) -> Vec:
        """The weight of each row (dim,), zero when inactive."""
        weights = self._rows("weight", self._weight)
        return weights if self._active else np.zeros(self.dim)

    def _rows(self, what: str, value: float | Vec | ByName) -> Vec:
        """``value`` for each row (dim,), a copy. What was given before ``dim`` was known is checked here."""
        if isinstance(value, ByName):
            labels = [self.label(i) for i in range(self.dim)]
            if not any(labels):
                raise InvalidInput(f"{self.name}.{what} is {value}, but its rows have no names; give numbers")
            return value.rows(labels, self._default(what), self.unknown_row)
        if checks.ndim(value) == 0:
            return np.full(self.dim, value)
        return checks.array(f"{self.name}.{what}", value, (self.dim,))

    def _all_rows(self, what: str, value: Any) -> Vec:
        """A number >= 0 for each row (dim,), each of which is to be given."""
        rows = self._rows(what, self._numbers(what, value))
        if np.isnan(rows).any():
            raise InvalidInput(f"{self.name}.{what} says nothing of {self.label(int(np.isnan(rows).argmax()))!r}")
        return rows

    def _default(self, what: str) -> float:
        """Weight or gain of rows of which none was given; NaN where it follows from another gain."""
        default = getattr(type(self), f"_{what}", None)
        return np.nan if default is None else float(default)

    def _as_constraint(self, model: RobotModel) -> Any:
        """Prepare the task; returns what writes the rows of a constraint that it is made."""
        self.prepare(model)
        return self

    def own_rows(self, values: Vec) -> Vec:
        """Of numbers (dim,), one for each row, those of rows that are none of the task's are zero."""
        return values

    def __repr__(self) -> str:
        return f"{self.name}(weight={self._weight}{', scaled' if self.is_scaled else ''})"
