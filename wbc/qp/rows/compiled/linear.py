"""Linear algebra of the kernels: small dense systems, where a call of LAPACK would cost more than its work."""

from __future__ import annotations

from math import hypot, sqrt

from wbc.compiled import kernel, small_kernel
from wbc.types import Mat, Vec


@small_kernel
def dot(a: Vec, b: Vec, n: int) -> float:
    """Σ a b over the first n entries."""
    total = 0.0
    for c in range(n):
        total += a[c] * b[c]
    return total


@small_kernel
def add(share: float, a: Vec, n: int, out: Vec) -> None:
    """out += share · a, the first n entries."""
    for c in range(n):
        out[c] += share * a[c]


@small_kernel
def products(F: Mat, i: int, first: int, n: int, out: Vec) -> None:
    """out[j] = F[i] · F[j] for first ≤ j ≤ i, four at a time."""
    row, j = F[i], first
    while j + 3 <= i:
        p, q, r, s = F[j], F[j + 1], F[j + 2], F[j + 3]
        a = b = c = d = 0.0
        for k in range(n):
            v = row[k]
            a += v * p[k]
            b += v * q[k]
            c += v * r[k]
            d += v * s[k]
        out[j], out[j + 1], out[j + 2], out[j + 3] = a, b, c, d
        j += 4
    while j <= i:
        out[j] = dot(row, F[j], n)
        j += 1


@kernel
def factor(A: Mat, first: int, last: int, tolerance: float) -> int:
    """Lower Cholesky factor of A[first:last, first:last] in place, with the *inverse* of its diagonal.

    A row whose pivot is at most ``tolerance`` of its diagonal entry depends on those above it and is left out: its
    inverse pivot is 0. Returns how many are. Zeros that a row begins with stay, and cost nothing.
    """
    left_out = 0
    for i in range(first, last):
        row = A[i]
        size = row[i]
        pivot = size
        start = first
        while start < i and row[start] == 0.0:
            start += 1
        for j in range(start, i):
            other = A[j]
            value = row[j]
            for c in range(start, j):
                value -= row[c] * other[c]
            value *= other[j]
            row[j] = value
            pivot -= value * value
        if pivot > tolerance * size:
            row[i] = 1.0 / sqrt(pivot)
        else:
            row[i] = 0.0
            left_out += 1
    return left_out


@kernel
def forward(L: Mat, first: int, last: int, b: Vec) -> None:
    """b := L⁻¹ b; what was left out is 0."""
    for i in range(first, last):
        row = L[i]
        value = b[i]
        for c in range(first, i):
            value -= row[c] * b[c]
        b[i] = value * row[i]


@kernel
def backward(L: Mat, first: int, last: int, b: Vec) -> None:
    """b := L⁻ᵀ b; what was left out is 0."""
    for i in range(last - 1, first - 1, -1):
        row = L[i]
        value = b[i] * row[i]
        b[i] = value
        for c in range(first, i):
            b[c] -= value * row[c]


@kernel
def remove(L: Mat, first: int, last: int, j: int) -> None:
    """The factor without row j: rows below move up, and rotations of columns make it triangular again."""
    for i in range(j, last - 1):
        for c in range(first, i + 2):
            L[i, c] = L[i + 1, c]
    for i in range(j, last - 1):
        a, b = L[i, i], 1.0 / L[i, i + 1]
        size = hypot(a, b)
        cos, sin = a / size, b / size
        L[i, i] = 1.0 / size
        for k in range(i + 1, last - 1):
            p, q = L[k, i], L[k, i + 1]
            L[k, i], L[k, i + 1] = cos * p + sin * q, cos * q - sin * p
