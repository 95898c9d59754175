"""Wish: what one task asks, told apart from the sum of all costs, for those who rank tasks instead of adding them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

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
