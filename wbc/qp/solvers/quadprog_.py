"""quadprog: the dual active-set method of Goldfarb and Idnani. GPL: used where it is installed and named.

Goldfarb, Idnani: A numerically stable dual method for solving strictly convex quadratic programs, Mathematical
Programming 27, 1983.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import final

import numpy as np

from wbc.qp.problem import QP
from wbc.qp.solver import Answer, Session, Solver
from wbc.qp.solvers.kept import OneSided
from wbc.types import Status


@final
class QuadprogSession(Session):
    """Nothing is kept but the list of finite sides."""

    _form: OneSided | None = None

    def _solve(self, qp: QP) -> Answer:
        import quadprog

        start = perf_counter()
        if self._form is None or not self._form.fits(qp):
            self._form = OneSided(qp)
        form = self._form
        # Without any row it takes none; with an empty matrix it looks for the first.
        rows = (-form.matrix(qp).T, -form.right_side(qp), form.n_equal) if len(form.item) else ()
        build_time = perf_counter() - start
        try:
            x, _, _, iterations, dual, _ = quadprog.solve_qp(qp.H, -qp.g, *rows)
        except ValueError as cause:
            status = Status.INFEASIBLE if "inconsistent" in str(cause) else Status.FAILED
            return Answer.none(qp.shape, status)
        dual = dual if rows else np.empty(0)
        return Answer(Status.SOLVED, x, *form.multipliers(np.array(dual)), int(iterations[0]), build_time)


@final
@dataclass(frozen=True)
class Quadprog(Solver):
    """quadprog has no settings and keeps nothing; it needs a positive definite H."""

    name = "quadprog"
    requires = ("quadprog",)
    semidefinite = False
    session = QuadprogSession
