"""Points of two convex shapes that would be nearest if the shapes were turned a little against each other.

Where a face is near a face, or an edge along one, the nearest points jump across it at the slightest turn, and a bound
on these alone lets others come as near as they like. So the second shape is turned by an angle φ about axes square to
the normal n, through the middle between the nearest points, and what is nearest then is bounded as well:

    f = n·(b − a) >= d          with the points a and b where the shapes have them that are not turned

The shapes are apart by d along n, so that f >= margin asks for nothing that d >= margin does not ask for. n turns with
both shapes by half, at (ω₁ + ω₂) / 2, for which ∂f/∂q is one line of force along n through the middle between a and b.

Points x to the side of the nearest that come into question at φ are further by x φ, and come nearer by x ω faster.

A barrier of rate γ on them lets the shapes turn by γ dt φ in a tick. Six axes find what is near now, at φ = 5 mrad.
Others find what holds the turn of the next tick below that, at φ = 0.1 rad for γ dt <= 0.05.

Where velocities are decided, these are three, and no angle depends on a velocity: rows that follow from the last
decision make the next one flicker. Where accelerations are decided, ω is given. The others are six then, and if
tan φ = ω / γ is more, they find where f + ḟ / γ is least: what has no row is no faster than its barrier allows.
"""

from __future__ import annotations

from math import atan, cos, pi, sin, sqrt

from wbc.compiled import copy, kernel, small_kernel
from wbc.models.compiled.gjk import Bodies, search
from wbc.types import Mat, Vec

#: Axes about which the second shape is turned by little, and in all. Of five, each corner of a rectangle is brought
#: near by one at least.
NEAR = 6
TURNS = 2 * NEAR
#: By how much: little, and much [rad].
_LITTLE, _MUCH = 0.005, 0.1
#: Where the first axis of either lies, as a share of the angle between two: none is one of symmetry.
_FIRST, _OTHER = 0.31, 0.81
#: Shapes that are nearer [m] are lifted at least to this distance along n before they are turned.
_APART = 0.01
#: How sharp the search is, and points that are as near as this to others say the same [m].
_SHARP, _SAME = 1e-7, 2e-4


@small_kernel
def _basis(A: Vec, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A unit vector square to (x, y, z), in the plane of an axis of the shape placed by A."""
    at, least = 0, 2.0
    for i in range(3):
        along = abs(A[3 * i] * x + A[3 * i + 1] * y + A[3 * i + 2] * z)
        if along < least - 1e-3:
            at, least = 3 * i, along
    u, v, w = A[at + 1] * z - A[at + 2] * y, A[at + 2] * x - A[at] * z, A[at] * y - A[at + 1] * x
    size = 1.0 / sqrt(u * u + v * v + w * w)
    return u * size, v * size, w * size


@small_kernel
def _turned(
    x: float, y: float, z: float, p: float, q: float, r: float, c: float, s: float
) -> tuple[float, float, float]:
    """(p, q, r) turned about the unit vector (x, y, z) by the angle that has this cosine and sine."""
    along = (x * p + y * q + z * r) * (1.0 - c)
    return (
        c * p + along * x + s * (y * r - z * q),
        c * q + along * y + s * (z * p - x * r),
        c * r + along * z + s * (x * q - y * p),
    )


@small_kernel
def _is_new(lines: Mat, own: int) -> bool:
    """Whether the points of the last of ``own + 1`` lines are others than those before."""
    for i in range(own):
        apart = 0.0
        for c in range(4, 10):
            apart += (lines[own, c] - lines[i, c]) ** 2
        if apart < 2.0 * _SAME**2:
            return False
    return True


@kernel
def turned(
    s: Bodies, first: int, second: int, lines: Mat, simplex: Mat, start: Mat, corners: int,
    turn: float, turns: int, size: float,
) -> int:  # fmt: skip
    """Behind its first row, ``lines`` (1 + TURNS, 10) gets what else is near: f, its direction, and the points a and b.

    The first row has the distance, the normal and the nearest points, found with ``corners`` rows of ``simplex``;
    ``start`` is memory. The second shape is turned ``turns`` times, by much: by the angle of tangent ``turn`` at least.
    The smaller of both shapes fits in a ball of diameter ``size``. Returns how many rows there are then.
    """
    A, B, line, count = s.placement[first], s.placement[second], lines[0], 1
    n0, n1, n2 = line[1], line[2], line[3]
    u0, u1, u2 = _basis(A, n0, n1, n2)
    w0, w1, w2 = n1 * u2 - n2 * u1, n2 * u0 - n0 * u2, n0 * u1 - n1 * u0
    c0, c1, c2 = 0.5 * (line[4] + line[7]), 0.5 * (line[5] + line[8]), 0.5 * (line[6] + line[9])
    held = s.held
    copy(B, held)
    for axis in range(turns):
        if axis < NEAR:
            angle, about = _LITTLE, 2.0 * pi * (axis + _FIRST) / NEAR
        else:
            angle, about = max(_MUCH, atan(turn)), 2.0 * pi * (axis - NEAR + _OTHER) / (turns - NEAR)
        a, b, co, si = cos(about), sin(about), cos(angle), sin(angle)
        x, y, z = a * u0 + b * w0, a * u1 + b * w1, a * u2 + b * w2
        lift = max(0.0, max(_APART, size * si) - line[0])  # so that they do not touch, however they are turned
        for i in range(0, 9, 3):
            B[i], B[i + 1], B[i + 2] = _turned(x, y, z, held[i], held[i + 1], held[i + 2], co, si)
        p, q, r = _turned(x, y, z, held[9] - c0, held[10] - c1, held[11] - c2, co, si)
        B[9], B[10], B[11] = p + c0 + lift * n0, q + c1 + lift * n1, r + c2 + lift * n2
        for i in range(corners):
            for c in range(8):
                start[i, c] = simplex[i, c]
        new = lines[count]
        if search(s, first, second, new, start, corners, _SHARP):
            p, q, r = new[7] - c0 - lift * n0, new[8] - c1 - lift * n1, new[9] - c2 - lift * n2
            p, q, r = _turned(x, y, z, p, q, r, co, -si)
            new[7], new[8], new[9] = p + c0, q + c1, r + c2
            if _is_new(lines, count):
                new[1], new[2], new[3] = n0, n1, n2
                new[0] = n0 * (new[7] - new[4]) + n1 * (new[8] - new[5]) + n2 * (new[9] - new[6])
                count += 1
    copy(held, B)
    return count
