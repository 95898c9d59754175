"""What is left free below rows that hold: a smaller space, in which everything above holds by construction.

Once a stage is least but not zero, the rows that hold depend on one another: what held it back, the laws and its own
rows. Equations of that kind are as thin as rounding. So they are not kept as equations: with Ẽ = √D⁻¹ E their columns,
a basis Q of the complement of their span (QR with pivoting) gives all points that keep them,

    y = y* + √D⁻¹ Q z ,      ½ (y − c)ᵀ D (y − c) = ½ ‖z − z_c‖² + const ,   z_c = Qᵀ √D (c − y*)

Laws, stages that were met and what pushed are taken out first; of a stage itself only what is then still free. From the
first stage that cannot be met, all are least squares in z within nothing but inequalities, and each narrows the space.
"""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np
from scipy.linalg.lapack import dgeqp3, dormqr, dtrtrs

from wbc.qp.lexicographic.asked import Box, Finder, Rows, Wished
from wbc.qp.lexicographic.least import Cost, Held, Within, largest, rank_of
from wbc.qp.lexicographic.stages import MET
from wbc.qp.problem import QP
from wbc.qp.rows import RowProblem
from wbc.types import Index, Mat, Status, Vec

#: The length, of columns of unit length, that counts as nothing beside others: in general, and of the rows of a stage
#: with a residual. Across that those matter in the second order only, and no model is as exact.
_DEPENDENT, _OWN = 1e-10, 1e-7
#: Residuals up to this are too small to say what they are orthogonal to.
_SLIGHT = 1e-3
#: A stage's own rows count from their lengths where its space begins, or from this share of the whole length.
_BARELY = 1e-4
#: ε of a stage above the last, as a share of the steepest row's curvature.
_DELTA = 1e-14
#: Proximal steps: each begins where the last one ended, until ε pulls by less than this beside the stage. Else a row
#: that pushes against ε alone would be taken for one that holds the stage back.
_STEPS, _BIAS = 4, 1e-12
#: The same where the finder is asked for a point to begin with: the next one where it finds none.
_COARSE = 1e-8, 1e-5, 1e-2
#: What such a point may be beyond a bound.
_ENOUGH = 1e-7
_NONE: Index = np.zeros(0, np.intp)


class Asked(NamedTuple):
    """½ Σ (weighᵢ rᵢ)² + ½ ε ‖y − centre‖²_D with r = ownᵀ y + right, own (n_y, m), right and weigh (m,).

    ``last``: ε = 1. Else it is next to nothing, and all r within a hundredth of ``MET`` are as good as least. ``rows``
    and ``side``: what is guessed to be held.
    """

    own: Mat
    right: Vec
    weigh: Vec
    centre: Vec
    last: bool
    rows: Index
    side: Vec


@final
class Rest:
    """The space that is left. ``rows`` (n_y, m) are the gradients of the bounded rows; the bounds on y come behind.

    ``low`` and ``high`` (m + n_y,) say what they may be; ``root`` (n_y,) is √D⁻¹. The finder
    is asked where guesses fail, or before any is made.
    """

    def __init__(
        self, rows: Mat, low: Vec, high: Vec, root: Vec, finder: Finder, *, tolerance: float, tries: int, guesses: bool
    ) -> None:
        self._low, self._high, self.root, self._finder = low, high, root, finder
        self._tolerance, self._tries, self._guesses = tolerance, tries, guesses
        self._rows: Mat = rows * root[:, None]
        self._nothing = _DEPENDENT * np.concatenate([_lengths(self._rows), root])
        self.y = self.values = np.zeros(0)
        #: Rows and bounds that held a stage back, and stay.
        self.kept = _NONE
        #: What is held at a bound in the last answer besides, on which side, and what it pushes with, down from above.
        self.rows, self.side, self.force, self._holds = _NONE, np.zeros(0), np.zeros(0), _NONE
        #: All guesses and iterations, and how often the answer had to be searched for.
        self.iterations = self.fallbacks = 0

    def open(self, firm: Mat, right: Vec, centre: Vec) -> None:
        """Begin at the point nearest to the centre where firmᵀ y + right = 0, and go on only where that holds."""
        #: The gradients of the rows that hold from the start, times ``root``.
        self.firm = scaled = firm * self.root[:, None]
        length = _lengths(scaled)
        self.basis, nearest = complement(scaled / length, -(right + centre @ firm) / length)
        self.y = centre + self.root * nearest
        self._follow()

    def gradients(self, numbers: Index) -> Mat:
        """Gradients (n_y, m) of some rows and bounds, times ``root``."""
        m = self._rows.shape[1]
        columns: Mat = np.zeros((len(self.root), len(numbers)))
        row = numbers < m
        columns[:, row] = self._rows[:, numbers[row]]
        at = numbers[~row] - m
        columns[at, np.flatnonzero(~row)] = self.root[at]
        return columns

    def stay(self, y: Vec, values: Vec) -> None:
        """From here on the space begins at y, where the bounded rows and bounds have these values."""
        self.y, self.values = y.copy(), values

    def narrow(self, own: Mat, residual: Vec) -> None:
        """Keep to what pushed in the last answer, and to a stage's ``own`` rows, gradients (n_y, m).

        In what is left beside the rows that pushed, Σ wᵢ rᵢ ownᵢ = 0: the condition for the least. As an equation this
        combination would be nothing but rounding, so own rows are counted coarsely where there is a residual.
        """
        scaled = own * self.root[:, None]
        mine = self.basis.T @ scaled
        mine /= np.maximum(_lengths(mine), _BARELY * _lengths(scaled))
        missed = largest(residual) > _SLIGHT
        if missed and len(self._holds):
            self.kept = np.concatenate([self.kept, self._holds])  # apart: what is kept has no bounds and never holds
            held = self._free[self._holds].T
            mine = self._keep(held / self._reach[self._holds]).T @ mine
        self._keep(mine, _OWN if missed else _DEPENDENT)
        self._follow()

    def _keep(self, columns: Mat, tolerance: float = _DEPENDENT) -> Mat:
        left, _ = complement(columns, None, tolerance)
        self.basis = self.basis @ left
        return left

    def _follow(self) -> None:
        """The rows in the coordinates z, and which of them nothing moves any more."""
        m = self._rows.shape[1]
        self._free: Mat = np.empty((m + len(self.root), self.basis.shape[1]))
        np.dot(self._rows.T, self.basis, self._free[:m])
        np.multiply(self.basis, self.root[:, None], self._free[m:])
        self._reach = _lengths(self._free.T)
        self._fixed = self._reach <= self._nothing

    def least(self, asked: Asked, *, inside: bool) -> tuple[Status, Vec]:
        """y of the least cost within all rows; ``inside`` says that they hold where the space begins."""
        low, high = self._low - self.values, self._high - self.values
        low[self.kept], high[self.kept] = -np.inf, np.inf
        if inside:
            np.minimum(low, 0.0, out=low)
            np.maximum(high, 0.0, out=high)
        own, right, weigh, centre, last, rows, side = asked
        scaled = own * (self.root[:, None] * weigh)
        free = self.basis.T @ scaled
        square = _squares(free)
        still = square <= _DEPENDENT**2 * _squares(scaled)
        if still.any():
            free[:, still], square[still] = 0.0, 0.0
        steepest = float(square.max(initial=0.0)) or 1.0
        eps, enough = (1.0, -1.0) if last else (_DELTA * steepest, 1e-2 * MET)
        columns = np.empty((len(free), len(weigh) + 1), order="F")
        columns[:, :-1], columns[:, -1] = free, ((centre - self.y) / self.root) @ self.basis
        cost = Cost(columns, (self.y @ own + right) * weigh, eps, float(square.sum()) ** 0.5, enough)
        within = Within(self._free, low, high, length=self._reach, fixed=self._fixed, tolerance=self._tolerance)
        held, status = within.guess(cost, rows, side, tries=self._tries) if self._guesses else None, Status.SOLVED
        if held is None:
            held, status = self._search(within, cost, steepest, inside=inside)
        for _ in range(0 if last or held is None else _STEPS):
            assert held is not None
            missing = columns[:, :-1].T @ held.z + cost.a
            away = cost.eps * float(np.linalg.norm(held.z - columns[:, -1]))
            if away <= _BIAS * cost.size * float(np.linalg.norm(missing)) or largest(missing) <= enough:
                break
            columns[:, -1] = held.z
            nearer = within.guess(cost, held.rows, held.side, tries=self._tries)
            if nearer is None:
                break
            held = nearer
        self.iterations += within.iterations
        if held is None:
            return status, self.y
        self.rows, self.side, self.force, self._holds = held.rows, held.side, held.force, held.holds
        return Status.SOLVED, self.y + self.root * (self.basis @ held.z)

    def _search(self, within: Within, cost: Cost, steepest: float, *, inside: bool) -> tuple[Held | None, Status]:
        """The finder's answer where ε is larger, and the way down from there."""
        self.fallbacks += 1
        m, d = within.A.shape
        free, rows = np.full(d, np.inf), Rows(within.A, np.zeros(m), within.low, within.high, 0)
        status = Status.INACCURATE
        for share in _COARSE:
            wish = Wished(cost.columns[:, :-1].T, cost.a, np.full(len(cost.a), max(cost.eps, share * steepest)))
            found = self._finder.ask(wish, rows, Box(-free, free, np.ones(d), cost.columns[:, -1]))
            self.iterations += found.iterations
            if not found.status.ok:
                status = found.status
            elif within.beyond(found.y) <= _ENOUGH:
                pushing = np.flatnonzero(found.rows)
                side = np.sign(found.rows[pushing])
                held = within.guess(cost, pushing, side, tries=self._tries)
                held = held or within.descend(cost, pushing, side, found.y)
                if held is not None:
                    return held, Status.SOLVED
        return within.descend(cost, _NONE, np.zeros(0), np.zeros(d)) if inside else None, status


def multipliers(p: RowProblem, rest: Rest) -> tuple[Vec, Vec, Vec]:
    """y, z and z_box of the last stage: of what is left those found, of what holds those that make it stationary."""
    qp = QP.empty(p.qp_shape)
    p.write_qp(qp)
    found_force = np.zeros(p.n_range + p.n_y)
    found_force[rest.rows] = p.unit * rest.force
    force = np.zeros(p.n_range + p.n)
    force[: p.n_range], force[p.n_range + p.n_u :] = np.split(found_force, [p.n_range])
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


def _lengths(columns: Mat) -> Vec:
    """Length of each column, and never zero, so that one may divide by it."""
    lengths: Vec = np.maximum(np.sqrt(_squares(columns)), 1e-300)
    return lengths


def _squares(columns: Mat) -> Vec:
    """Squared length of each column."""
    squares: Vec = np.vecdot(columns.T, columns.T)
    return squares


def complement(columns: Mat, right: Vec | None, tolerance: float = _DEPENDENT) -> tuple[Mat, Vec]:
    """An orthonormal basis of what is orthogonal to these columns (n, m); the shortest x with columnsᵀ x = right."""
    n, m = columns.shape
    if not n or not m:
        return np.eye(n), np.zeros(n)
    qr, order, tau, _, _ = dgeqp3(columns)
    rank = rank_of(qr, tolerance)
    turned = np.zeros((n, 1 + n - rank), order="F")
    if rank and right is not None:
        turned[:rank, 0] = dtrtrs(qr[:rank, :rank], right[order[:rank] - 1], trans=1)[0]
    turned.reshape(-1, order="F")[n + rank :: n + 1] = 1.0
    turned, _, _ = dormqr("L", "N", qr[:, : len(tau)], tau, turned, 64 * n, overwrite_c=1)
    return turned[:, 1:], turned[:, 0]
