"""Clarabel: an interior-point method for conic programs; no warm start, the workspace is kept.

Goulart, Chen: Clarabel: an interior-point solver for conic programs with quadratic objectives, 2024.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc.qp.problem import QP
from wbc.qp.solver import Answer, Solver
from wbc.qp.solvers.kept import KeptSession, OneSided, Pattern, ended
from wbc.tolerances import ACCURACY


@final
class ClarabelSession(KeptSession):
    """A Clarabel solver, made anew when a side becomes finite or infinite, or a zero something else."""

    solver: Clarabel
    _form: OneSided | None

    def _begin(self) -> None:
        self._cost, self._rows, self._form = Pattern(self.shape.n, self.shape.n), Pattern(0, 0), None

    def _write(self, qp: QP) -> bool:
        same_sides = self._form is not None and self._form.fits(qp)
        if self._form is None or not same_sides:
            self._form = OneSided(qp)
            self._rows = Pattern(len(self._form.item), qp.n)
        H, G = np.triu(qp.H), self._form.matrix(qp)
        self._data = (H, qp.g, G, self._form.right_side(qp))
        same_cost, same_rows = self._cost.covers(H), self._rows.covers(G)
        return same_sides and same_cost and same_rows

    def _make(self, qp: QP) -> Any:
        import clarabel

        assert self._form is not None
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
        settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = self.solver.tol
        settings.max_iter = self.solver.max_iter
        H, g, G, h = self._data
        n_equal = self._form.n_equal
        cones = [clarabel.ZeroConeT(n_equal), clarabel.NonnegativeConeT(len(h) - n_equal)]
        return clarabel.DefaultSolver(self._cost.sparse(H), g, self._rows.sparse(G), h, cones, settings)

    def _update(self, qp: QP, workspace: Any) -> None:
        H, g, G, h = self._data
        workspace.update(P=self._cost.entries(H), q=g, A=self._rows.entries(G), b=h)

    def _run(self, qp: QP, workspace: Any) -> Answer:
        assert self._form is not None
        result = workspace.solve()
        y, z, z_box = self._form.multipliers(np.array(result.z))
        return Answer(ended(str(result.status)), np.array(result.x), y, z, z_box, int(result.iterations))


@final
@dataclass(frozen=True)
class Clarabel(Solver):
    """Settings of Clarabel.

    Args:
        tol: feasibility and gap at which it stops, absolute and relative.
        max_iter: iterations before it gives up.

    Raises:
        InvalidInput: a setting out of its range.
    """

    name = "clarabel"
    requires = ("clarabel",)
    session = ClarabelSession
    accuracies = ("tol",)

    tol: float = ACCURACY
    max_iter: int = 200
