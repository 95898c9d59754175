"""A row problem written anew in order of rank, before a tick is decided, and the answer written back."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from wbc.compiled import carray, floats, integers, kernel, part, small_kernel
from wbc.qp.lexicographic.compiled.rank import BEGAN, ENDED, IS_LEAST, IS_MET, LEVELS, NOT_DECIDED, QPS, WORK, ranking
from wbc.qp.rows.compiled.search import answer
from wbc.qp.rows.compiled.work import SOLVED
from wbc.types import Index, Mat, Vec

#: A task smaller than this is met by any part of it, but its share still has a place among the others.
_LEAST_SHARE = 1e-6


class Stages(NamedTuple):
    """Views of the memory of a problem with n unknowns of which m are y, r rows and v values; then of its source."""

    G: Mat  # (r, n + 1)
    value: Vec  # (v)
    lower: Vec  # (v)
    upper: Vec  # (v)
    metric: Vec  # (m)
    centre: Vec  # (m)
    scale: Vec  # (n)
    weights: Vec  # those of the last stage
    source_G: Mat
    source_value: Vec
    source_lower: Vec
    source_upper: Vec
    source_metric: Vec
    source_centre: Vec
    source_scale: Vec
    row: Index  # (r): where each row stands in the source, −1 for those that do not
    weight: Index  # (r): address of the weight of each row, 0 where it is 1
    pulls: Index  # (p, 3): rows about one unknown: row, unknown, address of what is wanted there
    parts: Index  # (s, 7): see below
    links: Index  # (4): see below
    unit: Vec  # (1)


#: What is done in part: its first row of direction, or −1, how many there are, the unknown that says what is given up,
#: addresses of what is wanted, drift and weights, and the row of its share, or −1.
_ROW, _DIM, _UNKNOWN, _WANTED, _DRIFT, _WEIGHTS, _SHARE = range(7)


#: Addresses of the memory of the levels and of the core; the level that is hoped to be the first that is not met, and
#: the one that was tried first.
LEVELS_AT, CORE_AT, HOPE, FIRST = range(4)
#: What :func:`hoped` says where levels have to be decided one by one.
RANKED = -1


@small_kernel
def stages(at: int) -> Stages:
    """The arrays whose addresses are at ``at``, in the order of :class:`Stages`; their sizes stand behind."""
    a = carray(integers(at), 22)
    z = carray(integers(a[21]), 10)
    n, ny, rows, soft, source_n, source_y, source_rows = z[0], z[1], z[2], z[3], z[5], z[6], z[7]
    v, source_v = n + 1 + rows, source_n + 1 + source_rows
    return Stages(
        carray(floats(a[0]), (rows, n + 1)), carray(floats(a[1]), v), carray(floats(a[2]), v), carray(floats(a[3]), v),
        carray(floats(a[4]), ny), carray(floats(a[5]), ny), carray(floats(a[6]), n), carray(floats(a[7]), soft),
        carray(floats(a[8]), (source_rows, source_n + 1)), carray(floats(a[9]), source_v),
        carray(floats(a[10]), source_v), carray(floats(a[11]), source_v), carray(floats(a[12]), source_y),
        carray(floats(a[13]), source_y), carray(floats(a[14]), source_n), carray(integers(a[15]), rows),
        carray(integers(a[16]), rows), carray(integers(a[17]), (z[8], 3)), carray(integers(a[18]), (z[9], 7)),
        carray(integers(a[19]), 4), carray(floats(a[20]), 1),
    )  # fmt: skip


@kernel
def divide(s: Stages, i: int) -> None:
    """Rows of a task that may be done in part: its direction, and its share."""
    part = s.parts[i]
    dim, unknown = part[_DIM], part[_UNKNOWN]
    wanted, drift = carray(floats(part[_WANTED]), dim), carray(floats(part[_DRIFT]), dim)
    weights = carray(floats(part[_WEIGHTS]), dim)
    largest, square = 0.0, 0.0
    for j in range(dim):
        asked = wanted[j] + drift[j]
        largest, square = max(largest, abs(asked)), square + weights[j] * asked * asked
    largest = max(largest, _LEAST_SHARE)
    if part[_ROW] >= 0:
        s.lower[unknown], s.upper[unknown] = 0.0, largest
        for j in range(dim):
            s.G[part[_ROW] + j, unknown] = (wanted[j] + drift[j]) / largest
    if part[_SHARE] >= 0:
        s.G[part[_SHARE], unknown] = max(sqrt(square), _LEAST_SHARE) / largest


@kernel
def weigh(s: Stages) -> int:
    """Weights of the rows of each level, over the largest; the first that is damped, or the last."""
    r = ranking(s.links[LEVELS_AT])
    last = r.work[LEVELS] - 1
    damped = r.work[BEGAN] = r.work[ENDED] = last
    for i in range(QPS, WORK + 1):
        r.work[i] = 0
    for k in range(last, -1, -1):
        largest = 0.0
        for row in range(r.level[k, 0], r.level[k, 1]):
            r.root[row] = carray(floats(s.weight[row]), 1)[0] if s.weight[row] else 1.0
            largest = max(largest, r.root[row])
            if k == last:
                s.weights[row - r.level[k, 0]] = r.root[row]
        r.unit[k] = s.unit[0] if k == last else largest if largest > 0.0 else 1.0
        for row in range(r.level[k, 0], r.level[k, 1]):
            r.root[row] = sqrt(r.root[row] / r.unit[k])
        weights = carray(floats(r.level[k, 4]), r.level[k, 2])
        for i in range(len(weights)):
            if weights[i] != 0.0:
                damped = k
    return int(damped)


@part
def fill(at: int) -> int:
    """Rows, bounds, weights, metric and centre as they are in the source now; the first stage that is damped."""
    s = stages(at)
    n, few = len(s.scale), len(s.source_scale)
    first_soft = carray(integers(carray(integers(at), 22)[21]), 10)[4]
    for i in range(len(s.row)):
        source = s.row[i]
        if source >= 0:
            for c in range(few):
                s.G[i, c] = s.source_G[source, c]
            for c in range(few, n):
                s.G[i, c] = 0.0
            s.G[i, n] = s.source_G[source, few]
        else:
            for c in range(n + 1):
                s.G[i, c] = 0.0
    for c in range(few):
        s.scale[c] = s.source_scale[c]
        s.lower[c], s.upper[c] = s.source_lower[c], s.source_upper[c]
    for i in range(first_soft):
        s.lower[n + 1 + i], s.upper[n + 1 + i] = s.source_lower[few + 1 + i], s.source_upper[few + 1 + i]
    for c in range(len(s.source_metric)):
        s.metric[c], s.centre[c] = s.source_metric[c], s.source_centre[c]
    for i in range(len(s.pulls)):  # their rows say what they are worth; scaled by it they would be stiffer than others
        row, c = s.pulls[i, 0], s.pulls[i, 1]
        s.scale[c] = 1.0
        for j in range(first_soft):
            s.G[j, c] /= s.source_scale[c]
        s.G[row, c], s.G[row, n] = 1.0, -carray(floats(s.pulls[i, 2]), 1)[0]
    for i in range(len(s.parts)):
        divide(s, i)
    for i in range(len(s.row)):  # what weighs nothing asks for nothing
        if s.weight[i] and carray(floats(s.weight[i]), 1)[0] == 0.0:
            for c in range(n + 1):
                s.G[i, c] = 0.0
    return weigh(s)


@part
def conclude(at: int) -> None:
    """Write the answer where the source keeps its own, and what is left of the levels that were not decided alone.

    The first level that was not met is hoped to be the next tick's.
    """
    s = stages(at)
    r = ranking(s.links[LEVELS_AT])
    n, few = len(s.scale), len(s.source_scale)
    for c in range(few):
        s.source_value[c] = s.value[c]
    for i in range(len(s.pulls)):
        s.source_value[s.pulls[i, 1]] /= s.source_scale[s.pulls[i, 1]]
    for i in range(len(s.source_G)):
        total = 0.0
        for c in range(few + 1):
            total += s.source_G[i, c] * s.source_value[c]
        s.source_value[few + 1 + i] = total
    last = r.work[LEVELS] - 1
    for k in range(last + 1):
        if r.work[BEGAN] <= k <= r.work[ENDED] and k < last:
            continue
        square, worst, far = 0.0, 0.0, 0.0
        for row in range(r.level[k, 0], r.level[k, 1]):
            left = s.value[n + 1 + row]
            r.left[row] = left
            square += r.unit[k] * (r.root[row] * left) ** 2
            worst = worst if abs(left) <= worst else abs(left)
            far = max(far, abs(left) / (1.0 + abs(s.G[row, n])))
        for c in range(len(s.metric) if k == last else 0):
            square += r.unit[k] * s.metric[c] * (s.value[n - len(s.metric) + c] - s.centre[c]) ** 2
        r.found[k, 1] = sqrt(square)
        if k < r.work[BEGAN]:
            r.found[k, 0], r.found[k, 1], r.found[k, 2], r.found[k, 3], r.found[k, 4] = IS_MET, 0.0, worst, -1.0, far
        else:
            r.found[k, 0] = NOT_DECIDED if k > r.work[ENDED] else IS_LEAST
    r.worst[0] = r.worst[1] = 0.0
    for k in range(r.work[ENDED] + (0 if r.work[BEGAN] == last else 1)):
        for i in range(2):
            number = r.found[k, 2 + 2 * i]
            r.worst[i] = r.worst[i] if number <= r.worst[i] else number
    hope = r.work[BEGAN]
    while hope < min(r.work[ENDED] + 1, last) and r.found[hope, 0] == IS_MET:
        hope += 1
    s.links[HOPE] = hope


@part
def hoped(at: int) -> int:
    """The core's answer for all levels but the last as equations, concluded if it is certified.

    RANKED: in the last tick a level above was not met, or one is damped now, and that one has to be decided by itself.
    """
    last = ranking(stages(at).links[LEVELS_AT]).work[LEVELS] - 1
    damped = fill(at)
    links = stages(at).links
    links[FIRST] = min(links[HOPE], damped)
    if links[FIRST] < last:
        return RANKED
    code = answer(links[CORE_AT])
    if code == SOLVED:
        conclude(at)
    return code
