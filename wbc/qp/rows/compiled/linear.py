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


@small_kernel
def add_four(A: Mat, k: int, shares: tuple[float, float, float, float], first: int, last: int, out: Vec) -> None:
    """out += Σ shares · rows k to k + 3 of A, entries first to last − 1."""
    p, q, r, s = A[k], A[k + 1], A[k + 2], A[k + 3]
    a, b, c, d = shares
    if a != 0.0 or b != 0.0 or c != 0.0 or d != 0.0:
        for i in range(first, last):
            out[i] += a * p[i] + b * q[i] + c * r[i] + d * s[i]


@small_kernel
def take_from_two(A: Mat, k: int, i: int, first: int) -> None:
    """Rows i and i + 1 of A lose their shares, in columns k to k + 3, of rows k to k + 3: entries from ``first`` on."""
    p, q, r, s, x, y = A[k], A[k + 1], A[k + 2], A[k + 3], A[i], A[i + 1]
    a, b, c, d = x[k], x[k + 1], x[k + 2], x[k + 3]
    e, f, g, h = y[k], y[k + 1], y[k + 2], y[k + 3]
    for j in range(first, i + 2):
        x[j] -= a * p[j] + b * q[j] + c * r[j] + d * s[j]
        y[j] -= e * p[j] + f * q[j] + g * r[j] + h * s[j]


@kernel
def factor(A: Mat, first: int, last: int, tolerance: float) -> int:
    """Lower Cholesky factor of A[first:last, first:last] in place, with the *inverse* of its diagonal.

    A row whose pivot is at most ``tolerance`` of its diagonal entry depends on those above it and is left out: its
    inverse pivot is 0. Returns how many are. Four columns are finished at a time; the upper triangle, whose entries
    may be anything, keeps them as rows meanwhile, and holds the transpose of the factor in the end.
    """
    left_out, k = 0, first
    while k < last:
        end = min(k + 4, last)
        for j in range(k, end):
            row = A[j]
            for c in range(j + 1, last):
                row[c] = A[c, j]
            for above in range(k, j):
                share = -A[above, j]
                for c in range(j, last):
                    row[c] += share * A[above, c]
            pivot = row[j]
            size = pivot + dot(row[first:], row[first:], j - first)
            if pivot > tolerance * size:
                row[j] = 1.0 / sqrt(pivot)
            else:
                row[j] = 0.0
                left_out += 1
            for c in range(j + 1, last):
                row[c] *= row[j]
                A[c, j] = row[c]
        for i in range(k + 4, last - 1, 2):
            take_from_two(A, k, i, end)
        if k + 4 < last and (last - k) % 2:
            i = last - 1
            add_four(A, k, (-A[i, k], -A[i, k + 1], -A[i, k + 2], -A[i, k + 3]), end, last, A[i])
        k = end
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
