"""The distance of two convex shapes: the algorithm of Gilbert, Johnson and Keerthi, with a proof of what it found.

    d = min |v| over v = a − b, a in the first shape, b in the second     the shapes' *cores*; round ones add a radius
    v' = the point of the simplex [w_1 … w_k] nearest to the origin       w = a − b furthest along −v: it joins
    |v| − v·w / |v| <= ε                                                  proves that v is the nearest to ε [m]

The search starts from the shapes' middles, and so depends on nothing but where they are now. A corner of a hull that is
furthest in a direction is found by climbing from corner to corner along edges. Where shapes touch or are inside one
another, and where rounding ends the search without a proof, there is no answer.

Gilbert, Johnson, Keerthi: A fast procedure for computing the distance between complex objects in three-dimensional
space, IEEE Journal on Robotics and Automation 4(2), 1988. Cameron: Enhancing GJK, ICRA 1997 (climbing).
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from wbc.compiled import carray, floats, integers, kernel, small_kernel
from wbc.models.compiled.simplex import segment, tetrahedron, triangle
from wbc.types import Index, Mat, Vec

#: Steps at most; hulls need ten.
_STEPS = 128
#: ε with which an answer still counts where rounding ends the search [m].
ENOUGH = 1e-10
#: Cores that are nearer [m] are left to a method that knows depths.
TOUCHING = 1e-7


class Bodies(NamedTuple):
    """n convex shapes: corners of hulls (a box has 8, a ball one with a radius), and cylinders."""

    placement: Mat  # (n, 12): columns of the rotation, then the position in the world
    is_cylinder: Index  # (n)
    size: Mat  # (n, 2): radius and half the length of a cylinder
    round: Vec  # (n): radius that makes a core round
    corners: Mat  # (c, 3), one shape behind the other, each about its middle
    edges: Index  # (c + 1): where each corner's neighbours begin
    neighbours: Index
    first: Index  # (n): corner to climb from
    W: Mat  # (4, 3): corners of the simplex
    # Their points in both shapes, each in its own axes, and of both which corner of a hull that is. For a cylinder: 1
    # where the point may turn about the axis, on its side or edge; 0 inside its flat end.
    P: Mat  # (4, 8)
    share: Vec  # (4)
    before: Vec  # (4)
    held: Vec  # (12): the placement of a body while it is turned
    along: Mat  # (2, 4, 3): ∂a/∂u and ∂b/∂u, see :mod:`wbc.models.compiled.features`
    hessian: Mat  # (4, 6): g_uu, then a right side that is solved for, and its copy


@small_kernel
def bodies(at: int) -> Bodies:
    """The arrays whose addresses are at ``at``, in the order of :class:`Bodies`, behind their numbers."""
    m = carray(integers(at), 16)
    s = carray(integers(m[0]), 3)
    n, c = s[0], s[1]
    return Bodies(
        carray(floats(m[1]), (n, 12)), carray(integers(m[2]), n), carray(floats(m[3]), (n, 2)), carray(floats(m[4]), n),
        carray(floats(m[5]), (c, 3)), carray(integers(m[6]), c + 1), carray(integers(m[7]), s[2]),
        carray(integers(m[8]), n), carray(floats(m[9]), (4, 3)), carray(floats(m[10]), (4, 8)),
        carray(floats(m[11]), 4), carray(floats(m[12]), 4), carray(floats(m[13]), 12),
        carray(floats(m[14]), (2, 4, 3)), carray(floats(m[15]), (4, 6)),
    )  # fmt: skip


@small_kernel
def support(s: Bodies, shape: int, side: int, x: float, y: float, z: float, at: int) -> None:
    """The point of a shape furthest along (x, y, z), in its own axes, to ``P[at]``: first three entries or last."""
    R, P, o = s.placement[shape], s.P[at], 3 * side
    a, b, c = R[0] * x + R[1] * y + R[2] * z, R[3] * x + R[4] * y + R[5] * z, R[6] * x + R[7] * y + R[8] * z
    if s.is_cylinder[shape]:
        across = sqrt(a * a + b * b)
        outer = s.size[shape, 0] / across if across > 0.0 else 0.0
        P[o], P[o + 1], P[o + 2] = outer * a, outer * b, s.size[shape, 1] if c > 0.0 else -s.size[shape, 1]
        return
    k = int(s.P[at - 1, 6 + side]) if at else s.first[shape]
    furthest = s.corners[k, 0] * a + s.corners[k, 1] * b + s.corners[k, 2] * c
    climbs = True
    while climbs:
        climbs, here = False, k
        for e in range(s.edges[here], s.edges[here + 1]):
            i = s.neighbours[e]
            reached = s.corners[i, 0] * a + s.corners[i, 1] * b + s.corners[i, 2] * c
            if reached > furthest:
                furthest, k, climbs = reached, i, True
    P[6 + side] = k
    for i in range(3):
        P[o + i] = s.corners[k, i]


@small_kernel
def join(s: Bodies, first: int, second: int, at: int) -> None:
    """The points P of both shapes, in their own axes, become corner w of the simplex, in the world's."""
    A, B = s.placement[first], s.placement[second]
    for i in range(3):
        s.W[at, i] = (
            (A[i] * s.P[at, 0] + A[3 + i] * s.P[at, 1] + A[6 + i] * s.P[at, 2])
            - (B[i] * s.P[at, 3] + B[3 + i] * s.P[at, 4] + B[6 + i] * s.P[at, 5])
            + (A[9 + i] - B[9 + i])
        )


@small_kernel
def extend(s: Bodies, first: int, second: int, x: float, y: float, z: float, at: int) -> None:
    """The furthest point of the first shape along −(x, y, z), and of the second along (x, y, z), join the simplex."""
    for side in range(2):
        sign = 1.0 if side else -1.0
        support(s, second if side else first, side, sign * x, sign * y, sign * z, at)
    join(s, first, second, at)


@small_kernel
def nearest(s: Bodies, k: int) -> bool:
    """The shares of the k corners in their point nearest to the origin. False: the origin is inside."""
    share = s.share
    for i in range(4):
        share[i] = 0.0
    if k == 1:
        share[0] = 1.0
    elif k == 2:
        _, share[0], share[1] = segment(s.W, k - 2, k - 1)
    elif k == 3:
        _, share[0], share[1], share[2] = triangle(s.W, k - 3, k - 2, k - 1)
    else:
        return tetrahedron(s.W, share)
    return True


@small_kernel
def kept(s: Bodies, k: int) -> int:
    """Leave out the corners without a share; how many are left."""
    m = 0
    for i in range(k):
        if s.share[i] > 0.0:
            if m < i:
                s.share[m] = s.share[i]
                for j in range(3):
                    s.W[m, j] = s.W[i, j]
                for j in range(8):
                    s.P[m, j] = s.P[i, j]
            m += 1
    return m


@small_kernel
def point(s: Bodies, k: int) -> tuple[float, float, float]:
    """The simplex' point."""
    x = y = z = 0.0
    for c in range(k):
        x += s.share[c] * s.W[c, 0]
        y += s.share[c] * s.W[c, 1]
        z += s.share[c] * s.W[c, 2]
    return x, y, z


@small_kernel
def begin(s: Bodies, first: int, second: int, simplex: Mat, k: int) -> None:
    """The simplex becomes the k rows of ``simplex``, as the shapes are placed now."""
    for at in range(k):
        for i in range(8):
            s.P[at, i] = simplex[at, i]
        join(s, first, second, at)


@kernel
def search(s: Bodies, first: int, second: int, line: Vec, simplex: Mat, k: int, sharp: float) -> int:
    """``line`` (10,) becomes distance, normal from the first shape to the second, and the points nearest to each other.

    ``simplex`` (4, 8) has k rows of ``P`` to start from, and those of the answer then; ``sharp`` is ε [m].
    Returns how many; 0: there is no proof of an answer.
    """
    begin(s, first, second, simplex, k)
    if k == 0:
        A, B = s.placement[first], s.placement[second]
        extend(s, first, second, A[9] - B[9], A[10] - B[10], A[11] - B[11], k)
        k = 1
    k = _searched(s, first, second, k, sharp)
    if k:
        answer(s, first, second, line, simplex, k)
    return k


@small_kernel
def _searched(s: Bodies, first: int, second: int, k: int, sharp: float) -> int:
    """Grow the simplex of k corners until it has the nearest point; how many it has then, or 0 without a proof."""
    if not nearest(s, k):
        return 0
    k = kept(s, k)
    x, y, z = point(s, k)
    d = sqrt(x * x + y * y + z * z)
    for _ in range(_STEPS):
        if not d > TOUCHING:
            return 0
        extend(s, first, second, x, y, z, k)
        within = d - (x * s.W[k, 0] + y * s.W[k, 1] + z * s.W[k, 2]) / d
        if within <= sharp:
            return k
        for at in range(k):
            s.before[at] = s.share[at]
        if not nearest(s, k + 1):
            return 0
        u, v, w = point(s, k + 1)
        nearer = sqrt(u * u + v * v + w * w)
        # Where rounding lets the next simplex be no nearer, this one is the answer, or the next has the proof it lacks.
        if not nearer < d and within <= ENOUGH:
            for at in range(k):
                s.share[at] = s.before[at]
            return k
        k, x, y, z, d = kept(s, k + 1), u, v, w, nearer
    return 0


@small_kernel
def answer(s: Bodies, first: int, second: int, line: Vec, simplex: Mat, k: int) -> None:
    """Distance, normal and nearest points of a simplex that has them, and its rows."""
    x, y, z = point(s, k)
    d = sqrt(x * x + y * y + z * z)
    line[0] = d - s.round[first] - s.round[second]
    line[1], line[2], line[3] = -x / d, -y / d, -z / d
    for side in range(2):
        shape = second if side else first
        R, o, sign = s.placement[shape], 3 * side, -1.0 if side else 1.0
        for i in range(3):
            total = R[9 + i] + sign * s.round[shape] * line[1 + i]
            for at in range(k):
                P = s.P[at]
                total += s.share[at] * (R[i] * P[o] + R[3 + i] * P[o + 1] + R[6 + i] * P[o + 2])
            line[4 + o + i] = total
    for at in range(k):
        for i in range(8):
            simplex[at, i] = s.P[at, i]
