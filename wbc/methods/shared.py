"""What methods share: limits checked where they enter, and rows that depend on each other made independent."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.tolerances import NOISE, ROUNDING
from wbc.types import Mat, Vec


def choice(name: str, value: Any, among: Iterable[str]) -> str:
    """``value``, one of the names ``among``.

    Raises:
        InvalidInput: it is none of them.
    """
    names = tuple(among)
    if not isinstance(value, str) or value not in names:
        raise InvalidInput(f"{name} is {value!r}; it must be one of {', '.join(names)}")
    return value


def box(size: int, **sides: Any) -> tuple[Vec, Vec]:
    """Lower and upper limits (size,) under the names of their arguments; a number stands for all.

    Raises:
        InvalidInput: wrong shape, NaN, a lower limit above the upper, or an interval with no number in it.
    """
    (low_name, low), (high_name, high) = sides.items()
    lower, upper = (
        checks.each(name, value, size, finite=False) for name, value in ((low_name, low), (high_name, high))
    )
    possible = (lower <= upper) & (lower < np.inf) & (upper > -np.inf)
    if not possible.all():
        i = int(possible.argmin())
        raise InvalidInput(
            f"{low_name}[{i}] is {lower[i]:g} and {high_name}[{i}] is {upper[i]:g}: no number is between"
        )
    return lower, upper


class Factors(NamedTuple):
    """A = U diag(values) V with what is not zero: U (m, r), values (r,), V (r, n).

    ``rest`` (m, m − r) and ``null`` (n − r, n) complete U and V: what A cannot reach, and what it does not see.

    Rows of V are orthonormal and span the rows of A, so that A x = b says V x = ``solve(b)`` where b can be reached.
    """

    U: Mat
    values: Vec
    V: Mat
    rest: Mat
    null: Mat

    @property
    def condition(self) -> float:
        """The largest value beside the smallest."""
        return float(self.values[0] / self.values[-1]) if len(self.values) else 1.0

    def solve(self, b: Vec) -> Vec:
        """The right side of V x that belongs to A x = b."""
        result: Vec = (self.U.T @ b) / self.values
        return result

    def inverse(self, b: Vec) -> Vec:
        """A# b, the least-squares solution of least norm."""
        result: Vec = self.V.T @ self.solve(b)
        return result

    def projected(self, x: Vec) -> Vec:
        """(I − A# A) x, what A does not see of x; entries that are rounding are zero.

        A row space is known to rounding times the condition of A, and no better.
        """
        result: Vec = x - self.V.T @ (self.V @ x)
        noise = NOISE * self.condition * np.abs(x).max(initial=0.0)
        result[np.abs(result) <= noise] = 0.0
        return result


def factors(A: Mat) -> Factors:
    """The singular value decomposition of A (m, n) with its rank decided."""
    U, values, V = np.linalg.svd(A)
    rank = int((values > ROUNDING * values.max(initial=0.0)).sum())
    return Factors(U[:, :rank], values[:rank], V[:rank], U[:, rank:], V[rank:])
