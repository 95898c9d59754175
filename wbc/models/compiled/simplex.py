"""The point of a segment, a triangle or a tetrahedron that is nearest to the origin, as shares of its corners.

Corners are rows of W (4, 3). Shares are >= 0 with sum 1; before them stands the squared distance.
"""

from __future__ import annotations

from math import inf

from wbc.compiled import kernel
from wbc.types import Mat, Vec


@kernel
def segment(W: Mat, i: int, j: int) -> tuple[float, float, float]:
    """Of corners i and j."""
    a, b, c = W[i, 0], W[i, 1], W[i, 2]
    x, y, z = W[j, 0] - a, W[j, 1] - b, W[j, 2] - c
    along, length = -(a * x + b * y + c * z), x * x + y * y + z * z
    if not along > 0.0:
        return a * a + b * b + c * c, 1.0, 0.0
    if along >= length:
        return W[j, 0] ** 2 + W[j, 1] ** 2 + W[j, 2] ** 2, 0.0, 1.0
    t = along / length
    return (a + t * x) ** 2 + (b + t * y) ** 2 + (c + t * z) ** 2, 1.0 - t, t


@kernel
def triangle(W: Mat, i: int, j: int, k: int) -> tuple[float, float, float, float]:
    """Of corners i, j and k: inside, where the origin is above it, else on one of its edges."""
    a, b, c = W[i, 0], W[i, 1], W[i, 2]
    e0, e1, e2 = W[j, 0] - a, W[j, 1] - b, W[j, 2] - c
    f0, f1, f2 = W[k, 0] - a, W[k, 1] - b, W[k, 2] - c
    n0, n1, n2 = e1 * f2 - e2 * f1, e2 * f0 - e0 * f2, e0 * f1 - e1 * f0
    area = n0 * n0 + n1 * n1 + n2 * n2
    if area > 0.0:
        at_j = ((c * f1 - b * f2) * n0 + (a * f2 - c * f0) * n1 + (b * f0 - a * f1) * n2) / area
        at_k = ((b * e2 - c * e1) * n0 + (c * e0 - a * e2) * n1 + (a * e1 - b * e0) * n2) / area
        if at_j > 0.0 and at_k > 0.0 and at_j + at_k < 1.0:
            height = a * n0 + b * n1 + c * n2
            return height * height / area, 1.0 - at_j - at_k, at_j, at_k
    ij, ik, jk = segment(W, i, j), segment(W, i, k), segment(W, j, k)
    if ij[0] <= ik[0] and ij[0] <= jk[0]:
        return ij[0], ij[1], ij[2], 0.0
    if ik[0] <= jk[0]:
        return ik[0], ik[1], 0.0, ik[2]
    return jk[0], 0.0, jk[1], jk[2]


@kernel
def _is_beyond(W: Mat, i: int, j: int, k: int, other: int) -> bool:
    """Whether the origin is not on the side of the triangle on which the ``other`` corner is."""
    a, b, c = W[i, 0], W[i, 1], W[i, 2]
    e0, e1, e2 = W[j, 0] - a, W[j, 1] - b, W[j, 2] - c
    f0, f1, f2 = W[k, 0] - a, W[k, 1] - b, W[k, 2] - c
    n0, n1, n2 = e1 * f2 - e2 * f1, e2 * f0 - e0 * f2, e0 * f1 - e1 * f0
    origin = -(a * n0 + b * n1 + c * n2)
    corner = (W[other, 0] - a) * n0 + (W[other, 1] - b) * n1 + (W[other, 2] - c) * n2
    return not origin * corner > 0.0


@kernel
def tetrahedron(W: Mat, share: Vec) -> bool:
    """Of all four corners: on one of the faces that the origin is beyond. False: it is inside."""
    nearest = inf
    for other in range(4):
        i, j, k = 1 if other == 0 else 0, 2 if other <= 1 else 1, 2 if other == 3 else 3
        if _is_beyond(W, i, j, k, other):
            d, at_i, at_j, at_k = triangle(W, i, j, k)
            if d < nearest:
                nearest = d
                share[i], share[j], share[k], share[other] = at_i, at_j, at_k, 0.0
    return nearest < inf
