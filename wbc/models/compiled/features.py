"""Features of two convex shapes that are nearest to each other: where exactly, and how their distance bends in time.

    x(u, t) = Σ λ_i (a_i(θ) − b_i(φ))    from the second shape to the first; λ_1 = 1 − λ_2 − … − λ_k
    g = ½ |x|², least over u = (λ_2 … λ_k, θ, φ)    the nearest points;  d = |x| between cores

a_i and b_i are corners of hulls or points of cylinders, at most three of each. Where the nearest point of a cylinder is
on its side or on its edge, θ or φ turns its points about its axis; inside its flat end they are as fixed as corners.

A search in steps finds the normal of a cylinder to half the digits of its distance. Newton's method finds the others:

    g_uu δu = −g_u    g_u = Xᵀ x,  g_uu = Xᵀ X + x·x_uu,  X = ∂x/∂u

and the proof of what it found is the one of :mod:`wbc.models.compiled.gjk`. While the shapes move, u follows so that
g_u stays zero, u̇ = −g_uu⁻¹ g_ut, and

    d d̈ + ḋ² = |ẋ|² + x·ẍ − g_utᵀ g_uu⁻¹ g_ut    g_ut = Xᵀ ẋ + Ẋᵀ x

Nocedal, Wright: Numerical Optimization, 2nd edition, Springer 2006: Newton's method (3.3), implicit functions (A.2).
"""

from __future__ import annotations

from math import inf, nan, sqrt

from wbc.compiled import kernel, small_kernel
from wbc.models.compiled.gjk import (
    ENOUGH,
    TOUCHING,
    Bodies,
    answer,
    begin,
    extend,
    join,
    kept,
    nearest,
    point,
    search,
    support,
)
from wbc.types import Mat, Vec

#: ε of a proof, and of the search before Newton's method, which then doubles the digits with each of so many steps [m].
_SHARP, _ROUGH, _STEPS = 1e-13, 1e-9, 4
#: A nearest point that is as far from the axis, as a share of the radius, is tried as one of the edge or the side:
#: after a rough search, and after a sharp one. What then has no proof is tried as one of the flat end.
_EDGE, _SHARP_EDGE = 0.999, 1.0 - 1e-9
#: Time [s] for which a feature is to be the nearest: with less, the larger one counts that it is part of.
_LASTS = 1e-4


@small_kernel
def _turns(s: Bodies, shape: int, side: int) -> bool:
    """Whether the points of a shape turn about its axis."""
    return bool(s.is_cylinder[shape] != 0 and s.P[0, 6 + side] == 1.0)


@small_kernel
def _joins(s: Bodies, at: int) -> bool:
    """Whether row ``at`` is one of the simplex. A row before that has the same points gets its share instead."""
    for row in range(at):
        same = True
        for i in range(6):
            same = same and s.P[row, i] == s.P[at, i]
        if same:
            s.share[row] += s.share[at]
            return False
    return True


@kernel
def _merged(s: Bodies, first: int, second: int, k: int, edge: float) -> int:
    """Points of a cylinder's side or edge become points at one angle, and equal rows one row; how many are left."""
    for side in range(2):
        shape, o = second if side else first, 3 * side
        if s.is_cylinder[shape]:
            x = y = 0.0
            for at in range(k):
                x += s.share[at] * s.P[at, o]
                y += s.share[at] * s.P[at, o + 1]
            out, radius = sqrt(x * x + y * y), s.size[shape, 0]
            turns = out > edge * radius
            for at in range(k):
                s.P[at, 6 + side] = 1.0 if turns else 0.0
                if turns:
                    s.P[at, o], s.P[at, o + 1] = radius / out * x, radius / out * y
    m = 1
    for at in range(1, k):
        for i in range(8):
            s.P[m, i] = s.P[at, i]
        s.share[m] = s.share[at]
        if _joins(s, m):
            m += 1
    for at in range(m):
        join(s, first, second, at)
    return m


@kernel
def _linearise(s: Bodies, first: int, second: int, k: int, x: float, y: float, z: float) -> int:
    """``along[0]`` and ``along[1]`` become ∂a/∂u and ∂b/∂u, and ``hessian`` g_uu; returns the size of u."""
    m = k - 1
    for j in range(4):
        for i in range(3):
            s.along[0, j, i] = s.along[1, j, i] = 0.0
        for i in range(4):
            s.hessian[j, i] = 0.0
    for side in range(2):
        shape, o = second if side else first, 3 * side
        R, p, q, r = s.placement[shape], s.P[0, o], s.P[0, o + 1], s.P[0, o + 2]
        for j in range(k - 1):
            a, b, c = s.P[j + 1, o] - p, s.P[j + 1, o + 1] - q, s.P[j + 1, o + 2] - r
            for i in range(3):
                s.along[side, j, i] = R[i] * a + R[3 + i] * b + R[6 + i] * c
        if _turns(s, shape, side):
            outwards = x * (R[0] * p + R[3] * q) + y * (R[1] * p + R[4] * q) + z * (R[2] * p + R[5] * q)
            s.hessian[m, m] = outwards if side else -outwards  # x·x_uu
            for i in range(3):
                s.along[side, m, i] = R[3 + i] * p - R[i] * q
            m += 1
    for j in range(m):
        for i in range(j + 1):
            for c in range(3):
                s.hessian[i, j] += (s.along[0, i, c] - s.along[1, i, c]) * (s.along[0, j, c] - s.along[1, j, c])
            s.hessian[j, i] = s.hessian[i, j]
    return m


@small_kernel
def _solve(s: Bodies, m: int) -> bool:
    """Column 4 of ``hessian`` becomes g_uu⁻¹ times itself. False: g has no least point here."""
    H = s.hessian
    for i in range(m):
        if not H[i, i] > 0.0:
            return False
        for j in range(i + 1, m):
            factor = H[j, i] / H[i, i]
            for c in range(i, 5):
                H[j, c] -= factor * H[i, c]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            H[i, 4] -= H[i, j] * H[j, 4]
        H[i, 4] /= H[i, i]
    return True


@kernel
def _sharpened(s: Bodies, first: int, second: int, k: int) -> bool:
    """Newton's steps on u. False: g has no least point."""
    for _ in range(_STEPS):
        x, y, z = point(s, k)
        m = _linearise(s, first, second, k, x, y, z)
        for i in range(m):
            A, B = s.along[0, i], s.along[1, i]
            s.hessian[i, 4] = (B[0] - A[0]) * x + (B[1] - A[1]) * y + (B[2] - A[2]) * z
        if not _solve(s, m):
            return False
        for i in range(k - 1):
            s.share[i + 1] += s.hessian[i, 4]
            s.share[0] -= s.hessian[i, 4]
        m = k - 1
        for side in range(2):
            shape, o = second if side else first, 3 * side
            if _turns(s, shape, side):
                p, q, angle = s.P[0, o], s.P[0, o + 1], s.hessian[m, 4]
                p, q = p - angle * q, q + angle * p
                scale = s.size[shape, 0] / sqrt(p * p + q * q)
                for at in range(k):
                    s.P[at, o], s.P[at, o + 1] = scale * p, scale * q
                m += 1
        for at in range(k):
            join(s, first, second, at)
    return True


@kernel
def _proven(s: Bodies, first: int, second: int, k: int, edge: float, enough: float) -> int:
    """Newton's method from what a search has left; how many rows the answer has, 0 without a proof."""
    k = _merged(s, first, second, k, edge)
    if not _sharpened(s, first, second, k):
        return 0
    for at in range(k):
        if not s.share[at] > 0.0:  # as where the middle of a side is on a diagonal: its point is that of fewer rows
            if not nearest(s, k):
                return 0
            k = kept(s, k)
            break
    x, y, z = point(s, k)
    d = sqrt(x * x + y * y + z * z)
    extend(s, first, second, x, y, z, k)
    return k if d > TOUCHING and d - (x * s.W[k, 0] + y * s.W[k, 1] + z * s.W[k, 2]) / d <= enough else 0


@kernel
def distance(s: Bodies, first: int, second: int, line: Vec, simplex: Mat, k: int) -> int:
    """What :func:`~wbc.models.compiled.gjk.search` finds, as sharp as rounding allows, with the normal as sharp."""
    if not (s.is_cylinder[first] or s.is_cylinder[second]):
        return search(s, first, second, line, simplex, k, _SHARP)
    for sharp, edge, enough in ((_ROUGH, _EDGE, _SHARP), (_SHARP, _SHARP_EDGE, ENOUGH), (_SHARP, inf, _SHARP)):
        k = search(s, first, second, line, simplex, k, sharp)
        if k == 0:
            return 0
        proven = _proven(s, first, second, k, edge, enough)
        if proven:
            answer(s, first, second, line, simplex, proven)
            return proven
    return 0


@small_kernel
def cross(a: Vec, x: float, y: float, z: float) -> tuple[float, float, float]:
    """ω × (x, y, z) for the angular part of a twist."""
    return a[4] * z - a[5] * y, a[5] * x - a[3] * z, a[3] * y - a[4] * x


@small_kernel
def velocity(twist: Vec, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Of a point of a body with this twist (6,): linear about the world's origin, angular."""
    u, v, w = cross(twist, x, y, z)
    return twist[0] + u, twist[1] + v, twist[2] + w


@small_kernel
def acceleration(twist: Vec, bias: Vec, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Of a point of a body with this twist, whose derivative is ``bias`` (6,)."""
    a, b, c = velocity(bias, x, y, z)
    u, v, w = velocity(twist, x, y, z)
    u, v, w = cross(twist, u, v, w)
    return a + u, b + v, c + w


@small_kernel
def _foot(s: Bodies, shape: int, side: int, k: int) -> tuple[float, float, float]:
    """The nearest point of a core in the world."""
    R, o, x, y, z = s.placement[shape], 3 * side, 0.0, 0.0, 0.0
    for at in range(k):
        x += s.share[at] * s.P[at, o]
        y += s.share[at] * s.P[at, o + 1]
        z += s.share[at] * s.P[at, o + 2]
    return (
        R[0] * x + R[3] * y + R[6] * z + R[9],
        R[1] * x + R[4] * y + R[7] * z + R[10],
        R[2] * x + R[5] * y + R[8] * z + R[11],
    )


@kernel
def bending(s: Bodies, first: int, second: int, simplex: Mat, k: int, twist: Mat, bias: Mat) -> float:
    """d̈ of a pair that :func:`distance` has measured with k rows of ``simplex``; NaN: unknown.

    ``twist`` (n, 6) has the twists of all shapes about the world's origin, ``bias`` (n, 6) their derivatives.

    A diagonal of a face is no feature by itself: the nearest points may leave it for the rest of the face. So the
    corner that is furthest ``_LASTS`` from now, as the shapes are turned then, joins the feature. It does not join if
    the nearest point will have passed it by then, as where two corners of a mesh are almost one.
    """
    begin(s, first, second, simplex, k)
    if not nearest(s, k):
        return nan
    A, B, bent = twist[first], twist[second], nan
    x, y, z = point(s, k)
    d = sqrt(x * x + y * y + z * z)
    p, q, r = _foot(s, first, 0, k)
    u, v, w = velocity(A, p, q, r)
    a, b, c = acceleration(A, bias[first], p, q, r)
    p, q, r = _foot(s, second, 1, k)
    e, f, g = velocity(B, p, q, r)
    u, v, w = u - e, v - f, w - g
    e, f, g = acceleration(B, bias[second], p, q, r)
    nearing = (x * u + y * v + z * w) / d
    straight = u * u + v * v + w * w - nearing * nearing + x * (a - e) + y * (b - f) + z * (c - g)
    joined = False
    while True:
        m = _linearise(s, first, second, k, x, y, z)
        for i in range(m):
            F, S = s.along[0, i], s.along[1, i]
            a, b, c = cross(A, F[0], F[1], F[2])
            e, f, g = cross(B, S[0], S[1], S[2])
            mixed = (F[0] - S[0]) * u + (F[1] - S[1]) * v + (F[2] - S[2]) * w
            s.hessian[i, 4] = s.hessian[i, 5] = mixed + x * (a - e) + y * (b - f) + z * (c - g)
        if not _solve(s, m):
            return bent
        if joined and not 0.0 <= -_LASTS * s.hessian[k - 2, 4] <= 1.0:
            return bent
        follows, a, b, c = 0.0, u, v, w
        for i in range(m):
            moves, F, S = s.hessian[i, 4], s.along[0, i], s.along[1, i]
            follows += moves * s.hessian[i, 5]
            a, b, c = a - moves * (F[0] - S[0]), b - moves * (F[1] - S[1]), c - moves * (F[2] - S[2])
        bent = (straight - follows) / d
        if k == 3:
            return bent
        for side in range(2):
            shape, sign = second if side else first, 1.0 if side else -1.0
            e, f, g = cross(twist[shape], x, y, z)
            support(
                s, shape, side, sign * (x + _LASTS * (a - e)), sign * (y + _LASTS * (b - f)),
                sign * (z + _LASTS * (c - g)), k,
            )  # fmt: skip
            if _turns(s, shape, side):
                s.P[k, 3 * side], s.P[k, 3 * side + 1] = s.P[0, 3 * side], s.P[0, 3 * side + 1]
        join(s, first, second, k)
        s.share[k] = 0.0
        if not _joins(s, k):
            return bent
        k, joined = k + 1, True


@small_kernel
def carried(line: Vec, A: Vec, bias_A: Vec, B: Vec, bias_B: Vec) -> float:
    """f̈ of f = n·(b − a), with the points a and b of a line as parts of the shapes, and n turning with both by half."""
    x, y, z = line[1], line[2], line[3]
    u, v, w = velocity(A, line[4], line[5], line[6])
    p, q, r = velocity(B, line[7], line[8], line[9])
    p, q, r = p - u, q - v, r - w
    u, v, w = acceleration(A, bias_A, line[4], line[5], line[6])
    a, b, c = acceleration(B, bias_B, line[7], line[8], line[9])
    bent: float = x * (a - u) + y * (b - v) + z * (c - w)
    u, v, w = cross(A, x, y, z)
    a, b, c = cross(B, x, y, z)
    e, f, g = 0.5 * (u + a), 0.5 * (v + b), 0.5 * (w + c)  # the derivative of n
    bent += 2.0 * (e * p + f * q + g * r)
    u, v, w = cross(A, u, v, w)
    a, b, c = cross(B, a, b, c)
    p, q, r = cross(bias_A, x, y, z)
    u, v, w = u + p, v + q, w + r
    p, q, r = cross(bias_B, x, y, z)
    u, v, w = 0.5 * (u + a + p), 0.5 * (v + b + q), 0.5 * (w + c + r)
    grows = x * u + y * v + z * w + e * e + f * f + g * g
    u, v, w = u - grows * x, v - grows * y, w - grows * z  # its second derivative
    bent += u * (line[7] - line[4]) + v * (line[8] - line[5]) + w * (line[9] - line[6])
    return bent
