"""PIQP: a proximal interior-point method; no warm start, the workspace is kept.

Schwan, Jiang, Kuhn, Jones: PIQP: a proximal interior-point quadratic programming solver, IEEE CDC 2023.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc.qp.problem import QP
from wbc.qp.solver import Answer, Solver
from wbc.qp.solvers.kept import KeptSession, ended
from wbc.tolerances import ACCURACY


@final
class PiqpSession(KeptSession):
    """A dense PIQP object; matrices are handed over in Fortran order, which it needs."""

    solver: Piqp

    def _begin(self) -> None:
        self._bounded = np.zeros(self.shape.n_in, dtype=bool)

    def _write(self, qp: QP) -> bool:
        A, b = (np.asfortranarray(qp.A), qp.b) if qp.n_eq else (None, None)
        # A row without any side is not taken.
        bounded = np.isfinite(qp.cl) | np.isfinite(qp.cu)
        fits = bool((bounded == self._bounded).all())
        self._bounded = bounded
        C, cl, cu = (
            (np.asfortranarray(qp.C[bounded]), qp.cl[bounded], qp.cu[bounded]) if bounded.any() else (None, None, None)
        )
        self._data = (qp.H.T, qp.g, A, b, C, cl, cu, qp.lb, qp.ub)
        return fits

    def _make(self, qp: QP) -> Any:
        import piqp

        workspace = piqp.DenseSolver()
        settings, eps = workspace.settings, self.solver.eps_abs
        settings.eps_abs, settings.eps_rel, settings.max_iter = eps, 0.0, self.solver.max_iter
        settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = eps, eps
        workspace.setup(*self._data)
        return workspace

    def _update(self, qp: QP, workspace: Any) -> None:
        workspace.update(*self._data)

    def _run(self, qp: QP, workspace: Any) -> Answer:
        status, result, z = ended(workspace.solve().name), workspace.result, np.zeros(self.shape.n_in)
        z[self._bounded] = result.z_u - result.z_l
        z_box = np.array(result.z_bu) - result.z_bl
        return Answer(status, np.array(result.x), np.array(result.y), z, z_box, int(result.info.iter))


@final
@dataclass(frozen=True)
class Piqp(Solver):
    """Settings of PIQP.

    Args:
        eps_abs: residuals at which it stops, and the duality gap.
        max_iter: iterations before it gives up.

    Raises:
        InvalidInput: a setting out of its range.
    """

    name = "piqp"
    requires = ("piqp",)
    session = PiqpSession
    accuracies = ("eps_abs",)

    eps_abs: float = ACCURACY
    max_iter: int = 250
