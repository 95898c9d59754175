"""Steps from a point of a QP towards its optimum, each of them one problem of the core.

With x = at + T z, the step of least cost from a point ``at`` is

    minimise ½ zᵀ D z + (Tᵀ ∇)ᵀ z     subject to     lower − R at ≤ R T z ≤ upper − R at,     ∇ = H at + g

where R are all rows, bounds included. A Cholesky factorisation with pivots splits the variables into curved and flat
ones, H = L [L₁ᵀ L₂ᵀ], and T makes the cost diagonal:

    T = [ L₁⁻ᵀ  −L₁⁻ᵀ L₂ᵀ ]        D = 1 on the curved ones,
        [  0        1     ]        D = μ κ on the flat ones: a proximal term, whose centre is where the step begins.

κ is the curvature that ends the steepest slope along a flat variable after one unit of x. It is at most the curvature
that the variable has alone, 1, or the largest of any variable where it has none. All these are proportional to the
cost, so that the steps do not depend on its unit.

Where nothing is flat, one step is the optimum, and another refines it. Elsewhere steps are the proximal point method,
which ends after finitely many; each is ten times as long as the one before, as far as the rows let it.

Rockafellar: Monotone operators and the proximal point algorithm, SIAM J. Control and Optimization 14(5), 1976.
"""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpstrf

from wbc.qp.answer import Answer
from wbc.qp.certificate import FLAT, rounded_once
from wbc.qp.problem import QP, Row, Shape
from wbc.qp.rows.core import CoreSolver
from wbc.qp.rows.problem import RowProblem
from wbc.types import Mat, Vec

#: The first μ, and what the next one is of it.
_PROXIMAL, _LONGER = 1e-5, 0.1
#: A variable with less of the largest curvature has none: its unit would be out of all proportion.
_NO_CURVATURE = 1e-22


@final
class DenseSteps:
    """Memory of ``core`` for QPs of one shape, and the working set of the last step.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.qp.rows.dense import DenseSteps
        >>> qp = wbc.QP([[1.0]], [-3.0], ub=[2.0])
        >>> steps = DenseSteps(qp.shape)
        >>> steps.read(qp)
        >>> steps.step(qp, np.zeros(1)).x
        array([2.])
    """

    def __init__(self, shape: Shape) -> None:
        n, n_eq, n_in = shape
        names = [Row("z")] * (n_in + n + n_eq + n)
        self._problem = RowProblem(0, n, n_range=n_in + n, n_soft=0, n_equal=n_eq, rows=names, regularisation=0.0)
        self.core = CoreSolver(self._problem)
        self._identity, self._curved = np.eye(n), n

    def read(self, qp: QP) -> None:
        """Factor H, in units that give it a diagonal of one, and write all rows, in units of at most their length."""
        n, n_eq, n_in = qp.shape
        p, diagonal = self._problem, qp.H.diagonal()
        unit = 1.0 / np.sqrt(np.where(diagonal > _NO_CURVATURE * diagonal.max(), diagonal, 1.0))
        factor, pivots, rank, _ = dpstrf(qp.H * np.multiply.outer(unit, unit), tol=n * FLAT, lower=1)
        rows = np.concatenate([qp.matrix[n_eq:], self._identity, qp.matrix[:n_eq]])
        rows *= unit
        columns = rows.take(pivots - 1, 1).T  # in the order that LAPACK wants
        if rank == n:
            columns = dtrsm(1.0, factor, columns, lower=1, overwrite_b=1)
        elif rank:
            columns[:rank] = dtrsm(1.0, factor[:rank, :rank], columns[:rank], lower=1)
            # What is rounding of H, or left by cancelling, is zero: else it would be a slope, or move a row.
            below, flat = factor[rank:, :rank], columns[rank:]
            below[np.abs(below) * factor.diagonal()[:rank] <= n * FLAT] = 0.0
            made_of = np.abs(flat) + np.abs(below).dot(np.abs(columns[:rank]))
            flat -= below.dot(columns[:rank])
            flat[np.abs(flat) <= n * FLAT * made_of] = 0.0
        rows = columns.T
        self._T = rows[n_in : n_in + n]
        if rank < n:
            bent = diagonal[pivots[rank:] - 1] > _NO_CURVATURE * diagonal.max()
            rows[:, rank:] /= np.sqrt(_curvature(self._T[:, rank:], qp.g, bent, diagonal.max()))
        self._size = np.abs(qp.g.dot(self._T)).max() or np.float64(1.0)  # of z; its square may overflow
        rows *= self._size
        length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
        self._share = 1.0 / np.where(length > 0.0, np.minimum(length, 1.0), 1.0)
        np.multiply(rows, self._share[:, None], out=p.G[:, :n])
        if rank < n or self._curved < n:
            p.metric[:rank] = 1.0
        self._curved, self._proximal = int(rank), _PROXIMAL
        self._has_cost = bool(rank or qp.g.any())

    def step(self, qp: QP, at: Vec) -> Answer:
        """The answer one step from ``at`` (n,)."""
        n, n_eq, n_in = qp.shape
        p, m, cost = self._problem, n_in + n, self._size**2
        gradient = rounded_once(qp.H, at, qp.g) if at.any() else qp.g  # near an optimum its terms cancel
        p.centre[:] = gradient.dot(self._T)
        if self.has_flat:
            p.metric[self._curved :] = self._proximal
            self._proximal *= _LONGER
            p.centre /= p.metric
        p.centre /= -cost
        values = np.concatenate([qp.matrix.dot(at), at])
        for side, own in zip(p.range_bounds(), qp.sides, strict=True):
            np.subtract(own[n_eq:], values[n_eq:], out=side)
            side *= self._share[:m]
        np.multiply(values[:n_eq] - qp.upper[:n_eq], self._share[m:], out=p.G[m:, n])
        status = self.core.solve()
        force = cost * self._share * self.core.push
        box = force[n_in:m]
        x = np.clip(at + self._T.dot(p.x), qp.lb, qp.ub)
        x = np.where(box > 0.0, qp.ub, np.where(box < 0.0, qp.lb, x))
        force *= self._has_cost  # where there is none, every point of the set is an optimum, and nothing pushes
        return Answer(status, x, force[m:], force[:n_in], box, self.core.iterations)

    def name(self, qp: QP, answer: Answer) -> None:
        """Guess as held what ``answer`` pushes on by more than the room left; no more than can be independent."""
        n, n_eq, n_in = qp.shape
        values, share = np.concatenate([qp.matrix[n_eq:].dot(answer.x), answer.x]), self._share[: n_in + n]
        force = np.concatenate([answer.z, answer.z_box])
        lower, upper = qp.sides[:, n_eq:]
        room = np.where(force > 0.0, upper - values, values - lower) * share
        push = np.abs(force) / (self._size**2 * share)
        held = np.flatnonzero((force != 0.0) & (push >= room))
        held = held[np.argsort(-push[held], kind="stable")[: max(n - n_eq, 0)]]
        self.core.guess(self.core.places[n + held], np.sign(force[held]))

    @property
    def has_flat(self) -> bool:
        """Whether the cost is flat along some variable."""
        return self._curved < len(self._identity)


def _curvature(flat: Mat, g: Vec, bent: NDArray[np.bool_], largest: float) -> Vec:
    """κ of the flat variables (k,), from their columns of T (n, k); ``bent`` (k,) says which have an entry in H."""
    slope, terms = np.abs(g.dot(flat)), np.abs(g).dot(np.abs(flat))
    slope[slope <= len(g) * FLAT * terms] = 0.0  # rounding
    length = np.abs(flat).max(axis=0)
    steepest = (slope / length).max() or (np.inf if largest else 1.0)
    alone = np.where(bent, 1.0, (largest or np.inf) * length**2)
    return np.asarray(np.minimum(steepest * length**2, alone))
