"""Presolve: another problem with the same answer, and the way back."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.qp.problem import QP
from wbc.qp.solver import Answer
from wbc.types import Vec


@final
class Equilibrated:
    """The same problem in units of its own: unit diagonal of H, rows of unit length.

    With x = D x̃, a cost in units of s and rows in units of 1/R,

        H̃ = D H D / s,   g̃ = D g / s,   C̃ = R C D,   and back:   z = s R z̃,   z_box = s D⁻¹ z̃_box.

    Some solvers take a row for zero, or a pivot for singular, because its unit makes it small.

    Example:
        >>> from wbc.qp import QP
        >>> print(Equilibrated(QP([[1e6]], [2e6], A=[[1e-4]], b=[1e-4])).qp.matrix)
        [[1.]]
    """

    def __init__(self, qp: QP) -> None:
        curvature = qp.H.diagonal()
        self.variables = 1.0 / np.sqrt(np.where(curvature > 0.0, curvature, 1.0))
        rows = qp.matrix * self.variables
        length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
        self.rows = 1.0 / np.where(length > 0.0, length, 1.0)
        g = qp.g * self.variables
        self.cost = float(np.abs(g).max(initial=0.0)) or 1.0
        self.n_eq = qp.n_eq
        self.qp = QP.empty(qp.shape, qp.rows)
        self.qp.H[:] = qp.H * np.outer(self.variables, self.variables) / self.cost
        self.qp.g[:] = g / self.cost
        self.qp.matrix[:] = rows * self.rows[:, None]
        self.qp.lower[:], self.qp.upper[:] = qp.lower * self.rows, qp.upper * self.rows
        self.qp.lb[:], self.qp.ub[:] = qp.lb / self.variables, qp.ub / self.variables

    def undo(self, answer: Answer) -> Answer:
        """The answer to the original problem."""
        force: Vec = self.cost * self.rows
        return Answer(
            answer.status,
            self.variables * answer.x,
            force[: self.n_eq] * answer.y,
            force[self.n_eq :] * answer.z,
            self.cost / self.variables * answer.z_box,
            answer.iterations,
            answer.build_time,
        )
