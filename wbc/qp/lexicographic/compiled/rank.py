"""Levels decided one by one, in one call: the first that cannot be met with those above it, and then each below.

A level is decided in the space that those above it leave (:mod:`~wbc.qp.lexicographic.compiled.search`), is certified
(:mod:`~wbc.qp.lexicographic.compiled.proof`), and narrows the space for the next. What held it back while it was
decided stays held, and may push either way from then on; else a lower level could leave the set where it is best. What
pushed with little more than rounding is let go. If a lower level then costs those above too much, or is not certified,
all levels are decided again with this held, too.
"""

from __future__ import annotations

from enum import IntEnum
from math import inf, sqrt
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, carray, copy, entry, floats, part
from wbc.qp.lexicographic.compiled.proof import certify
from wbc.qp.lexicographic.compiled.search import solve_level
from wbc.qp.lexicographic.compiled.space import (
    DEPENDENT,
    HARDLY,
    Size,
    begin_here,
    gradient_of_own,
    item_in_space,
    known_in_space,
    left_by_rounding,
    narrow,
    open_space,
    space,
)  # fmt: skip
from wbc.qp.rows.compiled.equality import reduce_base
from wbc.qp.rows.compiled.linear import clear
from wbc.qp.rows.compiled.verify import ALONE
from wbc.qp.rows.compiled.work import FAILED, INACCURATE, SOLVED, place_of, views
from wbc.tolerances import DISTANCE, MET, NEAR, NOISE, ROUNDING
from wbc.types import Index, Mat, Vec

NOT_DECIDED, IS_MET, IS_LEAST = 0, 1, 2
#: What :func:`rank` says where levels below could have an answer if more stayed held: another number than a search's.
AGAIN = 5
#: What a level above may lose to a level below, as a share of what is left of it, beside what counts as met.
_LITTLE = 1e-5


class Ranking(NamedTuple):
    """Views of the memory of all levels of a problem with m items."""

    level: Annotated[Index, "count, 6"]  # first row, last, damped unknowns, the first of them, their weights, where to
    share: Annotated[Vec, "count"]  # what the damping counts for
    unit: Annotated[Vec, "count"]  # what the weights of its rows are divided by
    root: Annotated[Vec, "rows"]  # roots of the weights of the rows, over the unit
    size: Annotated[Vec, "rows"]  # one unit and what each row asks for: what counts is a share of it
    sides: Annotated[Mat, "count, m"]  # working sets
    left: Annotated[Vec, "rows"]  # what was left of a row when its level was held
    unmet: Annotated[Vec, "count"]  # 1 where that counts
    found: Annotated[Mat, "count, 5"]  # how it came out, what is left, beyond bounds, distance over weight, relative
    pulled: Annotated[Vec, "m"]  # how far each unknown can be from the optimum of the last level
    worst: Annotated[Vec, "2"]  # beyond bounds, relative distance; without the last level if the core decided that
    best: Annotated[Vec, "values"]  # the last good answer
    sizes: Annotated[Index, "16"]  # see below


#: What stands in ``sizes``: how many levels, rows, values and items there are, address of the space, first level to be
#: tried and QPs allowed; first and last level that were decided, QPs, levels whose guess was right, was repaired, led
#: nowhere, steps of all; 1 where an item was let go that may have held a level back, 1 where none is to be let go.
Count = IntEnum(
    "Count",
    "LEVELS TOTAL VALUES BOUNDED SPACE START BUDGET BEGAN ENDED QPS AT_ONCE REPAIRED FALLBACK WORK LOOSE ALL",
    start=0,
)
LAYOUT = Layout(Ranking, count="sizes[0]", rows="sizes[1]", values="sizes[2]", m="sizes[3]")
#: In a kernel: the arrays at an address.
ranking = LAYOUT.views


@part
def read(at: int, k: int) -> None:
    """The rows of level k, those that damp it or are the cost of u behind them, and the last tick's working set."""
    r = ranking(at)
    w = space(r.sizes[Count.SPACE])
    s = views(w.sizes[Size.CORE])
    first, stop, count, column = r.level[k, 0], r.level[k, 1], r.level[k, 2], r.level[k, 3]
    rows = stop - first
    w.sizes[Size.FIRST], w.sizes[Size.OWN] = first, rows
    copy(r.root[first:], w.weigh[:rows])
    weights, wanted = carray(floats(r.level[k, 4]), count), carray(floats(r.level[k, 5]), count)
    for i in range(count):
        if weights[i] != 0.0:
            scale = s.scale[s.sizes[0] + column + i]
            w.which[rows - w.sizes[Size.OWN]], w.toward[rows - w.sizes[Size.OWN]] = column + i, wanted[i] / scale
            w.weigh[rows] = sqrt(r.share[k] * weights[i] / r.unit[k]) * scale
            rows += 1
    for c in range(s.sizes[0] if w.sizes[Size.LAST] else 0):  # nothing is left out of the cost where u is eliminated
        w.which[rows - w.sizes[Size.OWN]] = -1 - c
        w.weigh[rows] = sqrt(s.numbers[0] / r.unit[k])
        rows += 1
    w.sizes[Size.ROWS] = rows
    copy(r.sides[k], w.side)


@part
def keeps(at: int, k: int) -> bool:
    """Whether the levels above still have what they came to."""
    r = ranking(at)
    w = space(r.sizes[Count.SPACE])
    s = views(w.sizes[Size.CORE])
    rows = s.value[s.sizes[0] + w.sizes[Size.N] + 1 :]
    for i in range(k):
        before, now = 0.0, 0.0
        for row in range(r.level[i, 0], r.level[i, 1]):
            before += (r.root[row] * r.left[row]) ** 2 * r.unit[i]
            now += (r.root[row] * (r.left[row] + rows[row])) ** 2 * r.unit[i]
            if r.unmet[i] == 0.0 and not abs(rows[row]) <= MET:
                return False
        if r.unmet[i] != 0.0 and not sqrt(now) - sqrt(before) <= _LITTLE * sqrt(before) + MET:
            return False
    for row in range(r.level[0, 1], len(s.G)):
        if not abs(rows[row]) <= NEAR:
            return False
    return True


@part
def distant(at: int, k: int, off: float) -> None:
    """Write down how far off its optimum level k can be, and the largest share of this in what one of its rows asks."""
    r = ranking(at)
    far = 0.0
    for row in range(r.level[k, 0], r.level[k, 1]):
        if r.root[row] > 0.0:
            far = max(far, off / r.root[row] / r.size[row])
    r.found[k, 3], r.found[k, 4] = off, far if off < inf else inf


@part
def prove(at: int, k: int) -> bool:
    """The certificate of level k, which was solved last; whether it holds."""
    r = ranking(at)
    w = space(r.sizes[Count.SPACE])
    s = views(w.sizes[Size.CORE])
    certify(r.sizes[Count.SPACE])
    off, square = w.proof[1], 0.0
    first = s.sizes[0] + w.sizes[Size.N] + 1
    for row in range(r.level[k, 0], r.level[k, 1]):
        square += (r.root[row] * s.value[first + row]) ** 2
    r.found[k, 0], r.found[k, 1], r.found[k, 2] = IS_LEAST, sqrt(r.unit[k] * square), w.proof[0]
    distant(at, k, off)
    for c in range(w.sizes[Size.N] if w.sizes[Size.LAST] else 0):  # tasks on joints are in the metric
        scale = s.scale[s.sizes[0] + c]
        r.pulled[c] = off * w.root[c] * scale
        if s.unit[0] * s.metric[c] > ALONE * s.numbers[0]:
            far = r.pulled[c] / (1.0 + abs(s.value[s.sizes[0] + c]) * scale)
            r.found[k, 4] = max(r.found[k, 4], far if off < inf else inf)
    return bool(r.found[k, 2] <= MET and r.found[k, 4] <= DISTANCE * MET)


@part
def hold(at: int, k: int) -> None:
    """From here on level k keeps what it has: its rows, and with a residual the items that hold it back.

    What a damped level came to is not the least of its rows, so that nothing but the rows themselves has to be kept.
    """
    r = ranking(at)
    w = space(r.sizes[Count.SPACE])
    s = views(w.sizes[Size.CORE])
    one, own, first, here = s.sizes[0] + w.sizes[Size.N], w.sizes[Size.OWN], w.sizes[Size.FIRST], r.sizes[Count.SPACE]
    left, count, is_damped = 0.0, 0, w.sizes[Size.ROWS] > own
    for i in range(own):
        r.left[first + i] = s.value[one + 1 + first + i]
        left = max(left, abs(r.left[first + i]))
    dependent = HARDLY if left > MET else DEPENDENT
    for i in range(own):  # rows are measured by their lengths here; of what is left of them, rounding does not count
        whole = gradient_of_own(here, i)
        w.v[i] = left_by_rounding(w, whole)
        w.rho[i] = max(known_in_space(here, whole, w.v[i], w.C[i]), w.v[i] / dependent)
    if left <= MET:
        r.found[k, 0] = IS_MET
    elif not is_damped:
        r.unmet[k] = 1.0
        for i in range(w.sizes[Size.HELD]):
            if w.holds[i] > (NOISE / ROUNDING if r.sizes[Count.ALL] else 1.0):
                item = w.item[i]
                w.size[count], w.v[count], w.kept[item] = item_in_space(here, item), w.lost[item], 1.0
                copy(w.R[item], w.C[count])
                count += 1
            elif w.holds[i] > NOISE / ROUNDING:
                r.sizes[Count.LOOSE] = 1
        narrow(here, count, DEPENDENT)
        for i in range(own):
            whole = gradient_of_own(here, i)
            w.v[i] = left_by_rounding(w, whole)
            known_in_space(here, whole, w.v[i], w.C[i])
    copy(w.rho, w.size[:own])
    for i in range(own):
        s.G[first + i, one] -= r.left[first + i]
        s.value[one + 1 + first + i] = 0.0
    narrow(here, own, dependent)
    begin_here(here)


@part
def decide(at: int, k: int, begins: bool) -> int:
    """Level k in the space that those above it leave; the first opens that space."""
    r = ranking(at)
    w = space(r.sizes[Count.SPACE])
    s = views(w.sizes[Size.CORE])
    w.sizes[Size.STEPS], w.sizes[Size.FINDS] = 0, 0
    w.sizes[Size.LAST], w.sizes[Size.INSIDE] = k == r.sizes[Count.LEVELS] - 1, not begins
    if begins:
        for c in range(w.sizes[Size.N]):
            w.root[c] = 1.0 / sqrt(s.metric[c])
        w.sizes[Size.FIRST] = r.level[k, 1]
        if not reduce_base(w.sizes[Size.CORE]):
            return FAILED
        if not open_space(r.sizes[Count.SPACE], w.sizes[Size.FIRST]) <= NEAR:
            return FAILED
    read(at, k)
    code = solve_level(r.sizes[Count.SPACE])
    r.sizes[Count.WORK] += w.sizes[Size.STEPS]
    guessed = Count.AT_ONCE if w.sizes[Size.STEPS] == 1 else Count.REPAIRED
    r.sizes[Count.FALLBACK if w.sizes[Size.FINDS] else guessed] += 1
    if code != SOLVED:
        return int(code)
    if not keeps(at, k):
        return INACCURATE
    counts = w.sizes[Size.LAST] != 0
    for i in range(w.sizes[Size.HELD]):
        counts = counts or w.holds[i] > 1.0
    if counts:
        copy(w.side, r.sides[k])
    else:  # what holds nothing back would be moved to its bounds in the next tick, for nothing
        clear(r.sides[k])
    if w.sizes[Size.LAST]:  # what held a level back is one value in the last problem
        for item in range(w.sizes[Size.ITEMS]):
            if w.kept[item] != 0.0:
                place = place_of(s, item)
                s.lower[place] = s.upper[place] = s.value[place]
    return SOLVED


@entry
def rank(at: int) -> int:
    """Decide the levels from ``sizes[START]`` on; where that has no answer, from one above.

    What stands above the first is hoped to be met. ``found`` tells of those that were decided.
    """
    r = ranking(at)
    last, k, qps = r.sizes[Count.LEVELS] - 1, r.sizes[Count.START], r.sizes[Count.QPS]
    clear(r.unmet)
    r.sizes[Count.LOOSE] = 0
    while True:
        qps += 1
        code = decide(at, k, True)
        if code == SOLVED or k == 0 or qps >= r.sizes[Count.BUDGET]:
            break
        k -= 1
    r.sizes[Count.BEGAN], r.sizes[Count.QPS] = k, qps
    if code != SOLVED:
        return int(code)
    s = views(space(r.sizes[Count.SPACE]).sizes[Size.CORE])
    certified = prove(at, k)
    while k < last:
        hold(at, k)
        if qps >= r.sizes[Count.BUDGET]:
            break
        copy(s.value, r.best)
        qps += 1
        code = decide(at, k + 1, False)
        if code != SOLVED:
            copy(r.best, s.value)
            break
        k += 1
        certified = prove(at, k) and certified
    r.sizes[Count.ENDED], r.sizes[Count.QPS] = k, qps
    again = qps + 1 + last - r.sizes[Count.BEGAN]
    if not (code == SOLVED and certified) and r.sizes[Count.LOOSE] and again <= r.sizes[Count.BUDGET]:
        return AGAIN
    return SOLVED
