"""The working set of a level: guess, verify, exchange; then the core, and a descent.

The working set is guessed (block principal pivoting). Where that does not end, the core finds the least of the level
beside a small distance from where it stands, and its working set is the next guess. The last resort is a descent from
there. What a working set comes to says :mod:`~wbc.qp.lexicographic.compiled.level`.
"""

from __future__ import annotations

from math import inf, sqrt

from wbc.compiled import copy, part, small_kernel
from wbc.qp.lexicographic.compiled.level import hold, read_level
from wbc.qp.lexicographic.compiled.space import (
    DEPENDENT,
    HARDLY,
    Size,
    Space,
    begin_here,
    go,
    item_in_space,
    reflect,
    space,
)  # fmt: skip
from wbc.qp.rows.compiled.linear import add, clear, dot
from wbc.qp.rows.compiled.search import answer_near
from wbc.qp.rows.compiled.work import FAILED, INACCURATE, INFEASIBLE, SOLVED, VARIABLES, Work, place_of, views
from wbc.qp.rows.compiled.work import ROWS as IN_ROWS
from wbc.tolerances import CANCELS, NEAR, SAME

#: Working sets that are guessed; exchanges that may fail to lower the number of wrong items.
_GUESSES, _CHANCES = 2, 1
#: How often the core is asked, and what a row of the level weighs there beside the distance: more where its working set
#: is not that of the least, up to where rows beside it count as dependent; less where rows as heavy hide the bounds
#: behind rounding, which takes the core up to a hundred times as many steps.
_FINDS, _HEAVY, _MORE, _LESS = 4, 1e6, 1e2, 1e-4
#: Steps of a descent for each item.
_MOST = 5


@small_kernel
def broken(w: Space, s: Work, item: int) -> float:
    """By how much an item is beyond its bounds now, beside what counts: above 1 it is."""
    value = s.value[place_of(s, item)]
    moved = value - w.value0[item]
    return float(max(moved - w.high[item], w.low[item] - moved) / (SAME * (1.0 + abs(value))))


@part
def guess_set(at: int) -> bool:
    """Hold, verify, exchange: whether that ends with nothing wrong."""
    w = space(at)
    s = views(w.sizes[Size.CORE])
    m = w.sizes[Size.ITEMS]
    fewest, chances = m + 1, _CHANCES
    for item in range(m):
        far = w.high[item] if w.side[item] > 0.0 else w.low[item]
        if w.kept[item] != 0.0 or not abs(far) < inf:
            w.side[item] = 0.0
    for _ in range(_GUESSES):
        clear(w.idle)
        hold(at, HARDLY)
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
            clear(w.wrong[:last])
        for item in range(m):
            if w.wrong[item] > 0.0:
                w.side[item] = 0.0
            elif w.wrong[item] < 0.0:
                moved = s.value[place_of(s, item)] - w.value0[item]
                w.side[item] = 1.0 if moved - w.high[item] > w.low[item] - moved else -1.0
    return False


@part
def find(at: int, heavy: float) -> int:
    """The least of the level beside the distance from where it begins, in ``at``, and its working set, by the core.

    The rows of a level weigh far more than the distance; the distance of the last level is its own. Or the proof that
    there is no point within all bounds.
    """
    w = space(at)
    m, d, k = w.sizes[Size.ITEMS], w.sizes[Size.N] - w.sizes[Size.FREE], w.sizes[Size.ROWS]
    q = views(w.sizes[Size.FINDER])
    q.sizes[0], q.sizes[1], q.sizes[2], q.sizes[3], q.sizes[4] = 0, d, m, k, 0
    q.sizes[5] = IN_ROWS if k < d else VARIABLES
    q = views(w.sizes[Size.FINDER])
    weight = 1.0
    if not w.sizes[Size.LAST]:
        longest = 0.0
        for i in range(k):
            longest = max(longest, dot(w.W[i], w.W[i], d))
        weight = heavy / longest if longest > 0.0 else heavy
    for c in range(d):
        q.lower[c], q.upper[c], q.side[c] = -inf, inf, 0.0
        q.centre[c], q.metric[c], q.scale[c] = w.centre[c] if w.sizes[Size.LAST] else 0.0, 1.0, 1.0
    q.value[d], q.lower[d], q.upper[d] = 1.0, -inf, inf
    for item in range(m):
        item_in_space(at, item)
        copy(w.R[item], q.G[item, :d])
        q.G[item, d] = 0.0
        free = w.kept[item] != 0.0
        q.lower[d + 1 + item], q.upper[d + 1 + item] = -inf if free else w.low[item], inf if free else w.high[item]
        q.side[d + item] = w.side[item]
    for i in range(k):
        copy(w.W[i], q.G[m + i, :d])
        q.G[m + i, d] = w.a[i]
        q.lower[d + 1 + m + i] = q.upper[d + 1 + m + i] = 0.0
        q.given[i] = weight
    code = answer_near(w.sizes[Size.FINDER])
    w.sizes[Size.STEPS] += q.sizes[7] + q.sizes[8]
    w.sizes[Size.FINDS] += 1
    if code == INACCURATE and q.proof[0] <= NEAR:
        code = SOLVED  # any point will do
    copy(q.value, w.at[:d])
    copy(q.side[d:], w.side)
    return int(code)


@small_kernel
def near_of(w: Space, item: int) -> float:
    """How near to its bound an item is at it."""
    return float(SAME * (1.0 + abs(w.value0[item])))


@small_kernel
def room_of(w: Space, item: int, ahead: float, d: int) -> float:
    """How far an item is from the bound ahead."""
    return float((w.high[item] - dot(w.R[item], w.at, d)) if ahead > 0.0 else (dot(w.R[item], w.at, d) - w.low[item]))


@part
def nearest(at: int) -> float:
    """The step from ``at`` to the nearest least of the working set; its square. What decides nothing does not move."""
    w = space(at)
    d = w.sizes[Size.N] - w.sizes[Size.FREE]
    for c in range(d):
        w.step[c] = w.z[c] - w.at[c]
    for c in range(w.sizes[Size.DECIDED]):
        reflect(w.step, w.P[c], w.beta[c], c, d)
    if not w.sizes[Size.LAST]:
        clear(w.step[w.sizes[Size.DECIDED] : d])
    for c in range(w.sizes[Size.DECIDED] - 1, -1, -1):
        reflect(w.step, w.P[c], w.beta[c], c, d)
    return dot(w.step, w.step, d)


@part
def gains(at: int) -> bool:
    """Whether the level feels the step: by more than rounding of its rows, or of the last level's distance."""
    w = space(at)
    d = w.sizes[Size.N] - w.sizes[Size.FREE]
    gain, size = 0.0, 1.0
    for i in range(w.sizes[Size.ROWS]):
        gain = max(gain, abs(dot(w.W[i], w.step, d)))
        size = max(size, abs(w.a[i] + dot(w.W[i], w.at, d)))
    for c in range(d if w.sizes[Size.LAST] else 0):
        gain, size = max(gain, abs(w.step[c])), max(size, abs(w.at[c]))
    return bool(gain > CANCELS * size)


@part
def cost_of(at: int, d: int) -> float:
    """What the level minimises, at ``at``, twice."""
    w = space(at)
    cost = 0.0
    for i in range(w.sizes[Size.ROWS]):
        cost += (w.a[i] + dot(w.W[i], w.at, d)) ** 2
    for c in range(d if w.sizes[Size.LAST] else 0):
        cost += (w.at[c] - w.centre[c]) ** 2
    return float(cost)


@part
def stopped(at: int, falls: bool) -> bool:
    """Go the step from ``at`` as far as items allow, and hold the one that stops it; False: none does.

    Of those that would be beyond their bounds by no more than what is near, the one that is met most squarely; by
    index, while the cost does not fall.
    """
    w = space(at)
    d = w.sizes[Size.N] - w.sizes[Size.FREE]
    length = sqrt(dot(w.step, w.step, d))
    limit = 1.0
    for item in range(w.sizes[Size.ITEMS]):
        if w.idle[item] == 0.0:
            ahead = dot(w.R[item], w.step, d)
            if abs(ahead) > CANCELS * w.whole[item] * length:
                limit = min(limit, (room_of(w, item, ahead, d) + near_of(w, item)) / abs(ahead))
    found, squarest, share, side = -1, 0.0, 1.0, 0.0
    for item in range(w.sizes[Size.ITEMS]):
        if w.idle[item] == 0.0:
            ahead = dot(w.R[item], w.step, d)
            square = abs(ahead) / w.whole[item] if w.whole[item] > 0.0 else 0.0
            if square > CANCELS * length and square > squarest:
                room = max(room_of(w, item, ahead, d), 0.0) / abs(ahead)
                if room <= limit and room < 1.0:
                    found, squarest, share, side = item, square, room, 1.0 if ahead > 0.0 else -1.0
                    if not falls:
                        break
    if found < 0:
        return False
    add(share, w.step, d, w.at)
    w.side[found] = side
    return True


@part
def descend(at: int) -> bool:
    """The least by a primal active set from ``at``, where all items are within their bounds.

    In each step as far towards the least of the working set as the items allow; the one that stops it is held from then
    on. Where none does, the one that pulls most is let go, as long as the cost falls from one such place to the next.
    While it does not, items meet in one point: then the first by index that pulls is let go, and the first that stops a
    step is held, which cannot go in circles. False: too many changes.

    Nocedal, Wright: Numerical Optimization, 16.5. Chang, Cottle: Least-index resolution of degeneracy in quadratic
    programming, Mathematical Programming 18, 1980.
    """
    w = space(at)
    s = views(w.sizes[Size.CORE])
    m, d = w.sizes[Size.ITEMS], w.sizes[Size.N] - w.sizes[Size.FREE]
    go(at, w.at)
    for item in range(m):
        item_in_space(at, item)
        moved = s.value[place_of(s, item)] - w.value0[item]
        far = moved - (w.high[item] if w.side[item] > 0.0 else w.low[item])
        w.low[item], w.high[item] = min(w.low[item], moved), max(w.high[item], moved)
        if w.kept[item] != 0.0 or not abs(far) <= near_of(w, item):
            w.side[item] = 0.0
        w.idle[item] = w.kept[item]
    lowest, falls = inf, True
    for _ in range(_MOST * m + 1):
        for item in range(m):
            if w.side[item] != 0.0:
                w.idle[item] = 1.0  # those that depend on others, too: nothing moves them either
        hold(at, DEPENDENT)  # a long step would move items that are let go earlier beyond their bounds
        if not nearest(at) < inf:
            return False
        if gains(at):
            if stopped(at, falls):
                continue
            add(1.0, w.step, d, w.at)
        cost = cost_of(at, d)
        falls = cost < lowest * (1.0 - CANCELS)
        lowest = min(cost, lowest)
        let_go, most = -1, 0.0
        for item in range(m):
            w.idle[item] = w.kept[item]
            if w.wrong[item] > most and (falls or let_go < 0):
                let_go, most = item, w.wrong[item]
        if let_go < 0:
            go(at, w.at)
            return True
        w.side[let_go] = 0.0
    return False


@part
def solve_level(at: int) -> int:
    """The answer of a level in ``value``, from the working set in ``side``; or why there is none."""
    w = space(at)
    copy(w.side, w.held)
    read_level(at)
    if guess_set(at):
        return SOLVED
    code, heavy = FAILED, _HEAVY
    for k in range(_FINDS):
        if k == 0 or code == SOLVED:
            copy(w.held, w.side)
        else:  # from the set that led nowhere the core finds the same
            clear(w.side)
        code = find(at, heavy)
        if code == INFEASIBLE and not w.sizes[Size.INSIDE]:
            return code
        if code != SOLVED:
            heavy *= _LESS
            continue
        go(at, w.at)
        begin_here(at)
        w.sizes[Size.INSIDE] = 1
        read_level(at)
        copy(w.side, w.held)
        if guess_set(at):
            return SOLVED
        heavy = min(heavy * _MORE, 1.0 / DEPENDENT)
    if not w.sizes[Size.INSIDE]:
        return code
    copy(w.held, w.side)
    clear(w.at)
    return SOLVED if descend(at) else FAILED
