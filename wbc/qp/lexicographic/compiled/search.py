"""The working set of a level: guess, verify, exchange; then a descent. And what Python calls.

The working set is guessed (block principal pivoting). Where that does not end it is found by a descent from a point
where all items are within their bounds. What a working set comes to says :mod:`~wbc.qp.lexicographic.compiled.level`.
"""

from __future__ import annotations

from math import floor, inf, sqrt

from wbc.compiled import entry, kernel, small_kernel
from wbc.qp.lexicographic.compiled.level import ROUNDING, hold, read_level
from wbc.qp.lexicographic.compiled.space import (
    CORE,
    DECIDED,
    DEPENDENT,
    FIRST,
    FREE,
    HELD,
    ITEMS,
    LAST,
    OWN,
    ROWS,
    N,
    Space,
    begin_here,
    go,
    gradient_of_item,
    gradient_of_row,
    in_space,
    narrow,
    open_space,
    reflect,
    space,
)  # fmt: skip
from wbc.qp.rows.compiled.equality import evaluate, reduce_base
from wbc.qp.rows.compiled.linear import dot
from wbc.qp.rows.compiled.work import FAILED, SOLVED, UNDECIDED, Work, place_of, views

#: Residuals up to this are too small to say what they are orthogonal to.
_SLIGHT = 1e-3
#: Of a level with a residual, rows that reach no further than this out of the others matter in the second order only.
_OWN = 1e-7
#: A level's own rows count from their lengths in its space, or from this share of the whole length.
_BARELY = 1e-4
#: A bound is broken beyond this share of 1 + its size.
_BROKEN = 1e-9
#: Working sets that are guessed; exchanges that may fail to lower the number of wrong items.
_GUESSES, _CHANCES = 8, 3
#: Steps of a descent for each item, and those that are none.
_MOST, _STILL = 5, 1e-11
#: How far bounds are put apart for a descent, for sizes up to the second, and what tells one item from the next.
_APART, _LARGE, _GOLDEN = 1e-10, 1e3, 0.6180339887498949


@small_kernel
def broken(w: Space, s: Work, item: int) -> float:
    """By how much an item is beyond its bounds now, beside what counts: above 1 it is."""
    value = s.value[place_of(s, item)]
    moved = value - w.value0[item]
    return float(max(moved - w.high[item], w.low[item] - moved) / (_BROKEN * (1.0 + abs(value))))


@kernel
def guess_set(at: int) -> bool:
    """Hold, verify, exchange: whether that ends with nothing wrong."""
    w = space(at)
    s = views(w.sizes[CORE])
    m = w.sizes[ITEMS]
    fewest, chances = m + 1, _CHANCES
    for item in range(m):
        far = w.high[item] if w.side[item] > 0.0 else w.low[item]
        if w.kept[item] != 0.0 or not abs(far) < inf:
            w.side[item] = 0.0
    for _ in range(_GUESSES):
        for item in range(m):
            w.idle[item] = 0.0
        hold(at)
        go(at, w.z)
        wrong, last = 0, -1
        for item in range(m):
            if w.side[item] == 0.0 and w.kept[item] == 0.0 and not broken(w, s, item) <= 1.0:
                if w.idle[item] != 0.0:
                    return False
                w.wrong[item] = -1.0
            if w.wrong[item] != 0.0:
                wrong, last = wrong + 1, item
        if wrong == 0:
            return True
        if wrong < fewest:
            fewest, chances = wrong, _CHANCES
        elif chances > 0:
            chances -= 1
        else:  # the last one alone, which cannot cycle
            for item in range(last):
                w.wrong[item] = 0.0
        for item in range(m):
            if w.wrong[item] > 0.0:
                w.side[item] = 0.0
            elif w.wrong[item] < 0.0:
                moved = s.value[place_of(s, item)] - w.value0[item]
                w.side[item] = 1.0 if moved - w.high[item] > w.low[item] - moved else -1.0
    return False


@kernel
def descend(at: int) -> bool:
    """The least by a primal active set from ``at``, where all items are within their bounds.

    In each step as far as the items allow; the one that stops it is held from then on, and where none does, the one
    that pulls most is let go. More items than there are unknowns may meet in one point, where that could go in circles:
    each bound is first put a little further out, by an amount of its own. Rounding can be more than that: an item that
    was let go is not let go again before the cost is lower. False: too many changes.

    Nocedal, Wright: Numerical Optimization, 16.5. Gill, Murray, Saunders, Wright, Mathematical Programming 45, 1989.
    """
    w = space(at)
    s = views(w.sizes[CORE])
    m, d = w.sizes[ITEMS], w.sizes[N] - w.sizes[FREE]
    go(at, w.at)
    for item in range(m):
        near = _BROKEN * (1.0 + abs(w.value0[item]))
        moved = s.value[place_of(s, item)] - w.value0[item]
        far = moved - (w.high[item] if w.side[item] > 0.0 else w.low[item])
        w.low[item], w.high[item] = min(w.low[item], moved), max(w.high[item], moved)
        w.idle[item] = w.stuck[item] = 0.0
        if w.kept[item] != 0.0 or not abs(far) <= near:
            w.side[item] = 0.0
        if w.side[item] == 0.0 and s.lower[place_of(s, item)] != s.upper[place_of(s, item)]:
            own = _GOLDEN * item
            out = _APART * min(1.0 + abs(w.value0[item]), _LARGE) * (1.0 + own - floor(own))
            w.low[item] -= out
            w.high[item] += out
    lowest = inf
    for _ in range(_MOST * m + 1):
        for item in range(m):
            if w.side[item] != 0.0:
                w.idle[item] = 1.0  # those that depend on others, too: nothing moves them either
        hold(at)
        length, most = 0.0, 0.0
        for c in range(d):
            w.t[c] = w.step[c] = w.z[c] - w.at[c]
            length += w.t[c] ** 2
        if not length < inf:
            return False
        gains = across(at)
        for c in range(d):
            most = max(most, abs(w.step[c]) / (1.0 + abs(w.at[c])))
        if most > _STILL and gains and stopped(at, sqrt(length)):
            continue
        if most <= _STILL or gains:
            for c in range(d):
                w.at[c] = w.z[c]
        cost = cost_of(at, d)
        is_lower = cost < lowest * (1.0 - ROUNDING)
        lowest = min(cost, lowest)
        let_go, most = -1, 0.0
        for item in range(m):
            w.idle[item] = 0.0
            if is_lower:
                w.stuck[item] = 0.0
            if w.stuck[item] == 0.0 and w.wrong[item] > most:
                let_go, most = item, w.wrong[item]
        if let_go < 0:
            go(at, w.at)
            return True
        w.side[let_go], w.stuck[let_go] = 0.0, 1.0
    return False


@kernel
def across(at: int) -> bool:
    """Leave of ``step`` what no held item feels: the rest puts these where they are held. Whether the level gains.

    What the level gains is the square of what its rows feel of the step, as that ends at their least.
    """
    w = space(at)
    k, d, rank = w.sizes[ROWS], w.sizes[N] - w.sizes[FREE], w.sizes[HELD]
    for c in range(w.sizes[DECIDED]):
        reflect(w.step, w.P[c], w.beta[c], c, d)
    gain, left = 0.0, 0.0
    for i in range(k):
        gain += dot(w.A[i, rank:], w.step[rank:], d - rank) ** 2
        left += w.missing[i] ** 2
    for c in range(d):
        if c < rank:
            w.step[c] = 0.0
        elif w.sizes[LAST]:
            gain += w.step[c] ** 2
    for c in range(w.sizes[DECIDED] - 1, -1, -1):
        reflect(w.step, w.P[c], w.beta[c], c, d)
    return bool(gain > (ROUNDING * (1.0 + sqrt(left))) ** 2)


@kernel
def cost_of(at: int, d: int) -> float:
    """What the level minimises, at ``at``, twice."""
    w = space(at)
    cost = 0.0
    for i in range(w.sizes[ROWS]):
        cost += (w.a[i] + dot(w.W[i], w.at, d)) ** 2
    for c in range(d if w.sizes[LAST] else 0):
        cost += (w.at[c] - w.centre[c]) ** 2
    return float(cost)


@kernel
def stopped(at: int, length: float) -> bool:
    """Go the step ``t`` from ``at`` as far as items allow, and hold the one that stops it; False: none does."""
    w = space(at)
    s = views(w.sizes[CORE])
    n, d = w.sizes[N], w.sizes[N] - w.sizes[FREE]
    found, share, side = -1, 1.0, 0.0
    go(at, w.at)
    for i in range(n):
        w.step[i] = dot(w.V[i, w.sizes[FREE] :], w.t, d)
    for item in range(w.sizes[ITEMS]):
        if w.side[item] == 0.0 and w.kept[item] == 0.0 and w.idle[item] == 0.0:
            whole = gradient_of_item(at, item)
            ahead = dot(w.g, w.step, n)
            if abs(ahead) > _STILL * whole * length:
                moved = s.value[place_of(s, item)] - w.value0[item]
                room = max(((w.high[item] if ahead > 0.0 else w.low[item]) - moved) / ahead, 0.0)
                if room < share:
                    found, share, side = item, room, 1.0 if ahead > 0.0 else -1.0
    if found < 0:
        return False
    for c in range(d):
        w.at[c] += share * w.t[c]
    w.side[found] = side
    return True


# ---- what Python calls
@entry
def begin(at: int) -> int:
    """Eliminate the base, and open the space of all points where the rows from ``sizes[FIRST]`` on hold."""
    w = space(at)
    if not reduce_base(w.sizes[CORE]):
        return FAILED
    w.proof[0] = open_space(at, w.sizes[FIRST])
    return SOLVED


@entry
def begin_from(at: int) -> int:
    """The same space from the point y that is in ``value``."""
    evaluate(space(at).sizes[CORE])
    begin_here(at)
    return SOLVED


@entry
def guess(at: int) -> int:
    """The answer of a level in ``value``, from the working set in ``side``. UNDECIDED: not found by guessing."""
    read_level(at)
    return SOLVED if guess_set(at) else UNDECIDED


@entry
def decide(at: int) -> int:
    """The same by a descent from the point y in ``value``, or from where the level begins if that is beyond bounds."""
    w = space(at)
    s = views(w.sizes[CORE])
    for i in range(w.sizes[N]):
        w.g[i] = (s.value[s.sizes[0] + i] - w.y0[i]) / w.root[i]
    in_space(at, w.at)
    read_level(at)
    go(at, w.at)
    for item in range(w.sizes[ITEMS]):
        if w.kept[item] == 0.0 and not broken(w, s, item) <= 1.0:
            for c in range(w.sizes[N] - w.sizes[FREE]):
                w.at[c] = 0.0
    return SOLVED if descend(at) else FAILED


@entry
def finish(at: int) -> int:
    """Keep to what the level came to: its rows, and with a residual the items that hold it back.

    What a damped level came to is not the least of its rows, so that nothing but the rows themselves has to be kept.
    """
    w = space(at)
    s = views(w.sizes[CORE])
    k, first = w.sizes[OWN], w.sizes[FIRST]
    left, count = 0.0, 0
    for i in range(k):
        left = max(left, abs(s.value[s.sizes[0] + w.sizes[N] + 1 + first + i]))
        whole = gradient_of_row(at, first + i)
        w.rho[i] = max(in_space(at, w.C[i]), _BARELY * whole)
    if w.sizes[ROWS] > k:
        left = 0.0
    if left > _SLIGHT:
        for i in range(w.sizes[HELD]):
            if w.holds[i] != 0.0:
                gradient_of_item(at, w.item[i])
                w.size[count] = in_space(at, w.C[count])
                w.kept[w.item[i]] = 1.0
                count += 1
        narrow(at, count, DEPENDENT)
        for i in range(k):
            gradient_of_row(at, first + i)
            in_space(at, w.C[i])
    for i in range(k):
        w.size[i] = w.rho[i]
    narrow(at, k, _OWN if left > _SLIGHT else DEPENDENT)
    begin_here(at)
    return SOLVED
