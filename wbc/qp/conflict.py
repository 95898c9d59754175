"""Conflict: which rows of an infeasible QP cannot hold together, and how much each must give.

The core proves that there is no point (:func:`wbc.qp.proof.contradiction`): multipliers s of rows and bounds R with
Rᵀs = 0 and Σ sᵢ bᵢ = β < 0, where bᵢ is the side that is pushed on. Its finite method holds independent rows, and the
proof combines these with one row that depends on them. So the combination is unique but for its length: the rows with
sᵢ ≠ 0 contradict each other, and without any one of them the others are independent and can be met. The set is
irreducible, and if all others stay, row i must move by −β / sᵢ.

Of several conflicts, one that needs no equality is told, then one that needs no contact: kinds of rows are left out in
this order for as long as the rest cannot be met. So a conflict is about limits of the robot rather than between tasks.

Farkas, Theorie der einfachen Ungleichungen, 1902. Chinneck, Dravnieks: Locating minimal infeasible constraint sets in
linear programs, ORSA Journal on Computing 3(2), 1991.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from wbc.qp.problem import QP, Row, Shape
from wbc.qp.proof import contradiction
from wbc.tolerances import MET

#: The owner of rows that nothing can loosen: the equations of motion.
PHYSICS = "base dynamics"
#: How the owners of a contact's rows begin.
_CONTACTS = ("contact[", "friction[", "force[")

#: The kind of an equation of motion.
_HELD = 3
#: Of longer conflicts a sentence tells this many rows.
_TOLD = 6


class Violation(NamedTuple):
    """A row, or a bound of a variable, and the slack that it needs: positive beyond its upper side. ``equal``: its two
    sides are one."""

    row: Row
    amount: float
    equal: bool = False

    @property
    def way(self) -> str:
        """Which side would have to move, where to, and how far."""
        side, way = ("upper", "up") if self.amount > 0 else ("lower", "down")
        return ("" if self.equal else f"{side} bound ") + f"{way} by {abs(self.amount):.3g} {self.row.unit}".rstrip()

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
        gives = tuple(give._replace(row=row) for row, give in zip(rows, self.gives, strict=True))
        return Conflict(gives, self.items)

    def __str__(self) -> str:
        first, *others = (str(row) for row in self.rows)
        if not others:
            return f"{first} cannot be met at all: enough would be {self.gives[0]}"
        told = self.gives
        if len(told) > _TOLD:
            others = [*others[: _TOLD - 1], f"{len(told) - _TOLD} more"]
            told = tuple(sorted(told, key=lambda give: abs(give.amount))[:_TOLD])
        against = " and ".join(filter(None, [", ".join(others[:-1]), others[-1]]))
        return f"{first} against {against}: enough would be {'; or '.join(str(give) for give in told)}"


def conflict(qp: QP) -> Conflict | None:
    """An irreducible set of rows and bounds that cannot hold together; None where all can (to 1e-6 of their units).

    The equations of motion always hold, and are not named. The same QP gives the same answer, bit for bit.

    Raises:
        InvalidProblem: as :meth:`QP.check`.

    Example:
        >>> import wbc
        >>> from wbc.qp.conflict import conflict
        >>> rows = [("floor", "z", "m"), ("roof", "z", "m"), ("wall", "x", "m")]
        >>> qp = wbc.QP([[1.0]], [0.0], C=[[1.0], [1.0], [1.0]], cl=[1.0, -9.0, 0.0], cu=[9.0, -1.0, 9.0], rows=rows)
        >>> print(conflict(qp))
        floor: z against roof: z: enough would be floor: z lower bound down by 2 m; or roof: z upper bound up by 2 m
    """
    qp.check()
    kinds = np.array([_kind(qp, i) for i in range(len(qp.rows))])
    kept = np.ones(len(qp.rows), dtype=bool)
    push = contradiction(_of_rows(qp, kept), MET)
    for kind in range(3):
        fewer = kept & (kinds != kind)
        without = None if push is None else contradiction(_of_rows(qp, fewer), MET)
        if without is not None:
            kept, push = fewer, without
    if push is None:
        return None
    lower, upper = qp.sides
    pushes = push.nonzero()[0]
    beta = float(push[pushes] @ np.where(push > 0.0, upper, lower)[pushes])
    items = tuple(int(i) for i in pushes if kinds[i] != _HELD)
    gives = tuple(Violation(qp.rows[i], float(-beta / push[i]), bool(lower[i] == upper[i])) for i in items)
    return Conflict(gives, items) if items else None


def _kind(qp: QP, item: int) -> int:
    """Equalities 0, contacts 1, limits 2, equations of motion 3."""
    owner = qp.rows[item].owner
    if item < qp.n_eq and owner == PHYSICS:
        return _HELD
    if owner.startswith(_CONTACTS):
        return 1
    return 0 if item < len(qp.lower) and qp.lower[item] == qp.upper[item] else 2


def _of_rows(qp: QP, kept: NDArray[np.bool_]) -> QP:
    """The same rows, two-sided all, without the sides of those that are not kept."""
    rows = QP.empty(Shape(qp.n, 0, len(qp.matrix)), qp.rows)
    rows.H[:], rows.g[:], rows.matrix[:] = 0.0, 0.0, qp.matrix
    rows.sides[:] = np.where(kept, qp.sides, [[-np.inf], [np.inf]])
    return rows
