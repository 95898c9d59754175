"""RowTask: what one task asks, told apart from the sum of all costs, for those who rank tasks; and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

from wbc.qp.certificate import Certificate
from wbc.types import Vec


@final
@dataclass(frozen=True, eq=False)
class RowTask:
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


#: How a level came out that has no certificate of its own.
NOT_OPTIMISED, WEIGHTED = "not optimised", "weighted fallback"


class Outcome(NamedTuple):
    """How tasks that were decided together came out: their names, ``how``, what is left of them, √Σ wᵢ rᵢ², the proof.

    ``how`` is "met": nothing is left. "optimal": the least that the levels above leave. "not optimised": the budget
    ended first, and the tasks are where the levels above left them. "weighted fallback": there was no strict answer,
    and one weighted sum of all levels was minimised instead. The weights are those of the tick: a level that is slowed,
    because a level above was not met, has smaller ones than its tasks.
    """

    tasks: tuple[str, ...]
    how: str
    residual: float
    certificate: Certificate

    def __str__(self) -> str:
        how = self.how if self.residual != self.residual else f"{self.how}, weighted residual {self.residual:.3g}"
        said = {"met": self.how, "optimal": f"weighted residual {self.residual:.3g}, the least possible (optimal)"}
        return f"{' + '.join(self.tasks) or 'regularisation'}: {said.get(self.how, how)}"
