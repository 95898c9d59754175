"""A QP given by its rows: the form in which a stack of tasks arrives, before any product is made.

Unknowns x = [u | y], and a trailing 1 so that every affine map is one row times x̂ = [u | y | 1]:

    minimise   ½ (y − c)ᵀ D (y − c) + ½ Σ wᵢ (Sᵢ x̂)²        D diagonal, c the centre
    subject to B x̂ = 0          n_u rows, B_u symmetric positive definite: they determine u (the base's dynamics)
               lower ≤ R x̂ ≤ upper
               L x̂ = 0          equalities
               lb ≤ y ≤ ub

All rows live in one C-ordered array G = [B; R; S; L], so that one product G x̂ gives torques, residuals
and margins. One vector of *items* [x | 1 | rows] holds every value that has a bound, and one comparison checks all.

Forces are stored scaled, f = scale · f̃, so that their metric equals the joints' and D is uniform where it can be;
``scale`` is 1 on everything else.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np

from wbc.qp.problem import QP, Objective, Row, Shape
from wbc.qp.rows.row_task import RowTask
from wbc.types import Mat, Vec


@final
class RowProblem:
    """Memory of one row problem. Sizes are fixed; whoever owns it writes rows, bounds, weights and centre."""

    def __init__(
        self, n_u: int, n_y: int, *, n_range: int, n_soft: int, n_equal: int, rows: list[Row], regularisation: float
    ) -> None:
        self.n_u, self.n_y, self.n = n_u, n_y, n_u + n_y
        self.n_range, self.n_soft, self.n_equal = n_range, n_soft, n_equal
        self.n_rows = n_u + n_range + n_soft + n_equal
        #: Names of [B; R; S; L], then of the variables.
        self.rows = rows
        self.regularisation = regularisation
        n, m = self.n, self.n_rows

        self.G = np.zeros((m, n + 1))
        self.base = slice(0, n_u)
        self.range = slice(n_u, n_u + n_range)
        self.soft = slice(n_u + n_range, n_u + n_range + n_soft)
        self.equal = slice(n_u + n_range + n_soft, m)

        # Items: the unknowns, the constant 1, the rows.
        self.first_row = n + 1
        items = n + 1 + m
        self.value = np.zeros(items)
        self.value[n] = 1.0
        #: Lower bounds in the first row, upper bounds in the second.
        self.bounds = np.full((2, items), -np.inf)
        self.lower, self.upper = self.bounds
        self.upper.fill(np.inf)
        for fixed in (self.base, self.soft, self.equal):
            self.lower[n + 1 + fixed.start : n + 1 + fixed.stop] = 0.0
            self.upper[n + 1 + fixed.start : n + 1 + fixed.stop] = 0.0
        self.x = self.value[:n]
        self.x1 = self.value[: n + 1]

        self.metric = np.ones(n_y)  #: D, in units of ``unit``: the cost is divided by it
        self.centre = np.zeros(n_y)
        self.weights = np.ones(n_soft)
        #: The unit of the cost (1,), for compiled code.
        self.units = np.ones(1)
        self.scale = np.ones(n)
        #: What the soft rows, the metric and the centre are made of, level by level; set by whoever writes them.
        self.levels: Sequence[Sequence[RowTask]] = ()

    @property
    def unit(self) -> float:
        """What the cost is divided by."""
        return self.units.item()

    @unit.setter
    def unit(self, value: float) -> None:
        self.units[0] = value

    @property
    def tasks(self) -> list[RowTask]:
        """The tasks of all levels."""
        return [task for level in self.levels for task in level]

    # ---- named parts of the items
    def item(self, row: int) -> int:
        """Position of a row of G among the items."""
        return self.first_row + row

    @cached_property
    def items(self) -> dict[Row, int]:
        """Position of each unknown and of each range row among the items, by its name."""
        unknowns = {row: i for i, row in enumerate(self.rows[self.n_rows :])}
        return unknowns | {self.rows[i]: self.item(i) for i in range(self.range.start, self.range.stop)}

    @property
    def lb(self) -> Vec:
        """Lower bounds of the unknowns (n,), a view."""
        return self.lower[: self.n]

    @property
    def ub(self) -> Vec:
        """Upper bounds of the unknowns (n,), a view."""
        return self.upper[: self.n]

    def range_bounds(self) -> tuple[Vec, Vec]:
        """Lower and upper sides of the range rows, views."""
        first, last = self.item(self.range.start), self.item(self.range.stop)
        return self.lower[first:last], self.upper[first:last]

    # ---- the same problem in standard form
    @property
    def qp_shape(self) -> Shape:
        """Shape of the standard form: u and y are variables, B and L equalities."""
        return Shape(self.n, self.n_u + self.n_equal, self.n_range)

    def empty_qp(self) -> QP:
        """Memory for :meth:`write_qp`."""
        order = [*range(self.n_u), *range(self.equal.start, self.equal.stop), *range(self.range.start, self.range.stop)]
        names = [self.rows[i] for i in order] + self.rows[self.n_rows :]
        return QP.empty(self.qp_shape, names)

    def write_qp(self, qp: QP) -> None:
        """Write the standard form, in physical units: forces unscaled, cost not divided. Its tasks are the tasks."""
        n, n_u = self.n, self.n_u
        unscale = 1.0 / self.scale
        rows, right = self.G[: self.n_rows, :n] * unscale, self.G[: self.n_rows, n]
        soft = rows[self.soft]
        weighted = soft * self.weights[:, None]
        with np.errstate(over="ignore", invalid="ignore"):  # what is huge or not finite, QP.check refuses
            np.matmul(soft.T, weighted, out=qp.H)
            np.matmul(right[self.soft], weighted, out=qp.g)
        diagonal = np.empty(n)
        diagonal[:n_u] = self.regularisation
        diagonal[n_u:] = self.unit * self.metric * unscale[n_u:] ** 2
        qp.H.flat[:: n + 1] += diagonal
        qp.g[n_u:] -= diagonal[n_u:] * self.centre * self.scale[n_u:]
        qp.H[:] = 0.5 * (qp.H + qp.H.T)
        equal = qp.matrix[: qp.n_eq]
        equal[:n_u], equal[n_u:] = rows[self.base], rows[self.equal]
        qp.lower[:n_u] = qp.upper[:n_u] = -right[self.base]
        qp.lower[n_u : qp.n_eq] = qp.upper[n_u : qp.n_eq] = -right[self.equal]
        qp.matrix[qp.n_eq :] = rows[self.range]
        low, high = self.range_bounds()
        np.subtract(low, right[self.range], out=qp.lower[qp.n_eq :])
        np.subtract(high, right[self.range], out=qp.upper[qp.n_eq :])
        np.multiply(self.lb, self.scale, out=qp.lb)
        np.multiply(self.ub, self.scale, out=qp.ub)
        qp.name_tasks(self._tasks(rows, right, unscale))

    def _tasks(self, rows: Mat, right: Vec, unscale: Vec) -> list[Objective]:
        """What counts in the cost, in physical units: the tasks, or all soft rows where nobody named them."""
        whole = [RowTask("rows", self.soft, None, self.weights, self.weights, self.weights)] if self.n_soft else []
        found = []
        for task in self.tasks or whole:
            counts = np.flatnonzero(task.weights)
            if task.rows is not None:
                own = counts + task.rows.start
                found.append(Objective(task.name, rows[own], -right[own], self.unit_of(task)))
            elif task.unknowns is not None:
                own = counts + task.unknowns.start
                target = self.centre[own - self.n_u] * self.scale[own]
                found.append(Objective(task.name, np.eye(self.n)[own], target, self.unit_of(task)))
        return found

    def units_of(self, task: RowTask) -> list[str]:
        """The unit of each of a task's rows."""
        at, rows = (task.rows, self.rows) if task.rows else (task.unknowns, self.rows[self.n_rows :])
        assert at is not None, "it is about rows or unknowns"
        return [row.unit for row in rows[at]]

    def unit_of(self, task: RowTask) -> str:
        """The unit of a task's rows, as in ``"m/s²"``; more than one are listed."""
        return ", ".join(dict.fromkeys(self.units_of(task)))
