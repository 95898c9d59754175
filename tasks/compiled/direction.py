"""Rows about where an axis of a frame points: seen from the frame, or on the map."""

from __future__ import annotations

from math import acos, atan2, cos, floor, pi, sin, sqrt
from typing import Any

from wbc.compiled import callee, kernel, small_kernel
from wbc.stack.compiled.geometry import SHORTEST, Three, cross, dot, plus, scaled, three, times
from wbc.stack.compiled.row_kernel import Rows, rows
from wbc.tolerances import SAME

#: Straight behind no way round is shortest: a direction nearer to it than this [rad] counts as this far beside it.
_BEHIND = 0.01
#: θ / sin θ = Σ 2ⁿ (n!)² / (2n + 1)! xⁿ with x = 1 − cos θ, for small x.
_SERIES = (1.0, 1 / 3, 2 / 15, 2 / 35, 8 / 315, 8 / 693, 16 / 3003, 16 / 6435, 128 / 109395, 128 / 230945)


@kernel
def _angle_over_sine(c: float) -> Three:
    """θ / sin θ for c = cos θ, and its first two derivatives by c: (1 − c²) f' = c f − 1, and once more."""
    x = 1.0 - c
    if x < 0.05:
        f, df, ddf = 0.0, 0.0, 0.0
        for k in range(9, -1, -1):  # Horner's scheme; ddf is half the second derivative
            ddf = ddf * x + df
            df = df * x + f
            f = f * x + _SERIES[k]
        return f, -df, 2.0 * ddf
    squared = 1.0 - c * c
    f = acos(c) / sqrt(squared)
    f1 = (c * f - 1.0) / squared
    return f, f1, (f + 3.0 * c * f1) / squared


@kernel
def unit_motion(x: Any, rate: Any, second: Any, nearest: float) -> tuple[Three, Three, Three, float]:
    """u = x / |x|, u̇, ü and |x| for ẋ and ẍ; x / nearest where |x| < nearest, and 0 then.

    u̇ = P ẋ / r, P = I − u uᵀ; ü = (ẍ − r̈ u − 2 ṙ u̇) / r, ṙ = u·ẋ, r̈ = u·ẍ + (|ẋ|² − ṙ²) / r.
    """
    r = sqrt(dot(x, x))
    if r < nearest:
        s = 1.0 / nearest
        return scaled(s, x), scaled(s, rate), scaled(s, second), 0.0
    u = scaled(1.0 / r, x)
    r_rate = dot(u, rate)
    r_second = dot(u, second) + (dot(rate, rate) - r_rate**2) / r
    du = scaled(1.0 / r, plus(rate, -r_rate, u))
    ddu = scaled(1.0 / r, plus(plus(second, -r_second, u), -2.0 * r_rate, du))
    return u, du, ddu, r


@small_kernel
def _bearing(k: Rows, direction: Any, d_rate: Any, d_second: Any, t_rate: Any, t_second: Any) -> tuple[Three, Three]:
    """Two rows of where a direction d (with a = 0) lies for a frame with the axes ``numbers`` (9), as it turns.

    e = f u₁₂, u the direction in these axes, f = θ / sin θ, θ its angle to the third. ``t_rate`` and ``t_second`` are
    what the target alone does to d. Seen from a frame that turns with ω

        u̇' = u̇ − ω × u          ü' = ü − ω̇ × u − 2 ω × u̇ + ω × (ω × u)

    Target and robot do not simply add up (ω × u̇), so the drift holds what is common to both. Returns ∂e/∂d, row by row.
    """
    R = k.place[0]
    b1, b2, a = times(R, three(k.numbers, 0)), times(R, three(k.numbers, 3)), times(R, three(k.numbers, 6))
    s0, s1, c = dot(b1, direction), dot(b2, direction), dot(a, direction)
    if c < -cos(_BEHIND):
        length = sqrt(s0 * s0 + s1 * s1)
        s0, s1 = (sin(_BEHIND) * s0 / length, sin(_BEHIND) * s1 / length) if length > 0.0 else (sin(_BEHIND), 0.0)
        c = -cos(_BEHIND)
    f, f1, f2 = _angle_over_sine(c)
    g0, g1 = plus(scaled(f, b1), f1 * s0, a), plus(scaled(f, b2), f1 * s1, a)
    w = three(k.motion[0], 3)
    seen = plus(d_rate, -1.0, cross(w, direction))
    second = plus(d_second, -1.0, cross(w, plus(d_rate, 1.0, seen)))
    for i in range(2):
        s, b, g = (s0, b1, g0) if i == 0 else (s1, b2, g1)
        k.e[i] = f * s
        turn = cross(direction, g)
        k.C[i, 3], k.C[i, 4], k.C[i, 5] = turn[0], turn[1], turn[2]
        k.rate_ref[i] = dot(g, t_rate)
        along = dot(a, t_rate)
        k.acc_ref[i] = dot(g, t_second) + along * (f2 * along * s + 2.0 * f1 * dot(b, t_rate))
        along = dot(a, seen)
        k.bent[i] = k.acc_ref[i] - dot(g, second) - along * (f2 * along * s + 2.0 * f1 * dot(b, seen))
    return g0, g1


@callee
def alignment(at: int) -> int:
    """How a world direction lies beside an axis; ``numbers``: the viewer's axes by rows."""
    k = rows(at)
    u, du, ddu, _ = unit_motion(three(k.value, 0), three(k.rate, 0), three(k.second, 0), SAME)
    _bearing(k, u, du, ddu, du, ddu)
    return 1


@callee
def gaze(at: int) -> int:
    """How a point lies beside an axis; ``numbers``: the viewer's axes by rows, how near it may come."""
    k = rows(at)
    nearest, target_rate, target_second = k.numbers[9], three(k.rate, 0), three(k.second, 0)
    x = plus(three(k.value, 0), -1.0, three(k.place[0], 9))
    _, t_rate, t_second, _ = unit_motion(x, target_rate, target_second, nearest)
    u, du, ddu, r = unit_motion(x, plus(target_rate, -1.0, three(k.motion[0], 0)), target_second, nearest)
    g0, g1 = _bearing(k, u, du, ddu, t_rate, t_second)
    for i in range(2):
        g = g0 if i == 0 else g1
        toward = scaled(1.0 / r, plus(g, -dot(g, u), u)) if r > 0.0 else scaled(1.0 / nearest, g)
        k.C[i, 0], k.C[i, 1], k.C[i, 2] = toward[0], toward[1], toward[2]
    return 1


@callee
def yaw(at: int) -> int:
    """Which way an axis points on the map: ψ = atan2(u_y, u_x); ``numbers``: the axis in the frame."""
    k = rows(at)
    u, w = times(k.place[0], k.numbers), three(k.motion[0], 3)
    x, y, z = u
    shadow = max(x * x + y * y, SHORTEST**2)
    behind = k.value[0] - atan2(y, x) + pi
    k.e[0] = behind - 2.0 * pi * floor(behind / (2.0 * pi)) - pi
    # u̇ = ω × u, so x u̇_y − y u̇_x = (−x z, −y z, x² + y²) · ω
    k.C[0, 3], k.C[0, 4], k.C[0, 5] = -x * z / shadow, -y * z / shadow, (x * x + y * y) / shadow
    du = cross(w, u)
    ddu = cross(w, du)
    rate = (x * du[1] - y * du[0]) / shadow
    k.bent[0] = (x * ddu[1] - y * ddu[0] - 2.0 * rate * (x * du[0] + y * du[1])) / shadow
    k.rate_ref[0], k.acc_ref[0] = k.rate[0], k.second[0]
    return 1
