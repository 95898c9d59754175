"""Linear algebra of the kernels: small dense systems, where a call of LAPACK would cost more than its work.

Long loops run from 0, over slices. An index that may be negative counts from the end, and a loop that has to look at
its sign is not vectorised.
"""

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
def clear(out: Vec) -> None:
    """out := 0."""
    for c in range(len(out)):
        out[c] = 0.0


@small_kernel
def times(F: Mat, column: int, row: Vec, first: int, last: int, n: int, out: Vec) -> None:
    """out[j] = row · F[j] for first ≤ j < last, n entries of F[j] from ``column`` on, four at a time."""
    j = first
    while j + 3 < last:
        p, q, r, s = F[j][column:], F[j + 1][column:], F[j + 2][column:], F[j + 3][column:]
        a = b = c = d = 0.0
        for k in range(n):
            v = row[k]
            a += v * p[k]
            b += v * q[k]
            c += v * r[k]
            d += v * s[k]
        out[j], out[j + 1], out[j + 2], out[j + 3] = a, b, c, d
        j += 4
    while j < last:
        out[j] = dot(row, F[j][column:], n)
        j += 1


@small_kernel
def add_rows(sign: float, shares: Vec, A: Mat, first: int, last: int, n: int, out: Vec) -> None:
    """out += sign · Σ shares[k] A[k] for first ≤ k < last, the first n entries, four at a time."""
    k = first
    while k + 3 < last:
        a, b, c, d = sign * shares[k], sign * shares[k + 1], sign * shares[k + 2], sign * shares[k + 3]
        if a != 0.0 or b != 0.0 or c != 0.0 or d != 0.0:
            p, q, r, s = A[k], A[k + 1], A[k + 2], A[k + 3]
            for i in range(n):
                out[i] += a * p[i] + b * q[i] + c * r[i] + d * s[i]
        k += 4
    while k < last:
        if shares[k] != 0.0:
            add(sign * shares[k], A[k], n, out)
        k += 1


@small_kernel
def inverse_pivot(row: Vec, j: int, first: int, tolerance: float) -> float:
    """1 / √ of the pivot in column j, 0 where it is at most ``tolerance`` of what the diagonal entry was."""
    left = row[first:]
    size = row[j] + dot(left, left, j - first)
    return 1.0 / sqrt(row[j]) if row[j] > tolerance * size else 0.0


@kernel
def factor(A: Mat, first: int, last: int, tolerance: float) -> int:
    """Lower Cholesky factor of A[first:last, first:last] in place, with the *inverse* of its diagonal.

    A row whose pivot is at most ``tolerance`` of its diagonal entry depends on those above it and is left out: its
    inverse pivot is 0. Returns how many are. Four columns are finished at a time. Their entries become rows of the
    upper triangle, whose entries may be anything before, so that what they take from the rest runs along rows.
    """
    left_out, k = 0, first
    while k + 4 <= last:
        p, q, r, s = A[k], A[k + 1], A[k + 2], A[k + 3]
        i0 = inverse_pivot(p, k, first, tolerance)
        q0, r0, s0 = q[k] * i0, r[k] * i0, s[k] * i0
        q[k], r[k], s[k] = q0, r0, s0
        q[k + 1] -= q0 * q0
        i1 = inverse_pivot(q, k + 1, first, tolerance)
        r1, s1 = (r[k + 1] - r0 * q0) * i1, (s[k + 1] - s0 * q0) * i1
        r[k + 1], s[k + 1] = r1, s1
        r[k + 2] -= r0 * r0 + r1 * r1
        i2 = inverse_pivot(r, k + 2, first, tolerance)
        s2 = (s[k + 2] - s0 * r0 - s1 * r1) * i2
        s[k + 2] = s2
        s[k + 3] -= s0 * s0 + s1 * s1 + s2 * s2
        i3 = inverse_pivot(s, k + 3, first, tolerance)
        p[k], q[k + 1], r[k + 2], s[k + 3] = i0, i1, i2, i3
        left_out += int(i0 == 0.0) + int(i1 == 0.0) + int(i2 == 0.0) + int(i3 == 0.0)
        k += 4
        p, q, r, s = p[k:last], q[k:last], r[k:last], s[k:last]
        for i in range(last - k):
            x = A[k + i][k - 4 :]
            a = x[0] * i0
            b = (x[1] - q0 * a) * i1
            c = (x[2] - r0 * a - r1 * b) * i2
            d = (x[3] - s0 * a - s1 * b - s2 * c) * i3
            x[0], x[1], x[2], x[3] = a, b, c, d
            p[i], q[i], r[i], s[i] = a, b, c, d
        for i in range(last - k):
            x, a, b, c, d = A[k + i][k:], p[i], q[i], r[i], s[i]
            for j in range(i + 1):
                x[j] -= a * p[j] + b * q[j] + c * r[j] + d * s[j]
    for j in range(k, last):
        A[j, j] = inverse_pivot(A[j], j, first, tolerance)
        left_out += int(A[j, j] == 0.0)
        for i in range(j + 1, last):
            A[i, j] *= A[j, j]
            for c in range(j + 1, i + 1):
                A[i, c] -= A[i, j] * A[c, j]
    return left_out


@kernel
def forward(L: Mat, first: int, last: int, b: Vec) -> None:
    """b := L⁻¹ b; what was left out is 0."""
    x = b[first:]
    for i in range(last - first):
        row = L[first + i][first:]
        x[i] = (x[i] - dot(row, x, i)) * row[i]


@kernel
def backward(L: Mat, first: int, last: int, b: Vec) -> None:
    """b := L⁻ᵀ b; what was left out is 0."""
    x = b[first:]
    for i in range(last - first - 1, -1, -1):
        row = L[first + i][first:]
        x[i] *= row[i]
        add(-x[i], row, i, x)


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
