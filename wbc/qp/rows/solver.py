"""RowSolver: answers a row problem in place. Which one is decided once, when a plan is compiled."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from functools import partial
from typing import final

import numpy as np

from wbc.qp.answer import Counts
from wbc.qp.certificate import Certificate
from wbc.qp.problem import QP, Row
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.row_task import Outcome
from wbc.types import Index, Status, Vec


class RowSolver(ABC):
    """Leaves the answer in ``problem.value``: unknowns and rows, in physical units but for the scaled forces."""

    #: One word for reports: "rows", "variables", "standard" or "levels".
    form: str
    #: Whether ``solve`` is compiled code and nothing else that computes.
    is_compiled = False
    #: Place and argument of the compiled code that ``solve`` begins with, whose answer ``concluded`` is told; place 0:
    #: no other compiled code can call it.
    kernel = 0, 0
    #: Why a solution that meets all constraints is not optimal: "not optimised", "weighted fallback"; "" where it is.
    shortfall = ""
    #: What is wrong with what a back end returned; "" where nothing is.
    fault = ""

    def __init__(self, problem: RowProblem) -> None:
        self.problem = problem
        self.counts = Counts()
        self.iterations = 0
        #: Says what is proven of the last answer, also later.
        self.proof: Callable[[], Certificate] = partial(Certificate, float("nan"), float("nan"), float("nan"))
        #: Says how what was ranked came out in the last answer, also later: () where nothing is ranked.
        self.report: Callable[[], tuple[Outcome, ...]] = tuple

    @property
    def certificate(self) -> Certificate:
        """What is proven of the last answer."""
        return self.proof()

    @certificate.setter
    def certificate(self, known: Certificate) -> None:
        self.proof = lambda: known

    @abstractmethod
    def solve(self) -> Status:
        """Solve what the problem's memory says now."""

    def concluded(self, code: int) -> Status:
        """What the answer of the ``kernel`` means, once it was called."""
        raise AssertionError(f"{type(self).__name__} has no kernel that says {code}")

    @abstractmethod
    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        """Multipliers y, z, z_box of the standard form for the answer just found."""

    @abstractmethod
    def reset(self) -> None:
        """Forget the warm start."""

    def working_set(self) -> tuple[Index, Vec]:
        """Items held at a bound in the last answer, and on which side: +1 upper, −1 lower. None where none is kept."""
        return np.zeros(0, np.intp), np.zeros(0)

    def guess(self, items: Index, side: Vec) -> None:
        """Take these as held in the next answer. A solver that does not guess has no use for it."""

    @final
    def start_from(self, former: RowSolver) -> None:
        """Guess what held in the answer of another problem, for the rows and unknowns that both have by name; what only
        this one has is guessed as in its own last answer."""
        items, other = self.problem.items, former.problem.items
        held = {row: side for row, side in self.named_working_set() if row not in other}
        held.update((row, side) for row, side in former.named_working_set() if row in items)
        found = [items[row] for row in held]
        self.guess(np.array(found, dtype=np.intp), np.array([*held.values()], dtype=np.float64))

    def named_working_set(self) -> Iterator[tuple[Row, float]]:
        """The working set by name."""
        p, (items, side) = self.problem, self.working_set()
        names = [p.rows[p.n_rows + i] if i < p.n else p.rows[i - p.first_row] for i in items.tolist()]
        return zip(names, side.tolist(), strict=True)

    @final
    @property
    def active_count(self) -> int:
        """How many rows and bounds hold with equality, equalities apart."""
        return len(self.working_set()[0])

    @property
    def answered(self) -> RowProblem:
        """The problem that :meth:`answer` and :meth:`multipliers` are about: for most, the one they were opened for."""
        return self.problem

    @property
    def shared(self) -> int:
        """How many unknowns of :attr:`answered`, its first ones, are those of the problem it was opened for."""
        return self.problem.n

    @final
    def standard_form(self) -> QP:
        """The standard form of :attr:`answered`, in memory of its own."""
        qp = self.answered.empty_qp()
        self.answered.write_qp(qp)
        return qp

    @final
    def answer(self) -> Vec:
        """x of the standard form for the answer just found."""
        return self.answered.x * self.answered.scale
