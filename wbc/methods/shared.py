"""What methods share: limits and metrics checked where they enter, rows made independent, roots of metrics."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from wbc import checks
from wbc.errors import InvalidInput
from wbc.tolerances import NOISE, ROUNDING, SAME
from wbc.types import Mat, Vec

#: Results are compared relative to no less than this part of what limits and task ask for.
SMALL = 1e-3


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


def largest_known(*limits: Vec) -> Vec:
    """The largest finite size of each entry of some limits (n,), 0 where there is none."""
    sizes = np.abs(limits)
    return np.asarray(np.where(np.isfinite(sizes), sizes, 0.0).max(axis=0))


def positive(name: str, values: Vec) -> Vec:
    """``values`` (n,), each of which is positive.

    Raises:
        InvalidInput: one that is not.
    """
    for i in (values <= 0.0).nonzero()[0]:
        raise InvalidInput(f"{name}[{i}] is {values[i]:g}; it must be positive")
    return values


def metric(name: str, value: Any, size: int) -> Mat:
    """A symmetric positive definite matrix (size, size) from a positive number, a positive vector or such a matrix.

    Raises:
        InvalidInput: wrong shape, NaN or inf, an entry that is not positive, not symmetric, an eigenvalue that is not
            positive.
    """
    given = checks.ndim(value)
    if given == 0:
        return np.diag(np.full(size, checks.number(name, value, low=0.0, strict=True)))
    if given == 1:
        return np.diag(positive(name, checks.array(name, value, (size,))))
    matrix = checks.array(name, value, (size, size))
    checks.symmetric(name, matrix)
    matrix = 0.5 * (matrix + matrix.T)
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        raise InvalidInput(f"{name} is not positive definite: an eigenvalue is {smallest:g}") from None
    return matrix


def root(matrix: Mat) -> Mat:
    """R (n, n), lower triangular, with R Rᵀ = matrix."""
    return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)


def inverse_root(matrix: Mat) -> Mat:
    """R (n, n), upper triangular, with R Rᵀ = matrix⁻¹."""
    return np.asarray(solve_triangular(np.linalg.cholesky(matrix), np.eye(len(matrix)), lower=True).T)


class Factors(NamedTuple):
    """Rows A / length = U diag(values) V with what is not zero: U (m, r), values (r,), V (r, n), length (m,).

    ``rest`` (m, m − r) and ``null`` (n − r, n) complete U and V: what A cannot reach, and what it does not see.

    Rows of V are orthonormal and span the rows of A, so that A x = b says V x = ``solve(b)`` where b can be reached.
    """

    U: Mat
    values: Vec
    V: Mat
    rest: Mat
    null: Mat
    length: Vec

    @property
    def condition(self) -> float:
        """The largest value beside the smallest."""
        return float(self.values[0] / self.values[-1]) if len(self.values) else 1.0

    def unreached(self, b: Vec) -> Vec:
        """The part of b / length that A x cannot be, in coordinates of ``rest``."""
        return np.asarray(self.rest.T @ (b / self.length))

    def reaches(self, b: Vec, terms: Vec) -> bool:
        """Whether A x can be b, to the rounding of numbers of the size ``terms`` (m,) that b is a sum of.

        Only terms of the rows that contradict each other count, as far as rounding tells which these are.
        """
        sizes = terms / self.length
        rounding = min(NOISE * self.condition, SAME) * np.linalg.norm(sizes) + SAME * (np.abs(self.rest).T @ sizes)
        return bool(np.linalg.norm(self.unreached(b)) <= np.linalg.norm(rounding))

    def solve(self, b: Vec) -> Vec:
        """The right side of V x that belongs to A x = b."""
        return np.asarray((self.U.T @ (b / self.length)) / self.values)

    def size(self, b: Vec) -> float:
        """‖A# b‖; what rows give of b counts as zero where it is rounding."""
        given = self.U.T @ (b / self.length)
        given[np.abs(given) <= ROUNDING * np.linalg.norm(b / self.length)] = 0.0
        return float(np.linalg.norm(given / self.values))

    def inverse(self, b: Vec) -> Vec:
        """A# b, the least-squares solution of least norm."""
        return np.asarray(self.V.T @ self.solve(b))

    def multipliers(self, g: Vec) -> Vec:
        """The y (m,) of least norm, rows at their lengths, with Aᵀ y = g for a g that rows of A combine to."""
        return np.asarray((self.U @ ((self.V @ g) / self.values)) / self.length)

    def projected(self, x: Vec) -> Vec:
        """(I − A# A) x, what A does not see of x; entries that are rounding are zero.

        A row space is known to rounding times the condition of A, and no better.
        """
        result: Vec = x - self.V.T @ (self.V @ x)
        noise = NOISE * self.condition * np.abs(x).max(initial=0.0)
        result[np.abs(result) <= noise] = 0.0
        return result


def factors(A: Mat, *, of_unit_length: bool = False) -> Factors:
    """The singular value decomposition of A (m, n) with its rank decided.

    ``of_unit_length``: of the rows divided by their lengths, so that they count alike whatever their units. Least
    squares of rows out of reach are then another.
    """
    length = unit_lengths(A) if of_unit_length else np.ones(len(A))
    U, values, V = np.linalg.svd(A / length[:, None])
    rank = int((values > ROUNDING * values.max(initial=0.0)).sum())
    return Factors(U[:, :rank], values[:rank], V[:rank], U[:, rank:], V[rank:], length)


def unit_lengths(rows: Mat) -> Vec:
    """Lengths of the rows (m,); that of the longest for rows that are zero beside it."""
    length: Vec = np.linalg.norm(rows, axis=1)
    longest = float(length.max(initial=0.0))
    return np.where(length > ROUNDING * longest, length, longest or 1.0)
