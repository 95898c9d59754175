"""Conflict: which rows of an infeasible QP cannot hold together, and how much each must give.

Two steps, always by the same linear algebra, whichever solver found that there is no answer:

    elastic      minimise ½ ‖s‖²  subject to  lower ≤ R x − s ≤ upper,  the rows R scaled to norm 1
    filtering    leave one row after the other out, in a fixed order, for as long as the rest cannot be met

At the minimum of the first, Rᵀs = 0 and Σ sᵢ(Rᵢ x − bᵢ) = ‖s‖² > 0: s is Farkas's proof that the rows with sᵢ ≠ 0,
and they alone, contradict each other, which leaves few to be filtered. Of an irreducible set the proof is unique but
for its length, so that it also says how far each row must be moved if the others stay: by ‖s‖² / sᵢ.

The order in which rows are left out is equalities before contacts before limits, then row order, so that of
several conflicts one about the limits of the robot is told rather than one between tasks.

Farkas, Theorie der einfachen Ungleichungen, 1902. Chinneck, Dravnieks: Locating minimal infeasible constraint sets in
linear programs, ORSA Journal on Computing 3(2), 1991. Mangasarian: A finite Newton method for classification,
Optimization Methods and Software 17(5), 2002 (Newton's method on squared violations).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq, qr

from wbc.qp.problem import QP, Row
from wbc.tolerances import NOISE, ROUNDING, SAME, SHARP
from wbc.types import Index, Mat, Vec

#: Owners of rows that nothing can loosen: the laws of motion.
PHYSICS = frozenset({"base dynamics"})
#: How the owners of a contact's rows begin.
_CONTACTS = ("contact[", "friction[", "force[")

_STEPS = 200
#: Of longer conflicts a sentence tells this many rows.
_TOLD = 6


class Violation(NamedTuple):
    """A row, or a bound of a variable, and the slack that it needs: positive beyond its upper side."""

    row: Row
    amount: float

    @property
    def way(self) -> str:
        """How far, and to which side."""
        return f"{abs(self.amount):.3g} {self.row.unit}".rstrip() + (" higher" if self.amount > 0 else " lower")

    def __str__(self) -> str:
        return f"{self.row} {self.way}"


@final
@dataclass(frozen=True)
class Conflict:
    """Rows that cannot hold together, irreducible: without any one of them the others can.

    ``gives`` says of each how far it would have to move if the others stay, in its unit, positive beyond its upper
    side; ``items`` where each stands in ``qp.rows``. Its text is one sentence.
    """

    gives: tuple[Violation, ...]
    items: tuple[int, ...]

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows in conflict."""
        return tuple(give.row for give in self.gives)

    def renamed(self, rows: Sequence[Row]) -> Conflict:
        """The same conflict, its rows called otherwise."""
        gives = tuple(Violation(row, give.amount) for row, give in zip(rows, self.gives, strict=True))
        return Conflict(gives, self.items)

    def __str__(self) -> str:
        first, *others = (str(row) for row in self.rows)
        if not others:
            return f"{first} cannot be met at all: it would have to be {self.gives[0].way}"
        told = self.gives
        if len(told) > _TOLD:
            others = [*others[: _TOLD - 1], f"{len(told) - _TOLD} more"]
            told = tuple(sorted(told, key=lambda give: abs(give.amount))[:_TOLD])
        against = " and ".join(filter(None, [", ".join(others[:-1]), others[-1]]))
        return f"{first} against {against}: enough would be {'; or '.join(str(give) for give in told)}"


def conflict(qp: QP, *, held: frozenset[str] = PHYSICS) -> Conflict | None:
    """An irreducible set of rows and bounds that cannot hold together; None where all can (to 1e-8).

    Rows whose owner is in ``held`` are laws of nature: they hold, and are not named. The same QP gives the same
    answer, bit for bit.

    Raises:
        InvalidProblem: as :meth:`QP.check`.

    Example:
        >>> import wbc
        >>> from wbc.qp.conflict import conflict
        >>> rows = [("floor", "z", "m"), ("ceiling", "z", "m"), ("wall", "x", "m")]
        >>> qp = wbc.QP([[1.0]], [0.0], C=[[1.0], [1.0], [1.0]], cl=[1.0, -9.0, 0.0], cu=[9.0, -1.0, 9.0], rows=rows)
        >>> print(conflict(qp))
        floor: z against ceiling: z: enough would be floor: z 2 m lower; or ceiling: z 2 m higher
    """
    qp.check()
    system = _System.of(qp, held)
    slack = system.elastic(np.arange(len(system.items)))
    if slack is None:
        return None
    kept = system.filtered(slack)
    found = system.elastic(kept)
    if found is None:  # what the filter has left can be met: all of it contradicted itself by rounding alone
        return None
    kept = kept[found[kept] != 0.0]  # rounding may leave a row that gives nothing: all is the same without it
    s = found[kept]
    amounts = s.dot(s) / s * system.size[kept]
    items = tuple(int(i) for i in system.items[kept])
    return Conflict(tuple(Violation(qp.rows[i], float(d)) for i, d in zip(items, amounts, strict=True)), items)


@final
@dataclass(eq=False)
class _System:
    """lower ≤ R z ≤ upper: all rows and bounds with a finite side, of norm 1, in the space that physics leaves."""

    R: Mat
    lower: Vec
    upper: Vec
    size: Vec
    items: Index
    rank: Index
    owners: NDArray[Any]

    def __post_init__(self) -> None:
        self.order = np.lexsort((self.items, self.rank))

    @classmethod
    def of(cls, qp: QP, held: frozenset[str]) -> _System:
        matrix = np.vstack([qp.matrix, np.eye(qp.n)])
        lower, upper = np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub])
        fixed = np.array([i < qp.n_eq and row.owner in held for i, row in enumerate(qp.rows)])
        items = np.flatnonzero((np.isfinite(lower) | np.isfinite(upper)) & ~fixed)
        rows, lower_of, upper_of = matrix[items], lower[items], upper[items]
        if fixed.any():
            at, free = _solutions(matrix[fixed], upper[fixed])
            offset = rows @ at
            lower_of, upper_of, reduced = lower_of - offset, upper_of - offset, rows @ free
        else:
            reduced = rows
        size = np.linalg.norm(reduced, axis=1)
        void = size <= ROUNDING * np.linalg.norm(rows, axis=1)  # physics alone decides this row
        reduced[void], size[void] = 0.0, 1.0
        return cls(
            reduced / size[:, None], lower_of / size, upper_of / size, size, items,
            np.array([_rank(qp, int(i)) for i in items], dtype=np.intp),
            np.array([qp.rows[i].owner for i in items], dtype=object),
        )  # fmt: skip

    def elastic(self, rows: Index) -> Vec | None:
        """s of the least squares, zero on all other rows; None where these rows can be met."""
        _, s = least_violation(self.R[rows], self.lower[rows], self.upper[rows])
        values = np.where(s > 0.0, self.upper[rows], self.lower[rows])[s != 0.0]
        if np.abs(s).max(initial=0.0) <= SHARP + ROUNDING * np.abs(values).max(initial=0.0):
            return None
        spread = np.zeros(len(self.items))
        spread[rows] = s
        return spread

    def filtered(self, slack: Vec) -> Index:
        """Rows that cannot be met together, but can without any one of them: kinds are left out first, then owners."""
        kept = np.arange(len(self.items))
        for kind in range(3):
            kept, slack = self._left_out(kept, self.rank == kind, slack)
        kept = self._proven(np.flatnonzero(slack), slack)
        for owner in dict.fromkeys(self.owners[self.order]):
            kept, slack = self._left_out(kept, self.owners == owner, slack)
            kept = self._proven(kept, slack)
        short = self._shortened(kept, slack[kept])
        return short if self.elastic(short) is not None else self._one_by_one(kept)

    def _left_out(self, kept: Index, out: NDArray[np.bool_], slack: Vec) -> tuple[Index, Vec]:
        """``kept`` without some rows and the violations that are left, where they cannot be met even so."""
        rest = kept[~out[kept]]
        if 0 < len(rest) < len(kept):
            without = self.elastic(rest)
            if without is not None:
                return rest, without
        return kept, slack

    def _proven(self, rows: Index, slack: Vec) -> Index:
        """The rows that the proof needs, as long as they alone cannot be met."""
        share = np.abs(slack)
        needed = rows[share[rows] > SAME * share.max()]
        return needed if len(needed) == len(rows) or self.elastic(needed) is not None else rows

    def _shortened(self, rows: Index, s: Vec) -> Index:
        """The rows of a proof from which no row can be taken any more.

        Proofs on these rows are s = N c with N a basis of the null space of Rᵀ. While there is more than one, go from
        s to where the first entry becomes 0, without weakening the proof: along the direction that takes most from
        the row that is next to be left out. That row leaves, and N loses a column.
        """
        bound = np.where(s > 0.0, self.upper[rows], self.lower[rows])
        _, size, Vt = np.linalg.svd(self.R[rows].T)
        N = Vt[int((size > 1e-10 * size[0]).sum()) :].T
        s = N @ (N.T @ s)
        place = np.argsort(self.order)[rows]
        while N.shape[1] > 1:
            weakened = N.T @ bound  # of a proof, bound · s < 0
            along = N[int(place.argmin())].copy()
            along -= weakened * (weakened.dot(along) / weakened.dot(weakened))
            if np.linalg.norm(along) <= SAME:  # this row's share is the same in all proofs that are as strong
                along = np.linalg.svd(weakened[None])[2][-1]
            step = N @ along
            with np.errstate(divide="ignore", invalid="ignore"):
                far = np.where(step / s > ROUNDING, s / step, np.inf)
            if not np.isfinite(far.min()):
                step, far = -step, np.where(step / s < -ROUNDING, -s / step, np.inf)
            leaves = int(far.argmin())
            s = s - far[leaves] * step
            N = _without(N, leaves)
            stays = np.arange(len(s)) != leaves
            rows, s, N, bound, place = rows[stays], s[stays], N[stays], bound[stays], place[stays]
            gone = np.abs(s) <= SAME * np.abs(s).max()
            for row in np.flatnonzero(gone)[::-1]:  # entries that became 0 together
                if N.shape[1] > 1 and np.linalg.norm(N[row]) > SAME:
                    N = _without(N, int(row))
            rows, s, N, bound, place = rows[~gone], s[~gone], N[~gone], bound[~gone], place[~gone]
        return rows

    def _one_by_one(self, kept: Index) -> Index:
        """The same the slow way: a row stays if the rest can be met without it."""
        for row in self.order:
            if row in kept and len(kept) > 1:
                rest = kept[kept != row]
                if self.elastic(rest) is not None:
                    kept = rest
        return kept


def _without(N: Mat, row: int) -> Mat:
    """Of the vectors that N spans, those with a zero in one row: one column less."""
    reflected, *_ = np.linalg.qr(np.column_stack([N[row], np.eye(N.shape[1])[:, 1:]]), mode="complete")
    rest: Mat = (N @ reflected)[:, 1:]
    return rest


def _rank(qp: QP, item: int) -> int:
    """Equalities 0, contacts 1, limits 2."""
    if qp.rows[item].owner.startswith(_CONTACTS):
        return 1
    return 0 if item < len(qp.lower) and qp.lower[item] == qp.upper[item] else 2


def _solutions(E: Mat, e: Vec) -> tuple[Vec, Mat]:
    """All x with E x = e, as x = at + free z with orthonormal columns ``free``."""
    Q, R, order = qr(E.T, pivoting=True)
    size = np.abs(np.diag(R))
    rank = int((size > ROUNDING * size.max(initial=0.0)).sum())
    at = Q[:, :rank] @ np.linalg.solve(R[:rank, :rank].T, e[order[:rank]])
    return at, Q[:, rank:]


def least_violation(R: Mat, lower: Vec, upper: Vec) -> tuple[Vec, Vec]:
    """x (n,) and s = R x − clip(R x, lower, upper) (m,) where ½ ‖s‖² is least; s = 0 where the rows can be met.

    There Rᵀs = 0, and s ≠ 0 is Farkas's proof that they cannot: s · R x = 0 for every x, but −‖s‖² or less for those
    that meet the rows. Rows have norm 1, or less.

    Newton's method, each step to the least value on its line, from x = 0: rows that all but depend on each other send
    x far away, where digits are lost. A long step may end at the first bound on its way and gain nothing; the next one
    counts that bound too. So the steps end where none gains and the rows that are pushed on come again.

    Example:
        >>> import numpy as np
        >>> from wbc.qp.conflict import least_violation
        >>> x, s = least_violation(np.array([[1.0], [1.0]]), np.array([1.0, -9.0]), np.array([9.0, -1.0]))
        >>> bool(abs(x[0]) < 1e-12), s.round(9)
        (True, array([-1.,  1.]))
    """
    x = np.zeros(R.shape[1])
    value = R @ x
    s = value - np.clip(value, lower, upper)
    equal, least = lower == upper, np.inf
    tried: set[bytes] = set()  # the rows pushed on in steps since the last that gained more than rounding
    for _ in range(_STEPS):
        noise = NOISE * np.abs(value).max(initial=1.0)
        pushed = equal | (np.abs(s) > noise)
        if s.dot(s) < least * (1.0 - ROUNDING):
            least = float(s.dot(s))
            tried.clear()
        if not pushed.any() or pushed.tobytes() in tried:
            break
        tried.add(pushed.tobytes())
        step, *_ = lstsq(R[pushed], -s[pushed], cond=1e-11, lapack_driver="gelsy", check_finite=False)
        x = x + _lowest(value, R @ step, lower, upper) * step
        value = R @ x
        s = value - np.clip(value, lower, upper)
    return x, s


def _lowest(value: Vec, change: Vec, lower: Vec, upper: Vec) -> float:
    """t >= 0 where ½ ‖s(value + t change)‖² is least; its slope is piecewise linear and grows with t."""

    def slope(t: float) -> float:
        at = value + t * change
        return float((at - np.clip(at, lower, upper)).dot(change))

    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        kinks = np.concatenate([(lower - value) / change, (upper - value) / change])
    kinks = np.unique(kinks[np.isfinite(kinks) & (kinks > 0.0)])
    low, high = 0, len(kinks)  # the number of kinks before the lowest point
    while low < high:
        middle = (low + high) // 2
        if slope(kinks[middle]) < 0.0:
            low = middle + 1
        else:
            high = middle
    start = 0.0 if low == 0 else float(kinks[low - 1])
    end = float(kinks[low]) if low < len(kinks) else start + 1.0
    at_start, at_end = slope(start), slope(end)
    if at_start >= 0.0 or at_end <= at_start:
        return start
    return start - at_start * (end - start) / (at_end - at_start)
