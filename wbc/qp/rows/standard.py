"""The standard form: products are made, and any QP solver answers."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.errors import InvalidProblem
from wbc.qp.certificate import TOLERANCE, Certificate, certificate
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.solver import RowSolver
from wbc.qp.solver import Answer, Solution, Solver
from wbc.types import Index, Status, Vec


@final
class StandardSolver(RowSolver):
    """Writes the rows out as a :class:`~wbc.qp.problem.QP` and hands it to a session of ``solver``."""

    form = "standard"

    def __init__(self, problem: RowProblem, solver: Solver) -> None:
        super().__init__(problem)
        self.qp = problem.empty_qp()
        self.session = solver.open(self.qp.shape)
        self.solution: Solution | Answer = Answer.none(self.qp.shape, Status.FAILED)
        self.counts = self.session.counts  # a session that guesses counts; for others they stay zero

    def solve(self) -> Status:
        p = self.problem
        p.write_qp(self.qp)
        try:
            solution = self.session.solve(self.qp)
        except InvalidProblem:  # NaN or crossed bounds reached the rows: the controller falls back
            self.solution, self.certificate = Answer.none(self.qp.shape, Status.FAILED), Certificate.none()
            return Status.FAILED
        finally:
            self.fault = self.session.fault
        self.solution = solution
        self.certificate, self.iterations = solution.certificate, solution.iterations
        if not np.isfinite(solution.x).all():
            return solution.status
        # A thousandth of a millionth in a velocity is a millionth in the acceleration of a tick.
        x = np.clip(solution.x, self.qp.lb, self.qp.ub)
        if (x != solution.x).any():
            self.certificate = certificate(self.qp, x, solution.y, solution.z, solution.z_box)
        np.divide(x, p.scale, out=p.x)
        np.dot(p.G[: p.n_rows], p.x1, out=p.value[p.first_row : p.first_row + p.n_rows])
        if self.certificate.ok:
            return Status.SOLVED
        return Status.INACCURATE if solution.status.ok else solution.status

    def reset(self) -> None:
        self.session.reset()

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return self.solution.y, self.solution.z, self.solution.z_box

    def working_set(self) -> tuple[Index, Vec]:
        """Items whose multiplier exceeds the distance to the bound that it pushes on, and the side of that."""
        if not self.certificate.primal < TOLERANCE:
            return super().working_set()
        p = self.problem
        force = np.concatenate([self.solution.z_box * p.scale, self.solution.z]) / p.unit
        items = np.concatenate([np.arange(p.n), np.arange(p.item(p.range.start), p.item(p.range.stop))])
        value, side = p.value[items], np.sign(force)
        room = np.where(side > 0.0, p.upper[items] - value, value - p.lower[items])
        held = np.abs(force) > np.maximum(room, 0.0)
        return items[held], side[held]
