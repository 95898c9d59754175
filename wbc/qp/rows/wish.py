"""Wish: what one task asks, told apart from the sum of all costs, for those who rank tasks; and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

from wbc.types import Vec


@final
@dataclass(frozen=True, eq=False)
class Wish:
    """½ Σ wᵢ (Jᵢ x − wantedᵢ)²: soft rows of G, or unknowns that are wanted at a value (J the identity there).

    ``rows`` is where it stands in G, or ``unknowns`` which part of x it is about; the other one is None. ``weights``,
    ``wanted`` and ``drift`` (dim,) are views that follow the plan. ``scaled``: it may be done in part, as
    J x + drift = s (wanted + drift) with one s in [0, 1] for all its rows; the drift is there whatever is asked.
    """

    name: str
    rows: slice | None
    unknowns: slice | None
    weights: Vec
    wanted: Vec
    drift: Vec
    kinematic: bool = False
    scaled: bool = False

    @property
    def dim(self) -> int:
        """How many numbers it is about."""
        return len(self.weights)


class Outcome(NamedTuple):
    """How wishes that were decided together came out: their names, ``how``, and what is left of them, √Σ wᵢ rᵢ².

    ``how`` is "met": nothing is left. "least": the least that what ranks above leaves. "left": the budget ended before
    it was decided. "weighed": there was no strict answer, and the weighted sum was the exit.
    """

    wishes: tuple[str, ...]
    how: str
    residual: float

    def __str__(self) -> str:
        left = "" if self.how == "met" or self.residual != self.residual else f", {self.residual:.3g} is left of it"
        return f"{' + '.join(self.wishes) or 'regularisation'}: {self.how}{left}"
