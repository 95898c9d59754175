"""Hierarchy: what the levels of a stack mean, and so how a plan is solved."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

from wbc.qp.rows import RowProblem, RowSolver, open_rows
from wbc.qp.solver import Solver


class Hierarchy(ABC):
    """Frozen settings; ``open`` gives the solver with its memory."""

    @abstractmethod
    def open(self, problem: RowProblem, solver: Solver) -> RowSolver:
        """The solver of one plan."""


@final
@dataclass(frozen=True)
class Weighted(Hierarchy):
    """One QP: all tasks of all levels are added up with their weights, ½ Σ wᵢ rᵢ²; laws and contacts hold exactly.

    Of two tasks that contradict each other, with weight ratio r, the heavier keeps a relative error of about 1/r.
    """

    def open(self, problem: RowProblem, solver: Solver) -> RowSolver:
        return open_rows(problem, solver)
