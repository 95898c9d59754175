"""Which pairs of shapes are near, without measuring those that cannot be.

    way_i     how far any point of shape i can have come in all: the sum of |Δp| + ‖ΔR‖ radius over readings
    d >= d' − (way_i − way_i') − (way_j − way_j')      with d' the distance when it was measured, at way'

holds along any motion, jumps too: points of two shapes come nearer by no more than they move. A rotation by φ moves a
unit vector by 2 sin φ/2 at most, which is ‖ΔR‖, the Frobenius norm of ΔR over √2.

No NaN hides a pair: a way that is none, or so long that it is rounded, has all pairs measured again; a pair is left out
where its distance is large enough, not where it is not small enough.

Of a pair there is one line, through the nearest points, and where it is close others through points that are near too;
see :mod:`wbc.models.compiled.turned`. Line j of pair k has the number k ``LINES`` + j.

A link moves with its parent and by the velocities of its joint, which keep their directions in its own axes, so that
with the twist V = [v, ω] of each about the world's origin

    V_i = V_parent + J_i v_i,    V̇_i = V̇_parent + V_parent × V_i    at a = 0

The drift of a line is f̈, that of its points as parts of the links (:func:`~wbc.models.compiled.features.carried`). The
nearest points also slide along the shapes: d̈ − f̈ is added to the drift of their line. Where that is negative, other
points come nearer than those of the lines, and it is added to the other lines of the pair too.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, entry, kernel, small_kernel
from wbc.models.compiled.features import bending, carried, cross, distance, velocity
from wbc.models.compiled.gjk import Bodies, bodies
from wbc.models.compiled.turned import NEAR, TURNS, turned
from wbc.types import Index, Mat, Vec

#: Rounding of sums of ways [m].
_ROUNDING = 1e-9
#: Ways up to here [m] are rounded by less.
_FAR = 1e6
#: Shapes of two links count up to this share of the reach further apart than the nearest shapes of the two.
BESIDE = 0.5

#: Lines of a pair at most.
LINES = 1 + TURNS

#: What ``sizes[4]`` says before a measurement.
BEGIN = -1
#: Sliding adds at most so much [1/m] times the largest velocity squared. What adds more is over within a tick.
_MOST_CURVATURE = 30.0


class Pairs(NamedTuple):
    """m pairs of n shapes of links, in so many pairs of links."""

    pair: Annotated[Index, "m, 2"]  # shapes
    links: Annotated[Index, "m"]  # pair of links
    measured: Annotated[Vec, "m"]  # d' + way'
    felt: Annotated[Vec, "m"]  # distance up to which a pair is looked for
    least: Annotated[Vec, "m"]  # no distance is smaller than this
    order: Annotated[Index, "m"]  # pairs that may be near, the nearest first
    distance: Annotated[Vec, "m"]  # of this reading, or inf
    nearest: Annotated[Vec, "sizes[2]"]  # the smallest of these of two links
    line: Annotated[Mat, "lines, 10"]  # distance, normal, nearest points
    simplex: Annotated[Mat, "m + 1, 4, 8"]  # the last row is memory
    corners: Annotated[Index, "m"]  # of the simplex
    start: Annotated[Mat, "m, 4, 8"]  # what every search begins with, from the first reading
    starts: Annotated[Index, "m"]  # how many; −1 before the first
    found: Annotated[Index, "lines"]
    force: Annotated[Mat, "lines, 6"]  # lines of force of what was found
    drift: Annotated[Vec, "lines"]  # second derivatives of what was found at a = 0
    soon: Annotated[Vec, "lines"]  # how near what was found will be after ``ahead``
    way: Annotated[Vec, "n"]
    last: Annotated[Mat, "n, 12"]  # placements of the reading before
    radius: Annotated[Vec, "n"]  # of a ball about the middle of a shape that holds it
    twist: Annotated[Mat, "n, 6"]  # of shapes, linear about the world's origin, angular
    bias: Annotated[Mat, "n, 6"]  # their derivatives at a = 0
    own: Annotated[Mat, "n, 12"]  # twist and derivative of shapes that are no robot's
    carrier: Annotated[Index, "n"]  # the joint that moves a shape; 0: none
    parent: Annotated[Index, "joints"]  # of each joint, 0 for the world
    begin: Annotated[Index, "joints + 1"]  # where each joint's velocities begin
    columns: Annotated[Mat, "nv, 6"]  # twist of what moves with a velocity of 1
    v: Annotated[Vec, "nv"]
    joints: Annotated[Mat, "joints, 12"]  # twists and derivatives
    moved: Annotated[Mat, "n, nv"]  # 1 for each velocity that moves a shape
    numbers: Annotated[Vec, "4"]  # reach, margin, ahead, the distance up to which a pair is close
    # n, m, pairs of links | candidates, done, found, whether speeds count | joints, nv | where the bodies are
    sizes: Annotated[Index, "10"]


LAYOUT = Layout(Pairs, n="sizes[0]", m="sizes[1]", lines=f"{LINES} * m", joints="sizes[7]", nv="sizes[8]")
#: In a kernel: the arrays at an address.
pairs = LAYOUT.views


@small_kernel
def _copy(simplex: Mat, to: Mat) -> None:
    for c in range(4):
        for i in range(8):
            to[c, i] = simplex[c, i]


@kernel
def _move(s: Pairs, b: Bodies) -> None:
    """The way that each shape has come since the reading before; all begins anew where a sum would be rounded."""
    lost = False
    for i in range(len(s.way)):
        new, old = b.placement[i], s.last[i]
        turned = moved = 0.0
        for c in range(9):
            turned += (new[c] - old[c]) ** 2
        for c in range(9, 12):
            moved += (new[c] - old[c]) ** 2
        for c in range(12):
            old[c] = new[c]
        s.way[i] += sqrt(moved) + sqrt(0.5 * turned) * s.radius[i]
        lost |= not s.way[i] <= _FAR
    if lost:
        for i in range(len(s.way)):
            s.way[i] = 0.0
        for k in range(len(s.measured)):
            s.measured[k] = -inf


@kernel
def _swing(s: Pairs) -> None:
    """Twists of all shapes, and their derivatives at a = 0."""
    for j in range(1, len(s.parent)):
        own, P = s.joints[j], s.joints[s.parent[j]]
        for i in range(6):
            own[i], own[6 + i] = P[i], P[6 + i]
        for k in range(s.begin[j], s.begin[j + 1]):
            for i in range(6):
                own[i] += s.columns[k, i] * s.v[k]
        u, v, w = cross(P, own[0], own[1], own[2])
        x, y, z = cross(own, P[0], P[1], P[2])
        own[6], own[7], own[8] = own[6] + u - x, own[7] + v - y, own[8] + w - z
        u, v, w = cross(P, own[3], own[4], own[5])
        own[9], own[10], own[11] = own[9] + u, own[10] + v, own[11] + w
    for k in range(len(s.carrier)):
        J = s.joints[s.carrier[k]]
        for i in range(6):
            s.twist[k, i], s.bias[k, i] = J[i] + s.own[k, i], J[6 + i] + s.own[k, 6 + i]


@kernel
def _feel(s: Pairs, b: Bodies) -> None:
    """The distance up to which each pair is looked for: the reach, or what its fastest approach takes to stop."""
    reach, margin, ahead = s.numbers[0], s.numbers[1], s.numbers[2]
    for k in range(len(s.felt)):
        s.felt[k] = reach
    if not s.sizes[6]:
        return
    for k in range(len(s.pair)):
        A, B, at = s.twist[s.pair[k, 0]], s.twist[s.pair[k, 1]], b.placement[s.pair[k, 1]]
        x, y, z = B[3] - A[3], B[4] - A[4], B[5] - A[5]
        u, v, w = velocity(B, at[9], at[10], at[11])
        a, c, e = velocity(A, at[9], at[10], at[11])
        u, v, w = u - a, v - c, w - e
        most = sqrt(u * u + v * v + w * w) + sqrt(x * x + y * y + z * z) * s.radius[s.pair[k, 1]]
        s.felt[k] = max(reach, margin + 2.0 * ahead * most)


@kernel
def _start(s: Pairs, b: Bodies) -> None:
    """The pairs that may be near, in order."""
    _move(s, b)
    _swing(s)
    _feel(s, b)
    for i in range(len(s.nearest)):
        s.nearest[i] = inf
    count = 0
    for k in range(len(s.pair)):
        s.least[k] = s.measured[k] - s.way[s.pair[k, 0]] - s.way[s.pair[k, 1]] - _ROUNDING
        s.distance[k] = inf
        if not s.least[k] >= s.felt[k]:
            i = count
            while i > 0 and s.least[s.order[i - 1]] > s.least[k]:
                s.order[i] = s.order[i - 1]
                i -= 1
            s.order[i] = k
            count += 1
    s.sizes[3], s.sizes[4] = count, 0


@kernel
def _note(s: Pairs, k: int) -> None:
    """Pair k has been measured."""
    d = s.line[k * LINES, 0]
    s.measured[k] = d + s.way[s.pair[k, 0]] + s.way[s.pair[k, 1]]
    if not d >= s.felt[k]:
        s.distance[k] = d
        s.nearest[s.links[k]] = min(s.nearest[s.links[k]], d)


@kernel
def _lines(s: Pairs, b: Bodies, k: int) -> int:
    """How many lines pair k has; those behind the first are found here.

    Points to the side come nearer faster than the nearest, by what the shapes turn. While accelerations are decided, so
    that they turn at what they turn at now, a pair is close as soon as one of them could be that has to slow down.
    """
    first, second, at, spare = s.pair[k, 0], s.pair[k, 1], k * LINES, len(s.pair)
    if s.numbers[3] == -inf or b.round[first] > 0.0 or b.round[second] > 0.0:
        return 1
    lines, size, close = s.line[at : at + LINES], 2.0 * min(s.radius[first], s.radius[second]), s.numbers[3]
    main, turn, turns = lines[0], 0.0, NEAR + NEAR // 2
    if s.sizes[6]:
        A, B, ahead = s.twist[first], s.twist[second], s.numbers[2]
        x, y, z = B[3] - A[3], B[4] - A[4], B[5] - A[5]
        about = main[1] * x + main[2] * y + main[3] * z
        turn, turns = ahead * sqrt(max(x * x + y * y + z * z - about * about, 0.0)), TURNS
        u, v, w = velocity(A, main[4], main[5], main[6])
        a, c, e = velocity(B, main[4], main[5], main[6])
        nearing = main[1] * (u - a) + main[2] * (v - c) + main[3] * (w - e)
        close = max(close, s.numbers[1] + ahead * nearing + turn * size)
    if main[0] >= close:
        return 1
    return turned(b, first, second, lines, s.simplex[k], s.simplex[spare], s.corners[k], turn, turns, size)


@kernel
def _fastest(s: Pairs, b: Bodies) -> float:
    """The largest velocity of a joint, or of an obstacle about its middle [rad/s, m/s]."""
    most = 0.0
    for i in range(len(s.v)):
        most = max(most, abs(s.v[i]))
    for k in range(len(s.own)):
        V, at = s.own[k], b.placement[k]
        x, y, z = velocity(V, at[9], at[10], at[11])
        most = max(most, abs(x), abs(y), abs(z), abs(V[3]), abs(V[4]), abs(V[5]))
    return most


@kernel
def _bend(s: Pairs, b: Bodies, k: int, most: float, begin: int, end: int) -> None:
    """The drifts of what was found from ``begin`` to ``end``: all lines of pair k."""
    first, second, slides = s.pair[k, 0], s.pair[k, 1], 0.0
    A, B, bias_A, bias_B = s.twist[first], s.twist[second], s.bias[first], s.bias[second]
    for i in range(begin, end):
        s.drift[i] = carried(s.line[s.found[i]], A, bias_A, B, bias_B)
    if s.corners[k]:
        slides = bending(b, first, second, s.simplex[k], s.corners[k], s.twist, s.bias) - s.drift[begin]
        if not abs(slides) <= most:  # or NaN
            slides = 0.0
    s.drift[begin] += slides
    for i in range(begin + 1, end):
        s.drift[i] += min(slides, 0.0)


@kernel
def _pull(s: Pairs, k: int, begin: int, end: int) -> int:
    """The lines of force from ``begin`` to ``end``, of pair k, and how near each will be.

    With speeds what can stop in time is left out. Returns where the others end.
    """
    reach, margin, ahead = s.numbers[0], s.numbers[1], s.numbers[2]
    A, B, kept = s.twist[s.pair[k, 0]], s.twist[s.pair[k, 1]], begin
    for i in range(begin, end):
        line, force, speed = s.line[s.found[i]], s.force[kept], 0.0
        x, y, z = 0.5 * (line[4] + line[7]), 0.5 * (line[5] + line[8]), 0.5 * (line[6] + line[9])
        force[0], force[1], force[2] = line[1], line[2], line[3]
        force[3], force[4] = y * line[3] - z * line[2], z * line[1] - x * line[3]
        force[5] = x * line[2] - y * line[1]
        for c in range(6):
            speed += force[c] * (B[c] - A[c])
        if not s.sizes[6] or not line[0] >= max(margin - 2.0 * ahead * speed, reach):
            s.found[kept], s.drift[kept], s.soon[kept] = s.found[i], s.drift[i], line[0] + ahead * speed
            kept += 1
    return kept


@kernel
def _collect(s: Pairs, b: Bodies) -> None:
    """The lines of what is near enough, by number."""
    beside, count = BESIDE * s.numbers[0], 0
    most = _MOST_CURVATURE * _fastest(s, b) ** 2 if s.sizes[6] else 0.0
    for k in range(len(s.pair)):
        if s.distance[k] != inf and not s.distance[k] > s.nearest[s.links[k]] + beside:
            end = count + _lines(s, b, k)
            for i in range(count, end):
                s.found[i] = k * LINES + i - count
            if s.sizes[6]:
                _bend(s, b, k, most, count, end)
            count = _pull(s, k, count, end)
    s.sizes[5] = count


@kernel
def _between_balls(s: Pairs, b: Bodies, k: int) -> float:
    """The distance of balls that hold the shapes of pair k: theirs is no smaller."""
    first, second = s.pair[k, 0], s.pair[k, 1]
    A, B = b.placement[first], b.placement[second]
    between = sqrt((A[9] - B[9]) ** 2 + (A[10] - B[10]) ** 2 + (A[11] - B[11]) ** 2)
    return float(between - s.radius[first] - s.radius[second])


@entry
def measure(at: int) -> int:
    """Measure, the nearest first. A pair that has to be measured otherwise is handed out; −1 at the end.

    ``sizes[4]`` says what is done: ``BEGIN``, a reading begins; or how many candidates are, the last of which was
    handed out and has its ``line`` now.
    """
    s = pairs(at)
    b = bodies(s.sizes[9])
    if s.sizes[4] == BEGIN:
        _start(s, b)
    else:
        _note(s, s.order[s.sizes[4] - 1])
    beside = BESIDE * s.numbers[0]
    while s.sizes[4] < s.sizes[3]:
        k = s.order[s.sizes[4]]
        s.sizes[4] += 1
        if s.least[k] > s.nearest[s.links[k]] + beside:
            continue
        _copy(s.start[k], s.simplex[k])
        s.corners[k] = distance(b, s.pair[k, 0], s.pair[k, 1], s.line[k * LINES], s.simplex[k], max(s.starts[k], 0))
        if s.starts[k] < 0:
            _copy(s.simplex[k], s.start[k])
            s.starts[k] = s.corners[k]
        if s.corners[k] == 0:
            s.line[k * LINES, 0] = _between_balls(s, b, k)
            if not s.line[k * LINES, 0] > s.felt[k]:
                return int(k)
        _note(s, k)
    _collect(s, b)
    return -1
