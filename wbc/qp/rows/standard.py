"""The standard form: products are made, and any QP solver answers."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.errors import InvalidProblem
from wbc.qp.certificate import TOLERANCE, Certificate
from wbc.qp.rows.core import CoreSolver
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.solver import RowSolver
from wbc.qp.solver import Answer, Solution, Solver
from wbc.types import Index, Status, Vec


@final
class StandardSolver(RowSolver):
    """Writes the rows out as a :class:`~wbc.qp.problem.QP` and hands it to a session of ``solver``.

    Its answer is certified from the rows.
    """

    form = "standard"

    def __init__(self, problem: RowProblem, solver: Solver) -> None:
        super().__init__(problem)
        self.qp = problem.empty_qp()
        self.session = solver.open(self.qp.shape)
        self.solution: Solution | Answer = Answer.none(self.qp.shape, Status.FAILED)
        self._judge, self._push = CoreSolver(problem), np.zeros(problem.n_rows)
        self.counts = self.session.counts  # a session that guesses counts; for others they stay zero

    def solve(self) -> Status:
        self.problem.write_qp(self.qp)
        try:
            solution = self.session.solve(self.qp)
        except InvalidProblem:  # NaN or crossed bounds reached the rows: the controller falls back
            self.solution, self.certificate = Answer.none(self.qp.shape, Status.FAILED), Certificate.none()
            return Status.FAILED
        self.solution = solution
        self.certificate, self.iterations = solution.certificate, solution.iterations
        if not np.isfinite(solution.x).all():
            return solution.status
        self._take(solution)
        if self.certificate.ok:
            return Status.SOLVED
        return Status.INACCURATE if solution.status.ok else solution.status

    def _take(self, solution: Solution) -> None:
        """Write the answer where the problem keeps it, and certify it there."""
        p, push = self.problem, self._push
        np.divide(solution.x, p.scale, out=p.x)
        # A thousandth of a millionth in a velocity is a millionth in the acceleration of a tick.
        np.clip(p.x, p.lb, p.ub, out=p.x)
        value = p.value[p.first_row : p.first_row + p.n_rows]
        np.dot(p.G[: p.n_rows], p.x1, out=value)
        push[p.range] = solution.z / p.unit
        push[p.equal] = solution.y[p.n_u :] / p.unit
        np.multiply(p.weights / p.unit, value[p.soft], out=push[p.soft])
        self.certificate = self._judge.certify(push)
        if not self.certificate.ok and p.n_soft and np.isfinite(self.certificate.distance):
            self.certificate = self._judge.certify(self._judge.sharpened())

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
