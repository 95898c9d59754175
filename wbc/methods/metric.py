"""Metrics: symmetric positive definite matrices, checked where they enter, and their roots."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from wbc import checks
from wbc.errors import InvalidInput
from wbc.tolerances import SAME
from wbc.types import Mat, Vec


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
        diagonal = checks.array(name, value, (size,))
        if (diagonal <= 0.0).any():
            i = int(np.argmax(diagonal <= 0.0))
            raise InvalidInput(f"{name}[{i}] is {diagonal[i]:g}; it must be positive")
        return np.diag(diagonal)
    matrix = checks.array(name, value, (size, size))
    skew = np.abs(matrix - matrix.T)
    if skew.max(initial=0.0) > SAME * np.abs(matrix).max(initial=0.0):
        i, j = (int(k) for k in np.unravel_index(int(skew.argmax()), skew.shape))
        raise InvalidInput(f"{name} is not symmetric: [{i}, {j}] is {matrix[i, j]:g}, [{j}, {i}] is {matrix[j, i]:g}")
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
    result: Mat = solve_triangular(np.linalg.cholesky(matrix), np.eye(len(matrix)), lower=True).T
    return result


def vector(name: str, value: Any, size: int) -> Vec:
    """A vector (size,); a number stands for all entries.

    Raises:
        InvalidInput: wrong shape, NaN or inf.
    """
    return checks.each(name, value, size)
