"""A row problem written anew in order of rank, before a tick is decided, and the answer written back."""

from __future__ import annotations

from math import sqrt
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, carray, copy, floats, kernel, part
from wbc.qp.lexicographic.compiled.rank import IS_LEAST, IS_MET, NOT_DECIDED, Count, distant, ranking
from wbc.qp.rows.compiled.linear import clear, dot
from wbc.qp.rows.compiled.search import answer
from wbc.qp.rows.compiled.work import SOLVED, views
from wbc.tolerances import MET
from wbc.types import Index, Mat, Vec


class Stages(NamedTuple):
    """Views of where the numbers of a problem come from; the problem itself is in the memory of its core."""

    G: Annotated[Mat, "source_rows, few + 1"]  # those of the source
    value: Annotated[Vec, "few + 1 + source_rows"]
    lower: Annotated[Vec, "few + 1 + source_rows"]
    upper: Annotated[Vec, "few + 1 + source_rows"]
    metric: Annotated[Vec, "source_y"]
    centre: Annotated[Vec, "source_y"]
    scale: Annotated[Vec, "few"]
    row: Annotated[Index, "rows"]  # where each row stands in the source, −1 for those that do not
    weight: Annotated[Index, "rows"]  # address of the weight of each row, 0 where it is 1
    pulls: Annotated[Index, "sizes[4], 3"]  # rows about one unknown: row, unknown, address of what is wanted there
    parts: Annotated[Index, "sizes[5], 7"]  # see below
    share: Annotated[Vec, "sizes[5]"]  # what the share of each part weighs
    links: Annotated[Index, "4"]  # see below
    sizes: Annotated[Index, "7"]  # unknowns of the source, those in y, its rows, rows here, pulls, parts; see below


LAYOUT = Layout(Stages, few="sizes[0]", source_y="sizes[1]", source_rows="sizes[2]", rows="sizes[3]")
#: In a kernel: the arrays at an address. The last of ``sizes`` says how many unknowns of the source, its last ones, are
#: zero here.
stages = LAYOUT.views

#: What is done in part: its first row of direction, or −1, how many there are, the unknown that says what is given up,
#: addresses of what is wanted, drift and weights, and the row of its share, −1 where that is in the metric.
_ROW, _DIM, _UNKNOWN, _WANTED, _DRIFT, _WEIGHTS, _SHARE = range(7)
#: Addresses of the memory of the levels and of the core; the level that is hoped to be the first that is not met, and
#: the one that was tried first.
LEVELS_AT, CORE_AT, HOPE, FIRST = range(4)
#: What :func:`hoped` says where levels have to be decided one by one: another number than those of a search.
RANKED = 4


@kernel
def divide(s: Stages, i: int) -> None:
    """Rows of a task that may be done in part: its direction, and its share."""
    p, part = views(s.links[CORE_AT]), s.parts[i]
    dim, unknown = part[_DIM], part[_UNKNOWN]
    wanted, drift = carray(floats(part[_WANTED]), dim), carray(floats(part[_DRIFT]), dim)
    weights = carray(floats(part[_WEIGHTS]), dim)
    largest, square, heaviest = 0.0, 0.0, 0.0
    for j in range(dim):
        asked = wanted[j] + drift[j]
        largest, square = max(largest, abs(asked)), square + weights[j] * asked * asked
        heaviest = max(heaviest, weights[j])
    largest = max(largest, MET)  # a smaller task is met by any part of it; its share has a place among the others
    if part[_ROW] >= 0:
        p.lower[unknown], p.upper[unknown] = 0.0, largest
        for j in range(dim):
            p.G[part[_ROW] + j, unknown] = (wanted[j] + drift[j]) / largest
    s.share[i] = (max(sqrt(square), MET) / largest) ** 2 if heaviest > 0.0 else 0.0
    p.centre[unknown - p.sizes[0]] = 0.0
    if part[_SHARE] >= 0:
        p.G[part[_SHARE], unknown] = 1.0
    else:
        p.metric[unknown - p.sizes[0]] = max(s.share[i], p.numbers[0]) / p.unit[0]


@kernel
def weigh(s: Stages) -> int:
    """Weights of the rows of each level, over the largest; the first that is damped, or the last."""
    p, r = views(s.links[CORE_AT]), ranking(s.links[LEVELS_AT])
    last = r.sizes[Count.LEVELS] - 1
    damped = r.sizes[Count.BEGAN] = r.sizes[Count.ENDED] = last
    for i in range(Count.QPS, Count.WORK + 1):
        r.sizes[i] = 0
    for k in range(last, -1, -1):
        largest = 0.0
        for row in range(r.level[k, 0], r.level[k, 1]):
            r.root[row] = carray(floats(s.weight[row]), 1)[0] if s.weight[row] else 1.0
            largest = max(largest, r.root[row])
            r.size[row] = 1.0 + abs(p.G[row, len(p.scale)])
            if k == last:
                p.given[row - r.level[k, 0]] = r.root[row]
        r.unit[k] = p.unit[0] if k == last else largest if largest > 0.0 else 1.0
        for row in range(r.level[k, 0], r.level[k, 1]):
            r.root[row] = sqrt(r.root[row] / r.unit[k])
        weights = carray(floats(r.level[k, 4]), r.level[k, 2])
        for i in range(len(weights)):
            if weights[i] != 0.0:
                damped = k
    for task in s.parts:
        if task[_SHARE] >= 0:
            r.size[task[_SHARE]] += p.upper[task[_UNKNOWN]]
    return int(damped)


@part
def fill(at: int) -> int:
    """Rows, bounds, weights, metric and centre as they are in the source now; the first stage that is damped."""
    s = stages(at)
    p = views(s.links[CORE_AT])
    n, few, first_soft = len(p.scale), len(s.scale), p.sizes[0] + p.sizes[2]
    kept, metric = few - s.sizes[6], len(s.metric) - s.sizes[6]
    for i in range(len(s.row)):
        clear(p.G[i])
        source = s.row[i]
        if source >= 0:
            copy(s.G[source], p.G[i, :kept])
            p.G[i, n] = s.G[source, few]
    copy(s.scale, p.scale[:kept])
    copy(s.lower, p.lower[:kept])
    copy(s.upper, p.upper[:kept])
    copy(s.lower[few + 1 :], p.lower[n + 1 : n + 1 + first_soft])
    copy(s.upper[few + 1 :], p.upper[n + 1 : n + 1 + first_soft])
    copy(s.metric, p.metric[:metric])
    copy(s.centre, p.centre[:metric])
    for i in range(len(s.pulls)):  # their rows say what they are worth; scaled by it they would be stiffer than others
        row, c = s.pulls[i, 0], s.pulls[i, 1]
        p.scale[c] = 1.0
        for j in range(first_soft):
            p.G[j, c] /= s.scale[c]
        p.G[row, c], p.G[row, n] = 1.0, -carray(floats(s.pulls[i, 2]), 1)[0]
    for i in range(len(s.parts)):
        divide(s, i)
    for i in range(len(s.row)):  # what weighs nothing asks for nothing
        if s.weight[i] and carray(floats(s.weight[i]), 1)[0] == 0.0:
            clear(p.G[i])
    return weigh(s)


@part
def conclude(at: int) -> None:
    """Write the answer where the source keeps its own, and what is left of the levels that were not decided alone.

    By how much lower levels moved the rows of a level that was decided alone counts in its certificate. The first level
    that was not met is hoped to be the next tick's.
    """
    s = stages(at)
    p, r = views(s.links[CORE_AT]), ranking(s.links[LEVELS_AT])
    n, few = len(p.scale), len(s.scale)
    kept = few - s.sizes[6]
    copy(p.value, s.value[:kept])
    clear(s.value[kept:few])
    for i in range(len(s.pulls)):
        s.value[s.pulls[i, 1]] /= s.scale[s.pulls[i, 1]]
    for i in range(len(s.G)):
        s.value[few + 1 + i] = dot(s.G[i], s.value, few + 1)
    last = r.sizes[Count.LEVELS] - 1
    for k in range(last + 1):
        if r.sizes[Count.BEGAN] <= k <= r.sizes[Count.ENDED] and k < last:
            moved = 0.0  # by the levels below
            for row in range(r.level[k, 0], r.level[k, 1]):
                moved += (r.root[row] * p.value[n + 1 + row]) ** 2
            distant(s.links[LEVELS_AT], k, r.found[k, 3] + sqrt(moved))
            continue
        square, worst, far = 0.0, 0.0, 0.0
        for row in range(r.level[k, 0], r.level[k, 1]):
            left = p.value[n + 1 + row]
            r.left[row] = left
            square += r.unit[k] * (r.root[row] * left) ** 2
            worst = worst if abs(left) <= worst else abs(left)
            far = max(far, abs(left) / r.size[row])
        for c in range(len(p.metric) if k == last else 0):
            square += r.unit[k] * p.metric[c] * (p.value[n - len(p.metric) + c] - p.centre[c]) ** 2
        r.found[k, 1] = sqrt(square)
        if k < r.sizes[Count.BEGAN]:
            r.found[k, 0], r.found[k, 1], r.found[k, 2], r.found[k, 3], r.found[k, 4] = IS_MET, 0.0, worst, -1.0, far
        else:
            r.found[k, 0] = NOT_DECIDED if k > r.sizes[Count.ENDED] else IS_LEAST
    r.worst[0] = r.worst[1] = 0.0
    for k in range(r.sizes[Count.ENDED] + (0 if r.sizes[Count.BEGAN] == last else 1)):
        for i in range(2):
            number = r.found[k, 2 + 2 * i]
            r.worst[i] = r.worst[i] if number <= r.worst[i] else number
    hope = r.sizes[Count.BEGAN]
    while hope < min(r.sizes[Count.ENDED] + 1, last) and r.found[hope, 0] == IS_MET:
        hope += 1
    s.links[HOPE] = hope


@part
def hoped(at: int) -> int:
    """The core's answer for all levels but the last as equations, concluded if it is certified.

    RANKED: in the last tick a level above was not met, or one is damped now, and that one has to be decided by itself.
    """
    last = ranking(stages(at).links[LEVELS_AT]).sizes[Count.LEVELS] - 1
    damped = fill(at)
    links = stages(at).links
    links[FIRST] = min(links[HOPE], damped)
    if links[FIRST] < last:
        return RANKED
    code = answer(links[CORE_AT])
    if code == SOLVED:
        conclude(at)
    return code
