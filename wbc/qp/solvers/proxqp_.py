"""ProxQP: a primal-dual augmented Lagrangian method, warm-started from the last answer.

Bambade, Schramm, El Kazdadi, Caron, Taylor, Carpentier: ProxQP: an efficient and versatile quadratic programming solver
for real-time robotics applications and beyond, 2023.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc.qp.problem import QP
from wbc.qp.solver import Answer, Solver
from wbc.qp.solvers.kept import INFINITY, KeptSession, ended
from wbc.tolerances import ACCURACY


@final
class ProxQpSession(KeptSession):
    """A dense ProxQP object with box constraints."""

    solver: ProxQp

    def _write(self, qp: QP) -> bool:
        m, (low, high) = len(qp.lower), np.clip(qp.sides, -INFINITY, INFINITY)
        A, b = (qp.A, qp.b) if qp.n_eq else (None, None)
        C, cl, cu = (qp.C, low[qp.n_eq : m], high[qp.n_eq : m]) if self.shape.n_in else (None, None, None)
        self._data = (qp.H, qp.g, A, b, C, cl, cu, low[m:], high[m:])
        return True

    def _make(self, qp: QP) -> Any:
        from proxsuite import proxqp

        workspace = proxqp.dense.QP(*self.shape, True)
        settings, eps = workspace.settings, self.solver.eps_abs
        settings.eps_abs, settings.eps_rel, settings.max_iter = eps, 0.0, self.solver.max_iter
        settings.max_iter_in, settings.check_duality_gap = self.solver.max_iter_in, True
        settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = eps, eps
        # At its own 1e-4 it takes one in forty small problems with little room for infeasible.
        settings.eps_primal_inf = settings.eps_dual_inf = 1e-18
        workspace.init(*self._data)
        settings.initial_guess = proxqp.InitialGuess.EQUALITY_CONSTRAINED_INITIAL_GUESS
        return workspace

    def _update(self, qp: QP, workspace: Any) -> None:
        from proxsuite import proxqp

        workspace.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        workspace.update(*self._data)

    def _run(self, qp: QP, workspace: Any) -> Answer:
        workspace.solve()
        results, n_in = workspace.results, self.shape.n_in
        status, x, y, z = ended(results.info.status.name), *map(np.array, (results.x, results.y, results.z))
        return Answer(status, x, y, z[:n_in], z[n_in:], int(results.info.iter))


@final
@dataclass(frozen=True)
class ProxQp(Solver):
    """Settings of ProxQP. Its own defaults (1e-5) are too coarse for torques.

    Args:
        eps_abs: residuals at which it stops.
        max_iter: outer iterations before it gives up.
        max_iter_in: inner iterations in each of these. At its own 1500 it may take half a minute to give up.

    Raises:
        InvalidInput: a setting out of its range.

    Example:
        >>> from wbc.qp import QP
        >>> ProxQp().solve(QP([[1.0]], [-3.0], ub=[2.0])).status.name
        'SOLVED'
    """

    name = "proxqp"
    requires = ("proxsuite",)
    repeatable = False  # its sums depend on where its memory lies
    session = ProxQpSession
    accuracies = ("eps_abs",)

    eps_abs: float = ACCURACY
    max_iter: int = 100
    max_iter_in: int = 50
