"""The steps of the filter that :mod:`wbc.robots.invariant_filter` describes, with its names."""

from __future__ import annotations

from math import inf, sin, sqrt
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, copy, kernel, small_kernel
from wbc.types import Index, Mat, Vec

#: Where the errors are in ξ: of R, v, p, of both biases, and of the first point.
_V, _P, _BG, _BA, BODY = 3, 6, 9, 12, 15
#: What errors grow from: the columns of F that differ from those of the identity, ξ_R, ξ_v and the biases.
_CAUSES = (0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14)


class Filter(NamedTuple):
    """The memory of a filter with k points, of which m are chosen; n = 15 + 3 k.

    Of points that do not stand, ``d`` and the rows of ``P`` mean nothing.
    """

    sizes: Annotated[Index, "2"]  # k, m
    white: Annotated[Vec, "6"]  # squares of the densities of gyroscope and accelerometer
    walk: Annotated[Vec, "6"]  # and of how their biases wander
    gravity: Annotated[Vec, "3"]
    wander: Annotated[Mat, "3, 3"]  # of each point [m²/s]
    gyro: Annotated[Vec, "3"]  # of the sample
    force: Annotated[Vec, "3"]
    R: Annotated[Mat, "3, 3"]
    v: Annotated[Vec, "3"]
    p: Annotated[Vec, "3"]
    bias: Annotated[Vec, "6"]
    d: Annotated[Mat, "k, 3"]
    P: Annotated[Mat, "n, n"]
    kept: Annotated[Vec, "n * n + 3 * k + 21"]  # the estimate before the sample
    chosen: Annotated[Index, "k"]
    y: Annotated[Mat, "k, 3"]  # where the encoders see the chosen points from the IMU, world axes
    N: Annotated[Mat, "3 * k, 3 * k"]
    r: Annotated[Vec, "3 * k"]
    S: Annotated[Mat, "3 * k, 3 * k"]
    factor: Annotated[Mat, "3 * k, 3 * k"]
    seen: Annotated[Mat, "3 * k, n"]
    step: Annotated[Vec, "n"]
    grown: Annotated[Mat, "n, 12"]  # F less the identity, its columns that are not 0
    moved: Annotated[Mat, "n, n"]  # F P
    causes: Annotated[Mat, "n, 12"]
    phi: Annotated[Vec, "3"]
    sums: Annotated[Mat, "9, 3"]  # Exp, Γ₁, Γ₂


LAYOUT = Layout(Filter, k="sizes[0]", n="15 + 3 * k")
#: In a kernel: the arrays at an address.
filter_at = LAYOUT.views


@kernel
def exponentials(phi: Vec, sums: Mat) -> None:
    """Exp(φ), Γ₁(φ) and Γ₂(φ) under one another (9, 3) of φ (3,) [rad]: Σ φ×ⁿ/n!, Σ φ×ⁿ/(n+1)! and Σ φ×ⁿ/(n+2)!."""
    square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    if square < 1e-4:  # the next terms are below rounding
        a, b = 1.0 - square / 6.0 + square**2 / 120.0, 0.5 - square / 24.0 + square**2 / 720.0
        c, d = 1.0 / 6.0 - square / 120.0 + square**2 / 5040.0, 1.0 / 24.0 - square / 720.0 + square**2 / 40320.0
    else:
        angle = sqrt(square)
        a, b = sin(angle) / angle, 2.0 * (sin(0.5 * angle) / angle) ** 2
        c, d = (1.0 - a) / square, (0.5 - b) / square
    for i in range(3):
        for j in range(3):
            one = 1.0 if i == j else 0.0
            twice = phi[i] * phi[j] - square * one
            once = 0.0
            if i != j:
                once = phi[3 - i - j] if (j - i + 3) % 3 == 2 else -phi[3 - i - j]
            sums[i, j] = one + a * once + b * twice
            sums[3 + i, j] = one + b * once + c * twice
            sums[6 + i, j] = 0.5 * one + c * once + d * twice


@small_kernel
def turned(A: Mat, first: int, x: Vec, i: int) -> float:
    """Entry i of A x, with the matrix that begins at a row of A."""
    return float(A[first + i, 0] * x[0] + A[first + i, 1] * x[1] + A[first + i, 2] * x[2])


@small_kernel
def crossed(x: Vec, A: Mat, i: int, j: int) -> float:
    """Entry (i, j) of x× A."""
    after, before = (i + 1) % 3, (i + 2) % 3
    return float(x[after] * A[before, j] - x[before] * A[after, j])


@small_kernel
def _copied(x: Vec, kept: Vec, at: int, restores: bool) -> int:
    """Numbers into ``kept`` from place ``at`` on, or back; the place behind them."""
    behind = at + len(x)
    copy(kept[at:] if restores else x, x if restores else kept[at:behind])
    return behind


@kernel
def copy_estimate(f: Filter, restores: bool) -> None:
    """Take down the estimate, or go back to the one that was taken down."""
    at = 0
    for vector in (f.v, f.p, f.bias):
        at = _copied(vector, f.kept, at, restores)
    for matrix in (f.R, f.d, f.P):
        for i in range(len(matrix)):
            at = _copied(matrix[i], f.kept, at, restores)


@kernel
def doubt(f: Filter, variance: Vec, about: Vec) -> None:
    """Add independent errors with those variances (9,): a turn about a point (3,) [rad²], of v [m²/s²] and p [m²]."""
    # ξ_v = error of v + v × ξ_R, ξ_p = error of p + about × ξ_R
    for axis in range(3):
        for i in range(9):
            f.step[i] = 0.0
        f.step[axis] = 1.0
        after, before = (axis + 1) % 3, (axis + 2) % 3
        f.step[_V + after], f.step[_V + before] = f.v[before], -f.v[after]
        f.step[_P + after], f.step[_P + before] = about[before], -about[after]
        for i in range(9):
            for j in range(9):
                f.P[i, j] += variance[axis] * f.step[i] * f.step[j]
    for i in range(3, 9):
        f.P[i, i] += variance[i]


@kernel
def _growth(f: Filter, dt: float) -> None:
    """F less the identity: what ξ does to itself in ``dt`` seconds."""
    grown, R, g = f.grown, f.R, f.gravity
    grown[:9] = 0.0
    for i in range(3):
        grown[_P + i, 3 + i] = dt
        for j in range(3):
            if i != j:
                pull = g[3 - i - j] if (j - i + 3) % 3 == 2 else -g[3 - i - j]
                grown[_V + i, j], grown[_P + i, j] = dt * pull, 0.5 * dt * dt * pull
            fall = -0.5 * dt * dt * crossed(g, R, i, j)
            along = -dt * crossed(f.v, R, i, j)
            grown[i, 6 + j] = -dt * R[i, j]
            grown[_V + i, 6 + j] = along + fall
            grown[_P + i, 6 + j] = -dt * crossed(f.p, R, i, j) + 0.5 * dt * along + dt / 3.0 * fall
            grown[_V + i, 9 + j], grown[_P + i, 9 + j] = -dt * R[i, j], -0.5 * dt * dt * R[i, j]
    for k in range(f.sizes[0]):
        for i in range(3):
            for j in range(3):
                grown[BODY + 3 * k + i, 6 + j] = -dt * crossed(f.d[k], R, i, j)


@kernel
def predict(f: Filter, dt: float) -> None:
    """``dt`` seconds on, with the mean rate ``gyro`` [rad/s] and specific force ``force`` [m/s²] of that time."""
    n = len(f.P)
    P, moved, causes, grown = f.P, f.moved, f.causes, f.grown
    _growth(f, dt)
    for i in range(n):
        for j in range(n):
            moved[i, j] = P[i, j]
        if not _BG <= i < BODY:
            for c in range(0 if i < BODY else 6, 12 if i < BODY else 9):
                share, row = grown[i, c], P[_CAUSES[c]]
                for j in range(n):
                    moved[i, j] += share * row[j]
        for c in range(12):
            causes[i, c] = moved[i, _CAUSES[c]]
        if not _BG <= i < BODY:  # white noise does what biases do, but not to the biases
            for c in range(6):
                causes[i, 6 + c] += grown[i, 6 + c] * f.white[c] / dt
    for i in range(n):
        for j in range(i + 1):
            total = moved[i, j]
            if j < _BG:
                for c in range(12):
                    total += causes[i, c] * grown[j, c]
            elif j >= BODY:
                for c in range(6, 9):
                    total += causes[i, c] * grown[j, c]
            P[i, j] = P[j, i] = total
    for i in range(6):
        P[_BG + i, _BG + i] += dt * f.walk[i]
    for k in range(f.sizes[0]):
        first = BODY + 3 * k
        for i in range(3):
            for j in range(3):
                P[first + i, first + j] += dt * f.wander[i, j]
    _move(f, dt)


@kernel
def _move(f: Filter, dt: float) -> None:
    """R, v and p after a time."""
    phi, a, sums, R = f.phi, f.step, f.sums, f.R
    for i in range(3):
        phi[i], a[i] = dt * (f.gyro[i] - f.bias[i]), f.force[i] - f.bias[3 + i]
    exponentials(phi, sums)
    for i in range(3):
        phi[i], a[3 + i] = turned(sums, 3, a, i), turned(sums, 6, a, i)
    for i in range(3):
        second = R[i, 0] * a[3] + R[i, 1] * a[4] + R[i, 2] * a[5]
        f.p[i] += dt * f.v[i] + dt * dt * (second + 0.5 * f.gravity[i])
        f.v[i] += dt * (turned(R, 0, phi, i) + f.gravity[i])
    for i in range(3):
        x, y, z = R[i, 0], R[i, 1], R[i, 2]
        for j in range(3):
            R[i, j] = x * sums[0, j] + y * sums[1, j] + z * sums[2, j]


@kernel
def cholesky(S: Mat, first: int, size: int, factor: Mat) -> bool:
    """The lower factor of a part of S that begins at (first, first); False where that is not positive definite."""
    for i in range(size):
        for j in range(i + 1):
            total = S[first + i, first + j]
            for c in range(j):
                total -= factor[i, c] * factor[j, c]
            if i == j:
                if not 0.0 < total < inf:
                    return False
                factor[i, i] = sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    return True


@kernel
def distance(factor: Mat, size: int, r: Vec, first: int) -> float:
    """rᵀ S⁻¹ r of a part of r that begins there, which becomes L⁻¹ r."""
    total = 0.0
    for i in range(size):
        value = r[first + i]
        for c in range(i):
            value -= factor[i, c] * r[first + c]
        r[first + i] = value / factor[i, i]
        total += r[first + i] * r[first + i]
    return total


@kernel
def innovation(f: Filter) -> None:
    """r (3m,) of the chosen points, covariance S of r with that of the encoders N, and H P (3m, n) in ``seen``."""
    n, m = len(f.P), f.sizes[1]
    for k in range(m):
        point = f.chosen[k]
        for i in range(3):
            f.r[3 * k + i] = f.d[point, i] - f.p[i] - f.y[k, i]
            for j in range(n):
                f.seen[3 * k + i, j] = f.P[BODY + 3 * point + i, j] - f.P[_P + i, j]
    for i in range(3 * m):
        for k in range(m):
            for j in range(3):
                f.S[i, 3 * k + j] = (
                    f.seen[i, BODY + 3 * f.chosen[k] + j] - f.seen[i, _P + j] + f.N[i, 3 * k + j]
                )  # fmt: skip


@kernel
def correct(f: Filter, most: float) -> int:
    """Take up the innovation of the chosen points: 1. 0 where rᵀ S⁻¹ r is more than ``most``, −1 where S is no
    covariance: then the estimate is as it was. ``r`` and ``seen`` are used up."""
    n, rows = len(f.P), 3 * f.sizes[1]
    if not cholesky(f.S, 0, rows, f.factor):
        return -1
    if not distance(f.factor, rows, f.r, 0) <= most:
        return 0
    step = f.step
    step[:] = 0.0
    for i in range(rows):
        row = f.seen[i]
        for c in range(i):
            share = f.factor[i, c]
            for j in range(n):
                row[j] -= share * f.seen[c, j]
        scale = 1.0 / f.factor[i, i]
        for j in range(n):
            row[j] *= scale
            step[j] -= f.r[i] * row[j]
        for k in range(n):
            for j in range(k + 1):
                f.P[k, j] -= row[k] * row[j]
    for k in range(n):
        for j in range(k):
            f.P[j, k] = f.P[k, j]
    _apply(f)
    return 1


@kernel
def _apply(f: Filter) -> None:
    """Move the estimate by the step in ξ."""
    step, sums, R, phi = f.step, f.sums, f.R, f.phi
    exponentials(step, sums)
    for j in range(3):
        for i in range(3):
            phi[i] = R[i, j]
        for i in range(3):
            R[i, j] = turned(sums, 0, phi, i)
    _shift(f.v, sums, step[3:6], phi)
    _shift(f.p, sums, step[6:9], phi)
    for i in range(6):
        f.bias[i] += step[_BG + i]
    for k in range(f.sizes[0]):
        _shift(f.d[k], sums, step[BODY + 3 * k : BODY + 3 * k + 3], phi)


@kernel
def _shift(x: Vec, sums: Mat, by: Vec, was: Vec) -> None:
    """x becomes Exp x + Γ₁ by."""
    for i in range(3):
        was[i] = x[i]
    for i in range(3):
        x[i] = turned(sums, 0, was, i) + turned(sums, 3, by, i)


@kernel
def place(f: Filter) -> None:
    """Let the chosen points stand where the encoders see them, with covariance N."""
    n, m, P = len(f.P), f.sizes[1], f.P
    for k in range(m):
        first = BODY + 3 * f.chosen[k]
        for i in range(3):
            f.d[f.chosen[k], i] = f.p[i] + f.y[k, i]
            for j in range(n):
                P[first + i, j] = P[_P + i, j]
    for k in range(m):
        first = BODY + 3 * f.chosen[k]
        for i in range(n):
            for j in range(3):
                P[i, first + j] = P[i, _P + j]
    for a in range(m):
        for b in range(m):
            for i in range(3):
                for j in range(3):
                    P[BODY + 3 * f.chosen[a] + i, BODY + 3 * f.chosen[b] + j] += f.N[3 * a + i, 3 * b + j]


@kernel
def level(f: Filter, point: int, up: Vec, height: float, variance: float, most: float) -> bool:
    """Take up that a point stands at a height along ``up`` (3,), unless that is off by more than ``most`` allows."""
    n, first, d, row = len(f.P), BODY + 3 * point, f.d[point], f.seen[0]
    # d̂ = Exp(ξ_R) d + Γ₁ ξ_d: its height is off by up·ξ_d + (d̂ × up)·ξ_R
    for j in range(n):
        row[j] = 0.0
        for i in range(3):
            after, before = (i + 1) % 3, (i + 2) % 3
            row[j] += up[i] * f.P[first + i, j] + (d[after] * up[before] - d[before] * up[after]) * f.P[i, j]
    off, s = -height, variance
    for i in range(3):
        after, before = (i + 1) % 3, (i + 2) % 3
        off += up[i] * d[i]
        s += up[i] * row[first + i] + (d[after] * up[before] - d[before] * up[after]) * row[i]
    if not off * off <= most * s:
        return False
    for j in range(n):
        f.step[j] = -row[j] * off / s
        for i in range(n):
            f.P[i, j] -= row[i] * row[j] / s
    _apply(f)
    return True
