"""Rows that stay positive: where a frame or the centre of mass may be, and where an axis may point."""

from __future__ import annotations

from math import cos, sin, sqrt

from wbc.compiled import callee
from wbc.stack.compiled.geometry import NEAREST, cross, dot, plus, scaled, three, times
from wbc.stack.compiled.row_kernel import rows


@callee
def half_spaces(at: int) -> int:
    """h = n · p − offset; ``numbers``: of each row n and the offset."""
    k = rows(at)
    for r in range(len(k.e)):
        n = three(k.numbers, 4 * r)
        k.e[r] = dot(n, three(k.place[0], 9)) - k.numbers[4 * r + 3]
        k.C[r, 0], k.C[r, 1], k.C[r, 2] = n[0], n[1], n[2]
    return 1


@callee
def cone(at: int) -> int:
    """h = z sin α − r cos α; ``numbers``: apex, axis, α."""
    k = rows(at)
    axis, angle = three(k.numbers, 3), k.numbers[6]
    away, u = plus(three(k.place[0], 9), -1.0, three(k.numbers, 0)), three(k.motion[0], 0)
    height = dot(axis, away)
    beside = plus(away, -height, axis)
    r = sqrt(dot(beside, beside) + NEAREST**2)
    beside = scaled(1.0 / r, beside)
    k.e[0] = sin(angle) * height - cos(angle) * r
    gradient = plus(scaled(sin(angle), axis), -cos(angle), beside)
    k.C[0, 0], k.C[0, 1], k.C[0, 2] = gradient[0], gradient[1], gradient[2]
    # d²r/dt² of a straight line at velocity u: (|u_across|² − (∂r/∂p · u)²) / r
    across = plus(u, -dot(axis, u), axis)
    k.bent[0] = -cos(angle) * (dot(across, across) - dot(beside, u) ** 2) / r
    return 1


@callee
def axis_cone(at: int) -> int:
    """h = R a · d − cos α; ``numbers``: a, d, α."""
    k = rows(at)
    b, d, w = times(k.place[0], k.numbers), three(k.numbers, 3), three(k.motion[0], 3)
    k.e[0] = dot(b, d) - cos(k.numbers[6])
    turn = cross(b, d)  # d(b·d)/dt = (ω × b)·d = ω·(b × d)
    k.C[0, 3], k.C[0, 4], k.C[0, 5] = turn[0], turn[1], turn[2]
    k.bent[0] = dot(cross(w, cross(w, b)), d)
    return 1
