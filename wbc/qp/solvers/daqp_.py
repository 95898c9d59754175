"""DAQP: a dual active-set method in C, warm-started from the last active set.

Arnström, Bemporad, Axehill: A dual active-set solver for embedded quadratic programming using recursive LDLᵀ
updates, IEEE Transactions on Automatic Control 67(8), 2022.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.qp.problem import QP
from wbc.qp.solver import Answer, Solver
from wbc.qp.solvers.kept import INFINITY, KeptSession
from wbc.tolerances import ACCURACY, NOISE
from wbc.types import Status

EQUALITY = 5

STATUS = {
    1: Status.SOLVED,
    -1: Status.INFEASIBLE,
    -3: Status.UNBOUNDED,
    -4: Status.MAX_ITERATIONS,
    -6: Status.INFEASIBLE,  # the equalities alone contradict each other
}


@final
class DaqpSession(KeptSession):
    """A kept model, which remembers its active set. Its items: the bounds on x, then the rows [A; C]."""

    solver: Daqp
    _flag: int

    def _write(self, qp: QP) -> bool:
        length = np.sqrt(np.einsum("ij,ij->i", qp.matrix, qp.matrix))
        self._share = 1.0 / np.where(length > 0.0, length, 1.0)  # it takes a row for zero that is small in its unit
        lower = np.maximum(np.append(qp.lb, qp.lower * self._share), -INFINITY)
        upper = np.minimum(np.append(qp.ub, qp.upper * self._share), INFINITY)
        self._data = qp.matrix * self._share[:, None], upper, lower
        return True

    def _make(self, qp: QP) -> Any:
        import daqp

        model, solver, (n, n_eq, n_in) = daqp.Model(), self.solver, self.shape
        # Its own elimination of equalities takes problems for infeasible where H is singular on what is left.
        # Rows depend on each other where a pivot is rounding. At its own 4e-11 rows 6e-6 rad apart count as infeasible.
        model.settings = {
            "primal_tol": solver.primal_tol, "eps_prox": solver.eps_prox, "eta_prox": solver.eta_prox,
            "iter_limit": solver.max_iter, "sing_tol": NOISE, "eq_reduction": 0,
        }  # fmt: skip
        sense = np.repeat(np.array([0, EQUALITY, 0], np.intc), [n, n_eq, n_in])
        self._flag, _ = model.setup(qp.H, qp.g, *self._data, sense)
        return model

    def _update(self, qp: QP, workspace: Any) -> None:
        matrix, upper, lower = self._data
        rows = matrix if len(matrix) else None  # an empty array is not understood here
        self._flag = workspace.update(qp.H, qp.g, rows, upper, lower)

    def _run(self, qp: QP, workspace: Any) -> Answer:
        if self._flag < 0:  # refused before the first step
            return Answer.none(qp.shape, STATUS.get(self._flag, Status.FAILED))
        x, _, flag, info = workspace.solve()
        n, n_eq, _ = qp.shape
        status, force = STATUS.get(flag, Status.FAILED), np.array(info["lam"])
        force[n:] *= self._share
        return Answer(status, np.array(x), force[n : n + n_eq], force[n + n_eq :], force[:n], int(info["iterations"]))


@final
@dataclass(frozen=True)
class Daqp(Solver):
    """Settings of DAQP.

    Args:
        primal_tol: how far a row may be violated [unit of the row]. Far below the required accuracy: it costs nothing.
        eps_prox: weight of the proximal terms where H is singular; negative: only there.
        eta_prox: change of x at which proximal steps end. Both defaults reach 1e-8 where DAQP's own reach 1e-6.
        max_iter: changes of the active set before it gives up.

    Raises:
        InvalidInput: a setting out of its range.

    Example:
        >>> from wbc.qp import QP
        >>> Daqp(max_iter=200).solve(QP([[1.0]], [-3.0], ub=[2.0])).x
        array([2.])
    """

    name = "daqp"
    requires = ("daqp",)
    session = DaqpSession
    accuracies = ("primal_tol", "eta_prox")

    primal_tol: float = ACCURACY / 10
    eps_prox: float = -1e-4
    eta_prox: float = ACCURACY / 10
    max_iter: int = 10_000

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.number("eps_prox", self.eps_prox)

    def _stopping_at(self, tolerance: float) -> Self:
        # Its steps end at a vertex: less accuracy would save nothing.
        return replace(
            self, primal_tol=min(self.primal_tol, 0.1 * tolerance), eta_prox=min(self.eta_prox, 0.01 * tolerance)
        )
