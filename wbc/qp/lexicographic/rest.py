"""What is left free below a stage that was not met: a smaller space, in which everything above holds by construction.

Once a stage is least but not zero, the rows that hold depend on one another: what held it back, the laws and its own
rows. Equations of that kind are as thin as rounding. So they are not kept as equations: with Ẽ = √D⁻¹ E their columns,
a basis Q of the complement of their span (QR with pivoting) gives all points that keep them,

    y = y* + √D⁻¹ Q z ,      ½ (y − c)ᵀ D (y − c) = ½ ‖z − z_c‖² + const ,   z_c = Qᵀ √D (c − y*)

Laws, stages that were met and what pushed are taken out first; of the stage itself only what is then still free. The
stages below are QPs in z with nothing but inequalities, and each of them narrows the space further.
"""

from __future__ import annotations

from typing import final

import numpy as np
from scipy.linalg.lapack import dgeqp3, dormqr

from wbc.qp.lexicographic.asked import Answer, Box, Rows, Wished, ask_daqp
from wbc.qp.lexicographic.exact import least_squares_within
from wbc.qp.lexicographic.stages import MET
from wbc.qp.problem import QP
from wbc.qp.rows import RowProblem
from wbc.types import Index, Mat, Status, Vec

#: Lengths, of columns of unit length, that count as nothing: beside rows that must hold, and beside a stage's own.
_DEPENDENT, _OWN = 1e-10, 1e-6
#: Multipliers above this share of the largest push.
_PUSHES = 1e-8


@final
class Rest:
    """The space that is left. ``rows`` (n_y, m) are the gradients of the bounded rows, those of the bounds on y behind.

    ``values``, ``low`` and ``high`` (m,) say where they are and what they may be; ``root`` (n_y,) is √D⁻¹.
    """

    def __init__(self, rows: Mat, low: Vec, high: Vec, root: Vec) -> None:
        self._rows = np.concatenate([rows * root[:, None], np.diag(root)], axis=1)
        self._low, self._high, self._root = low, high, root
        self.basis: Mat = np.eye(len(root))
        self.y = self.values = np.zeros(0)
        #: Rows and bounds that held a stage back, and stay.
        self.kept: Index = np.zeros(0, np.intp)
        #: What each row and bound pushed with in the last answer, positive down from an upper side.
        self.forces = np.zeros(len(low))

    def stay(self, y: Vec, values: Vec) -> None:
        """From here on the space begins at y, where the bounded rows and bounds have these values."""
        self.y, self.values = y.copy(), values.copy()

    def narrow(self, holds: Mat, pushing: Index, own: Mat, *, met: bool) -> None:
        """Keep to what holds, to what pushed and to a stage's ``own`` rows: gradients (n_y, ·) each."""
        self.kept = np.union1d(self.kept, pushing)
        firm = np.concatenate([holds * self._root[:, None], self._rows[:, pushing]], axis=1)
        mine = own * self._root[:, None]
        if met:
            firm = np.concatenate([firm, mine], axis=1)
        self.basis = _complement(self.basis, firm, _DEPENDENT)
        if not met:
            self.basis = _complement(self.basis, mine, _OWN)
        self._free = self.basis.T @ self._rows

    def minimise(self, own: Mat, at: Vec, give: Vec, centre: Vec, *, steps: int, precision: float) -> Answer:
        """½ ‖z − z_c‖² + ½ Σ rᵢ²/giveᵢ with r = ownᵀ (y − y*) + at; every step after the first from where it ended."""
        low, high = self._room()
        d = self.basis.shape[1]
        nothing, free = np.zeros(0), np.full(d, np.inf)
        self.forces = np.zeros(len(low))
        if not d:
            return Answer(Status.SOLVED, self.y, nothing, nothing, 0)
        wish = Wished((self.basis.T @ (own * self._root[:, None])).T, at, give)
        rows = Rows(self._free.T, np.zeros(len(low)), low, high, 0)
        z, iterations = self.basis.T @ ((centre - self.y) / self._root), 0
        for _ in range(steps):
            asked = ask_daqp(wish, rows, Box(-free, free, np.ones(d), z))
            iterations += asked.iterations
            if not asked.status.ok:
                return asked._replace(iterations=iterations)
            moved, left = wish.A @ (asked.y - z), wish.A @ asked.y + at
            z = asked.y
            if np.abs(moved).max(initial=0.0) <= precision * (MET + np.abs(left).max(initial=0.0)):
                break
        self.forces = asked.rows
        return Answer(Status.SOLVED, self.y + self._root * (self.basis @ z), asked.rows, nothing, iterations)

    def least(self, own: Mat, at: Vec, give: Vec) -> Vec:
        """y of the least squares ½ Σ rᵢ²/giveᵢ themselves."""
        low, high = self._room()
        weigh = np.sqrt(1.0 / give)
        W = (self.basis.T @ (own * self._root[:, None])).T * weigh[:, None]
        z, self.forces = least_squares_within(W, at * weigh, self._free.T, low, high)
        y: Vec = self.y + self._root * (self.basis @ z)
        return y

    def _room(self) -> tuple[Vec, Vec]:
        """How far each row and bound may still go, down and up."""
        low, high = np.minimum(self._low - self.values, 0.0), np.maximum(self._high - self.values, 0.0)
        low[self.kept], high[self.kept] = -np.inf, np.inf
        return low, high

    def pushing(self, pull: float) -> Index:
        """Which rows and bounds pushed in the last answer, ``pull`` being the size of what they pushed against."""
        largest = max(pull, float(np.abs(self.forces).max(initial=0.0)))
        return np.flatnonzero(np.abs(self.forces) > _PUSHES * largest)


def multipliers(p: RowProblem, rest: Rest) -> tuple[Vec, Vec, Vec]:
    """y, z and z_box of the last stage: of what is left DAQP's, of what holds those that make it stationary."""
    qp = QP.empty(p.qp_shape)
    p.write_qp(qp)
    force = np.zeros(p.n_range + p.n)
    force[: p.n_range], force[p.n_range + p.n_u :] = np.split(p.unit * rest.forces, [p.n_range])
    force[p.n_range :] /= p.scale
    kept = rest.kept + np.where(rest.kept < p.n_range, 0, p.n_u)
    force[kept] = 0.0
    bounded = np.concatenate([qp.C, np.eye(p.n)])
    pull = qp.H @ (p.x * p.scale) + qp.g + force @ bounded
    columns = np.concatenate([qp.A, bounded[kept]])
    length = np.linalg.norm(columns, axis=1)
    found = np.linalg.lstsq((columns / np.where(length > 0.0, length, 1.0)[:, None]).T, -pull, rcond=1e-12)[0]
    found /= np.where(length > 0.0, length, 1.0)
    force[kept] = found[qp.n_eq :]
    return found[: qp.n_eq], force[: p.n_range], force[p.n_range :]


def _complement(basis: Mat, columns: Mat, tolerance: float) -> Mat:
    """A basis of what is left of the span of ``basis`` (n, d) beside these columns (n, m)."""
    d, m = basis.shape[1], columns.shape[1]
    if not d or not m:
        return basis
    length = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    inside = basis.T @ (columns / np.where(length > 0.0, length, 1.0))
    qr, _, tau, _, _ = dgeqp3(inside)
    rank = int((np.abs(np.diagonal(qr)) > tolerance).sum())
    left = np.zeros((d, d - rank), order="F")
    left[rank:] = np.eye(d - rank)
    if d == rank:
        return basis[:, :0]
    turned, _, _ = dormqr("L", "N", qr[:, : len(tau)], tau, left, 64 * d, overwrite_c=1)
    smaller: Mat = basis @ turned
    return smaller


def is_met(residual: Vec) -> bool:
    """Whether nothing worth speaking of is left."""
    return float(np.abs(residual).max(initial=0.0)) <= MET
