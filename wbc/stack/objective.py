"""Objective: what can stand among the tasks of a stack."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.member import Member
from wbc.types import Vec


class Objective(Member):
    """Anything that can stand among the tasks of a stack: a name, a weight, a switch.

    ``weight`` is a scalar or one number per row and multiplies the squared error: the cost is
    ½ Σ wᵢ rᵢ². ``weight`` and ``active`` may be assigned between ticks; sizes may not change.
    """

    dim: int
    units: str | tuple[str, ...]
    #: What rows are called in reports.
    labels: Sequence[str] = ()
    # Defaults at class level, so that a subclass which forgets super().__init__ still works.
    _name: str | None = None
    _weight: float | Vec = 1.0
    _active: bool = True
    #: Whether it may be done in part, all its rows alike; see :meth:`Task.scaled`.
    is_scaled: bool = False

    def __init__(self, *, name: str | None = None, weight: Any = 1.0) -> None:
        self._name = name
        self.weight = weight

    @property
    def name(self) -> str:
        """Given, or the class and what it acts on."""
        given = "" if self._name is None else checks.text("name", self._name)
        return given or self._default_name()

    def _default_name(self) -> str:
        subject = checks.text(f"the subject of {type(self).__name__}", getattr(self, "subject", ""))
        return f"{type(self).__name__}[{subject}]" if subject else type(self).__name__

    @property
    def weight(self) -> float | Vec:
        """Weight of the squared error, scalar or (dim,)."""
        return self._weight

    @weight.setter
    def weight(self, value: Any) -> None:
        if checks.ndim(value) == 0:
            self._weight = checks.number(f"{self.name}.weight", value, low=0.0)
        else:
            weights = checks.array(f"{self.name}.weight", value, (getattr(self, "dim", None),))
            if (weights < 0).any():
                i = int(np.argmax(weights < 0))
                raise InvalidInput(f"{self.name}.weight[{i}] is {weights[i]:g}; a weight is >= 0")
            weights.flags.writeable = False  # assign to change it: writing into it would go unseen
            self._weight = weights

    @property
    def active(self) -> bool:
        """Whether the task counts among the wishes; as a law (``exactly``) it holds whatever this says."""
        return self._active

    @active.setter
    def active(self, value: bool) -> None:
        self._active = bool(value)

    def weights(self) -> Vec:
        """The weight of each row (dim,), zero when inactive."""
        weights = self._rows("weight", self._weight)
        return weights if self._active else np.zeros(self.dim)

    def _rows(self, what: str, value: float | Vec) -> Vec:
        """``value`` for each row (dim,), a copy. A vector given before ``dim`` was known is checked here."""
        if checks.ndim(value) == 0:
            return np.full(self.dim, value)
        return checks.array(f"{self.name}.{what}", value, (self.dim,))

    def unit(self, row: int) -> str:
        """Unit of one row of the error."""
        return self.units if isinstance(self.units, str) else self.units[row]

    def label(self, row: int) -> str:
        """What one row is called in reports."""
        return self.labels[row] if self.labels else ""

    def prepare(self, model: RobotModel) -> None:
        """Called once on each plan's own copy of the task: check arguments against the model, fix ``dim``.

        What depends on the model is written here and nowhere else, so that one task serves plans of several robots.
        """

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        """Instances that make sense on ``model``, for the contract tests; to be written where arguments are needed."""
        del model
        return [cls()]

    def __repr__(self) -> str:
        return f"{self.name}(weight={self._weight}{', scaled' if self.is_scaled else ''})"
