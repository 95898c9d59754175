"""Method: problem data with two ways to its answer, a closed form and a QP."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

from wbc.arguments import TellsArguments
from wbc.qp.problem import QP
from wbc.qp.solver import Solver
from wbc.types import Frozen


class Method(Frozen, metaclass=TellsArguments):
    """Frozen problem data. ``closed_form()`` and ``solve(solver)`` give the same kind of result.

    ``difference`` says how far two results are from each other, by name, each number relative to what it measures, so
    that one tolerance judges all: an unknown where it is unique, residuals and cost always.
    :func:`wbc.testing.check_method` uses it to compare the closed form with every installed solver.
    """

    @abstractmethod
    def closed_form(self) -> Any:
        """The answer by formula.

        Raises:
            NoClosedForm: there is none with these options.
        """

    @abstractmethod
    def qp(self) -> QP:
        """The method as a constrained QP, with named rows and units."""

    @abstractmethod
    def solve(self, solver: str | Solver = "pdas") -> Any:
        """The answer through a QP solver."""

    @abstractmethod
    def difference(self, result: Any, reference: Any) -> Mapping[str, float]:
        """Relative differences by name; infinite where one result is feasible and the other is not. Signs do not
        count."""
