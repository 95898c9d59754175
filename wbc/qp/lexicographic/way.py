"""Way: how the QPs of the stages are solved; which stage comes when is not its business."""

from __future__ import annotations

from abc import ABC, abstractmethod

from wbc.qp.certificate import Certificate
from wbc.qp.solver import Counts
from wbc.types import Index, Status, Vec


class Way(ABC):
    """Solves stage after stage of a :class:`~wbc.qp.lexicographic.stages.StagedProblem` in its memory.

    In one tick: ``begin`` once, then ``solve(k)`` and ``hold(k)`` for stages in order of rank. ``solve(k)`` takes the
    stages above k as laws, whether they were solved in this tick and are held, or are only hoped to be met.
    """

    #: One word for reports: "dual" or "standard".
    form: str
    counts: Counts
    #: All guesses and iterations of this tick.
    iterations: int

    @abstractmethod
    def begin(self) -> bool:
        """Take over what the problem's memory says now. False: the base cannot be eliminated."""

    @abstractmethod
    def solve(self, k: int) -> Status:
        """Minimise stage k; what stands above it holds."""

    @abstractmethod
    def hold(self, k: int) -> Vec:
        """From here on stage k keeps what it has; its residual (rows of the stage,)."""

    @abstractmethod
    def certificate(self) -> Certificate:
        """Residuals of the last answer in its own problem."""

    @abstractmethod
    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        """y, z and z_box of the last answer in the standard form of its own problem."""

    @abstractmethod
    def active(self) -> tuple[Index, Vec]:
        """Items at a bound in the last answer, and on which side."""

    @abstractmethod
    def guess(self, items: Index, side: Vec) -> None:
        """Take these as active in the next answers."""

    @abstractmethod
    def begin_over(self) -> None:
        """Forget all earlier ticks."""
