"""Linear algebra of the kernels: small dense systems, where a call of LAPACK would cost more than its work."""

from __future__ import annotations

from math import sqrt

from wbc.compiled import kernel
from wbc.types import Mat, Vec


@kernel
def factor(A: Mat, m: int, tolerance: float, kept: int) -> int:
    """Lower Cholesky factor of A[:m, :m] in place, with the *inverse* of its diagonal.

    A pivot below ``tolerance`` of its diagonal entry means dependence: among the first ``kept`` rows the result is
    that row's number + 1; behind them the row is left out (its inverse pivot is 0). 0: done.
    """
    for i in range(m):
        row = A[i]
        size = row[i]
        for j in range(i):
            other = A[j]
            value = row[j]
            for c in range(j):
                value -= row[c] * other[c]
            row[j] = value * other[j]
        pivot = size
        for c in range(i):
            pivot -= row[c] * row[c]
        if pivot > tolerance * size:
            row[i] = 1.0 / sqrt(pivot)
        elif i < kept:
            return i + 1
        else:
            row[i] = 0.0
    return 0


@kernel
def solve(L: Mat, m: int, b: Vec) -> None:
    """b becomes the solution of L Lᵀ x = b; what was left out is 0."""
    for i in range(m):
        row = L[i]
        value = b[i]
        for c in range(i):
            value -= row[c] * b[c]
        b[i] = value * row[i]
    for back in range(m):
        i = m - 1 - back
        row = L[i]
        value = b[i] * row[i]
        b[i] = value
        for c in range(i):
            b[c] -= value * row[c]


@kernel
def solve_rows(L: Mat, m: int, B: Mat, columns: int) -> None:
    """The rows of B (m, columns) become the solution of L Lᵀ X = B."""
    for i in range(m):
        row = B[i]
        for j in range(i):
            share, other = L[i, j], B[j]
            for c in range(columns):
                row[c] -= share * other[c]
        scale = L[i, i]
        for c in range(columns):
            row[c] *= scale
    for back in range(m):
        i = m - 1 - back
        row = B[i]
        for j in range(i + 1, m):
            share, other = L[j, i], B[j]
            for c in range(columns):
                row[c] -= share * other[c]
        scale = L[i, i]
        for c in range(columns):
            row[c] *= scale
