"""Which pairs of shapes are near, without measuring those that cannot be.

    way_i     how far any point of shape i can have come in all: the sum of |Δp| + ‖ΔR‖ radius over readings
    d >= d' − (way_i − way_i') − (way_j − way_j')      with d' the distance when it was measured, at way'

holds along any motion, jumps too: points of two shapes come nearer by no more than they move. A rotation by φ moves a
unit vector by 2 sin φ/2 at most, which is ‖ΔR‖, the Frobenius norm of ΔR over √2.

Of a pair there is one line, through the nearest points, and where it is close others through points that are near too;
see :mod:`wbc.models.compiled.turned`. Line j of pair k has the number k ``LINES`` + j.
"""

from __future__ import annotations

from math import inf, isnan, nan, sqrt
from typing import NamedTuple

from wbc.compiled import carray, entry, floats, integers, kernel, small_kernel
from wbc.models.compiled.gjk import Bodies, bodies, distance
from wbc.models.compiled.turned import NEAR, TURNS, turned
from wbc.types import Index, Mat, Vec

#: Rounding of sums of ways [m].
_ROUNDING = 1e-9
#: Shapes of two links count up to this share of the reach further apart than the nearest shapes of the two.
BESIDE = 0.5

#: Lines of a pair at most.
LINES = 1 + TURNS

#: What ``sizes[4]`` says before a measurement.
BEGIN, AGAIN = -1, -2


class Pairs(NamedTuple):
    """m pairs of n shapes of links, in so many pairs of links."""

    pair: Index  # (m, 2): shapes
    links: Index  # (m): pair of links
    measured: Vec  # (m): d' + way'
    felt: Vec  # (m): distance up to which a pair is looked for
    least: Vec  # (m LINES): no distance is smaller than this
    order: Index  # (m): pairs that may be near, the nearest first
    distance: Vec  # (m): of this reading, or inf
    nearest: Vec  # (pairs of links): the smallest of these of two links
    line: Mat  # (m LINES + 1, 10): distance, normal, nearest points; the last row is for :func:`again`
    simplex: Mat  # (m + 1, 4, 8): the last row too
    corners: Index  # (m): of the simplex
    start: Mat  # (m, 4, 8): what every search begins with, from the first reading
    starts: Index  # (m): how many; −1 before the first
    found: Index  # (m LINES)
    force: Mat  # (m LINES, 6): lines of force of what was found
    way: Vec  # (n)
    last: Mat  # (n, 12): placements of the reading before
    radius: Vec  # (n): of a ball about the middle of a shape that holds it
    twist: Mat  # (n, 6): linear about the world's origin, angular
    numbers: Vec  # reach, margin, ahead, the distance up to which a pair is close
    sizes: Index  # n, m, pairs of links | candidates, done, found, whether speeds count


@small_kernel
def pairs(at: int) -> Pairs:
    """The arrays whose addresses are at ``at``, in the order of :class:`Pairs`, behind those of the bodies."""
    a = carray(integers(at), 22)
    s = carray(integers(a[21]), 7)
    n, m, n_links = s[0], s[1], s[2]
    return Pairs(
        carray(integers(a[1]), (m, 2)), carray(integers(a[2]), m), carray(floats(a[3]), m), carray(floats(a[4]), m),
        carray(floats(a[5]), m * LINES), carray(integers(a[6]), m), carray(floats(a[7]), m),
        carray(floats(a[8]), n_links), carray(floats(a[9]), (m * LINES + 1, 10)),
        carray(floats(a[10]), (m + 1, 4, 8)), carray(integers(a[11]), m),
        carray(floats(a[12]), (m, 4, 8)), carray(integers(a[13]), m), carray(integers(a[14]), m * LINES),
        carray(floats(a[15]), (m * LINES, 6)), carray(floats(a[16]), n), carray(floats(a[17]), (n, 12)),
        carray(floats(a[18]), n), carray(floats(a[19]), (n, 6)), carray(floats(a[20]), 4), s,
    )  # fmt: skip


@small_kernel
def _copy(simplex: Mat, to: Mat) -> None:
    for c in range(4):
        for i in range(8):
            to[c, i] = simplex[c, i]


@kernel
def _move(s: Pairs, b: Bodies) -> None:
    """The way that each shape has come since the reading before."""
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
        u = B[0] - A[0] + y * at[11] - z * at[10]
        v = B[1] - A[1] + z * at[9] - x * at[11]
        w = B[2] - A[2] + x * at[10] - y * at[9]
        most = sqrt(u * u + v * v + w * w) + sqrt(x * x + y * y + z * z) * s.radius[s.pair[k, 1]]
        s.felt[k] = max(reach, margin + 2.0 * ahead * most)


@kernel
def _start(s: Pairs, b: Bodies) -> None:
    """The pairs that may be near, in order."""
    _move(s, b)
    _feel(s, b)
    for i in range(len(s.nearest)):
        s.nearest[i] = inf
    count = 0
    for k in range(len(s.pair)):
        s.least[k] = s.measured[k] - s.way[s.pair[k, 0]] - s.way[s.pair[k, 1]] - _ROUNDING
        s.distance[k] = inf
        if s.least[k] < s.felt[k]:
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
    if d < s.felt[k]:
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
        nearing = 0.0
        for i in range(3):
            nearing -= main[1 + i] * (B[i] - A[i])
        nearing -= (main[5] * main[3] - main[6] * main[2]) * x
        nearing -= (main[6] * main[1] - main[4] * main[3]) * y
        nearing -= (main[4] * main[2] - main[5] * main[1]) * z
        close = max(close, s.numbers[1] + ahead * nearing + turn * size)
    if main[0] >= close:
        return 1
    return turned(b, first, second, lines, s.simplex[k], s.simplex[spare], s.corners[k], turn, turns, size)


@kernel
def _collect(s: Pairs, b: Bodies) -> None:
    """The lines of what is near enough, by number, with their forces."""
    beside, count = BESIDE * s.numbers[0], 0
    for k in range(len(s.pair)):
        if s.distance[k] < inf and s.distance[k] <= s.nearest[s.links[k]] + beside:
            for i in range(k * LINES, k * LINES + _lines(s, b, k)):
                line, force = s.line[i], s.force[count]
                force[0], force[1], force[2] = line[1], line[2], line[3]
                x, y, z = 0.5 * (line[4] + line[7]), 0.5 * (line[5] + line[8]), 0.5 * (line[6] + line[9])
                force[3], force[4], force[5] = (
                    y * line[3] - z * line[2],
                    z * line[1] - x * line[3],
                    x * line[2] - y * line[1],
                )
                s.found[count] = i
                count += 1
    s.sizes[5] = count


@small_kernel
def _carried(old: Vec, new: Vec, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Where a point is that moves with a placement."""
    x, y, z = x - old[9], y - old[10], z - old[11]
    a = old[0] * x + old[1] * y + old[2] * z
    b = old[3] * x + old[4] * y + old[5] * z
    c = old[6] * x + old[7] * y + old[8] * z
    return (
        new[0] * a + new[3] * b + new[6] * c + new[9],
        new[1] * a + new[4] * b + new[7] * c + new[10],
        new[2] * a + new[5] * b + new[8] * c + new[11],
    )


@small_kernel
def _turned_with(old: Vec, new: Vec, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A direction that turns with a placement."""
    p, q, r = _carried(old, new, x + old[9], y + old[10], z + old[11])
    return p - new[9], q - new[10], r - new[11]


@small_kernel
def _along(s: Pairs, b: Bodies, first: int, second: int, line: Vec) -> float:
    """How far the points of a line are apart in its direction, which turns with both shapes by half, as placed now."""
    old, new, last, here = s.last[first], b.placement[first], s.last[second], b.placement[second]
    x, y, z = _carried(old, new, line[4], line[5], line[6])
    u, v, w = _carried(last, here, line[7], line[8], line[9])
    a0, a1, a2 = _turned_with(old, new, line[1], line[2], line[3])
    b0, b1, b2 = _turned_with(last, here, line[1], line[2], line[3])
    a0, a1, a2 = a0 + b0, a1 + b1, a2 + b2
    return ((u - x) * a0 + (v - y) * a1 + (w - z) * a2) / sqrt(a0 * a0 + a1 * a1 + a2 * a2)


@kernel
def _again(s: Pairs, b: Bodies) -> int:
    """Measure the first ``sizes[5]`` of ``found`` as the shapes are placed now: the distances to ``least``.

    Searches start from the answers of the reading, which stay. What has to be measured otherwise is NaN; how many are.
    Where the nearest points slide, others become the nearest, and all lines of the pair come nearer by that ``slip``.
    Where they pass each other, they get further apart than along the normal, which others need not do.
    """
    spare, left, measured, slip = len(s.pair), 0, -1, 0.0
    here, d = s.line[spare * LINES], 0.0
    for i in range(s.sizes[5]):
        k, own = s.found[i] // LINES, s.found[i] % LINES
        first, second, main = s.pair[k, 0], s.pair[k, 1], s.line[k * LINES]
        if measured != k:
            _copy(s.simplex[k], s.simplex[spare])
            done = distance(b, first, second, here, s.simplex[spare], s.corners[k])
            d, measured = here[0] if done else nan, k
            slip = min(d - _along(s, b, first, second, main), 0.0) if done else 0.0
        if own:
            s.least[i] = _along(s, b, first, second, s.line[s.found[i]]) + slip
        else:
            s.least[i] = d
            left += isnan(d)
    return left


@entry
def measure(at: int) -> int:
    """Measure, the nearest first. A pair that has to be measured otherwise is handed out; −1 at the end.

    ``sizes[4]`` says what is done: ``BEGIN``, a reading begins; ``AGAIN``, what was found is measured again, see
    :func:`_again`; or how many candidates are, the last of which was handed out and has its ``line`` now.
    """
    s, b = pairs(at), bodies(carray(integers(at), 1)[0])
    if s.sizes[4] == AGAIN:
        return _again(s, b)
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
            return int(k)
        _note(s, k)
    _collect(s, b)
    return -1
