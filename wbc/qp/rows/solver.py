"""RowSolver: answers a row problem in place. Which one is decided once, when a plan is compiled."""

from __future__ import annotations

from abc import ABC, abstractmethod

from wbc.qp.certificate import Certificate
from wbc.qp.rows.problem import RowProblem
from wbc.qp.solver import Counts
from wbc.types import Status, Vec


class RowSolver(ABC):
    """Leaves the answer in ``problem.value``: unknowns and rows, in physical units but for the scaled forces."""

    #: One word for reports: "dual", "box" or "standard".
    form: str

    def __init__(self, problem: RowProblem) -> None:
        self.problem = problem
        self.counts = Counts()
        self.iterations = 0
        self.certificate = Certificate(float("nan"), float("nan"), float("nan"))

    @abstractmethod
    def solve(self) -> Status:
        """Solve what the problem's memory says now."""

    @abstractmethod
    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        """Multipliers y, z, z_box of the standard form for the answer just found."""

    @abstractmethod
    def reset(self) -> None:
        """Forget the warm start."""

    @property
    @abstractmethod
    def active_count(self) -> int:
        """How many rows and bounds hold with equality, laws apart."""

    def answer(self) -> Vec:
        """x of the standard form for the answer just found."""
        return self.problem.x * self.problem.scale
