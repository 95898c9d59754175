"""The standard form: products are made, and any QP solver answers."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.errors import InvalidProblem
from wbc.qp.certificate import Certificate
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.solver import RowSolver
from wbc.qp.solver import Solution, Solver
from wbc.types import Index, Status, Vec


@final
class StandardSolver(RowSolver):
    """Writes the rows out as a :class:`~wbc.qp.problem.QP` and hands it to a session of ``solver``."""

    form = "standard"

    def __init__(self, problem: RowProblem, solver: Solver) -> None:
        super().__init__(problem)
        self.solver = solver
        self.qp = problem.empty_qp()
        self.session = solver.open(self.qp.shape)
        self.solution: Solution | None = None
        self.counts = self.session.counts  # a session that guesses counts; for others they stay zero

    def solve(self) -> Status:
        p = self.problem
        p.write_qp(self.qp)
        self.solution = None
        try:
            solution = self.session.solve(self.qp)
        except InvalidProblem:  # NaN or crossed bounds reached the rows: the controller falls back
            self.certificate = Certificate(np.inf, np.inf, np.inf)
            return Status.FAILED
        self.solution = solution
        self.certificate, self.iterations = solution.certificate, solution.iterations
        if solution.status.ok:
            np.divide(solution.x, p.scale, out=p.x)
            # A thousandth of a millionth in a velocity is a millionth in the acceleration of a tick.
            np.clip(p.x, p.lb, p.ub, out=p.x)
            np.dot(p.G[: p.n_rows], p.x1, out=p.value[p.first_row : p.first_row + p.n_rows])
        return solution.status

    def reset(self) -> None:
        self.session.reset()

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        if self.solution is None:
            n, n_eq, n_in = self.qp.shape
            return np.full(n_eq, np.nan), np.full(n_in, np.nan), np.full(n, np.nan)
        return self.solution.y, self.solution.z, self.solution.z_box

    def active(self, threshold: float = 1e-9) -> tuple[Index, Vec]:
        """Items whose multiplier is not zero, and the side they push on."""
        _, z, z_box = self.multipliers()
        pushing = np.concatenate([z_box, z])
        items = np.flatnonzero(np.abs(pushing) > threshold)
        side = np.sign(pushing[items])
        p = self.problem
        return np.where(items < p.n, items, items - p.n + p.item(p.range.start)), side

    @property
    def active_count(self) -> int:
        return len(self.active(1e-7)[0]) if self.solution is not None else 0
