"""Rotations for kernels: the exponential of :mod:`pinocchio` and its logarithms, from 0 to π."""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt
from typing import Any

from wbc.compiled import kernel, small_kernel
from wbc.tolerances import SHARP
from wbc.types import Mat, Vec

#: A vector of three numbers.
Three = tuple[float, float, float]

# Nearer to π than this the axis is read from the symmetric part of R: the other one vanishes there.
_NEAR_PI = 1e-2
#: Nearer than this [m] two places count as this far apart where one divides by their distance.
NEAREST = 1e-3
#: An axis with a shorter shadow on the ground counts as having one of this length: upright, it points nowhere.
SHORTEST = 1e-2


@small_kernel
def three(x: Vec, first: int) -> Three:
    """Three numbers of an array."""
    return x[first], x[first + 1], x[first + 2]


@small_kernel
def cross(a: Any, b: Any) -> Three:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@small_kernel
def dot(a: Any, b: Any) -> float:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]  # type: ignore[no-any-return]


@small_kernel
def plus(a: Any, s: float, b: Any) -> Three:
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@small_kernel
def scaled(s: float, x: Any) -> Three:
    """s x."""
    return s * x[0], s * x[1], s * x[2]


@small_kernel
def times(R: Vec, x: Any) -> Three:
    """R x, a matrix (9,) by rows."""
    return (
        R[0] * x[0] + R[1] * x[1] + R[2] * x[2], R[3] * x[0] + R[4] * x[1] + R[5] * x[2],
        R[6] * x[0] + R[7] * x[1] + R[8] * x[2],
    )  # fmt: skip


@small_kernel
def back(R: Vec, x: Any) -> Three:
    """Rᵀ x, a matrix (9,) by rows."""
    return (
        R[0] * x[0] + R[3] * x[1] + R[6] * x[2], R[1] * x[0] + R[4] * x[1] + R[7] * x[2],
        R[2] * x[0] + R[5] * x[1] + R[8] * x[2],
    )  # fmt: skip


@kernel
def turn_by(r: float, w: Vec, R: Vec, out: Vec) -> None:
    """out = exp(r w) R, matrices (9,) by rows."""
    x, y, z = r * w[0], r * w[1], r * w[2]
    half = 0.5 * sqrt(x * x + y * y + z * z)
    s = sin(half) / half if half > 0.0 else 1.0
    a, b = s * cos(half), 0.5 * s * s  # sin θ / θ and (1 − cos θ) / θ², without the difference
    for j in range(3):  # exp(w) u = u + a w × u + b w × (w × u)
        u0, u1, u2 = R[j], R[3 + j], R[6 + j]
        c0, c1, c2 = y * u2 - z * u1, z * u0 - x * u2, x * u1 - y * u0
        out[j] = u0 + a * c0 + b * (y * c2 - z * c1)
        out[3 + j] = u1 + a * c1 + b * (z * c0 - x * c2)
        out[6 + j] = u2 + a * c2 + b * (x * c1 - y * c0)


@kernel
def log3(R: Mat, w: Vec) -> float:
    """w becomes the rotation vector of R; returns its angle."""
    x, y, z = 0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])
    s, c = sqrt(x * x + y * y + z * z), 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = atan2(s, c)
    if angle < pi - _NEAR_PI:
        factor = angle / s if s > SHARP else 1.0 + s * s / 6.0
        w[0], w[1], w[2] = factor * x, factor * y, factor * z
        return angle
    # R = cos θ + (1 − cos θ) a aᵀ + sin θ [a]ₓ: the longest column of a aᵀ is the axis but for its sign, and that is
    # the one of the other part. At π that part is rounding: its entries one by one say nothing.
    k = 0
    if R[1, 1] > R[k, k]:
        k = 1
    if R[2, 2] > R[k, k]:
        k = 2
    for i in range(3):
        w[i] = 0.5 * (R[i, k] + R[k, i])
    w[k] -= c
    factor = angle / sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    if w[0] * x + w[1] * y + w[2] * z < 0.0:
        factor = -factor
    for i in range(3):
        w[i] *= factor
    return angle


@kernel
def log6(R: Mat, p: Vec, w: Vec, e: Vec) -> None:
    """e (6,) becomes the twist whose exponential is (R, p): linear, then angular. ``w`` (3,) is memory."""
    angle = log3(R, w)
    square = angle * angle
    if angle < 0.03:  # the difference below loses what the series has
        beta = 1.0 / 12.0 + square / 720.0
        alpha = 1.0 - square * beta
    else:
        half = angle * sin(angle) / (2.0 * (1.0 - cos(angle)))
        alpha, beta = half, (1.0 - half) / square
    along = beta * (w[0] * p[0] + w[1] * p[1] + w[2] * p[2])
    e[0] = alpha * p[0] - 0.5 * (w[1] * p[2] - w[2] * p[1]) + along * w[0]
    e[1] = alpha * p[1] - 0.5 * (w[2] * p[0] - w[0] * p[2]) + along * w[1]
    e[2] = alpha * p[2] - 0.5 * (w[0] * p[1] - w[1] * p[0]) + along * w[2]
    e[3], e[4], e[5] = w[0], w[1], w[2]
