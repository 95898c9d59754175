"""A level: least squares in the space that is left, within bounds, by a working set.

    minimise ½ ‖W z + a‖² [ + ½ ‖z − c‖² in the last level ]      subject to  low ≤ B z ≤ high

z counts from where the level begins. The last rows of W may damp unknowns: they count while the level is decided, and
the levels below need not keep them. For the items that are held, B P = [R 0] with reflections P and R lower triangular
gives their share of P z; what is left of W there, W P = [W_B L 0] after more reflections, gives the rest. So the
products of B and W with themselves are never made in a level above the last. Where nothing decides, z stays 0: any
point of the least is as good, and the levels below choose among them. What held items push with is

    Rᵀ λ = −W_Bᵀ (W z + a) [ − (z − c)_B ]

The working set is guessed (block principal pivoting). Where that does not end it is found by a descent from a point
where all items are within their bounds.

Björck: Numerical Methods for Least Squares Problems, SIAM, 1996, 5.1. Dimitrov, Sherikov, Wieber: Efficient resolution
of potentially conflicting linear constraints in robotics, 2015.
"""

from __future__ import annotations

from math import floor, inf, sqrt

from wbc.compiled import entry, kernel, small_kernel
from wbc.qp.lexicographic.compiled.space import (
    CORE,
    DECIDED,
    DEPENDENT,
    FIRST,
    FREE,
    HELD,
    INSIDE,
    ITEMS,
    LAST,
    OWN,
    ROWS,
    STEPS,
    N,
    Space,
    begin_here,
    go,
    gradient_of_item,
    gradient_of_own,
    gradient_of_row,
    in_space,
    narrow,
    open_space,
    reflect,
    reflector,
    space,
    triangular,
)  # fmt: skip
from wbc.qp.rows.compiled.equality import evaluate, reduce_base, reduced
from wbc.qp.rows.compiled.linear import add, backward, dot, factor, forward, products
from wbc.qp.rows.compiled.work import FAILED, SOLVED, UNDECIDED, Work, place_of, views

#: Held items depend on others where no more than this share of their length is left: with less, what their bounds are
#: off by would decide where the answer is. Rows of the level beside them have no bounds, and count down to the second.
_HELD, _BESIDE = 1e-7, 1e-12
#: A pull below this share of what it is made of is rounding.
_ROUNDING = 1e-11
#: Pushes above this share of what they push against hold a level back. With less, a level is held by its own rows,
#: which are told apart down to a tenth of this; what is kept for nothing takes freedom from the levels below, unseen.
_HOLDS = 1e-6
#: Residuals up to this are as good as none; up to the second they are too small to say what they are orthogonal to.
_ENOUGH, _SLIGHT = 1e-8, 1e-3
#: Of a level with a residual, rows that reach no further than this out of the others matter in the second order only.
_OWN = 1e-7
#: A level's own rows count from their lengths in its space, or from this share of the whole length.
_BARELY = 1e-4
#: A bound is broken beyond this share of 1 + its size.
_BROKEN = 1e-9
#: Working sets that are guessed; exchanges that may fail to lower the number of wrong items.
_GUESSES, _CHANCES = 8, 3
#: Newton steps on the last level.
_REFINED = 3
#: Steps of a descent for each item, and those that are none.
_MOST, _STILL = 5, 1e-11
#: What a step gains is rounding below this share of what is left of the level.
_GAIN = 1e-11
#: How far bounds are put apart for a descent, for sizes up to the second, and what tells one item from the next.
_APART, _LARGE, _GOLDEN = 1e-10, 1e3, 0.6180339887498949


# ---- the equality problem
@kernel
def read_level(at: int) -> None:
    """W and a of the level, and how far items may go from where it begins."""
    w = space(at)
    s = views(w.sizes[CORE])
    n, first, own = w.sizes[N], w.sizes[FIRST], w.sizes[OWN]
    for i in range(w.sizes[ROWS]):
        whole = gradient_of_own(at, i)
        weight = w.weigh[i] if in_space(at, w.W[i]) > DEPENDENT * whole else 0.0
        for c in range(n - w.sizes[FREE]):
            w.W[i, c] *= weight
        if i < own:
            reduced(s, s.G[first + i], w.g)
            w.a[i] = w.weigh[i] * (dot(w.g, w.y0, n) + w.g[n])
        else:
            w.a[i] = w.weigh[i] * (w.y0[w.which[i - own]] - w.toward[i - own])
    for item in range(w.sizes[ITEMS]):
        place = place_of(s, item)
        w.low[item], w.high[item] = s.lower[place] - w.value0[item], s.upper[place] - w.value0[item]
        if w.sizes[INSIDE]:
            w.low[item], w.high[item] = min(w.low[item], 0.0), max(w.high[item], 0.0)
    if w.sizes[LAST]:
        for c in range(n):
            w.g[c] = (s.centre[c] - w.y0[c]) / w.root[c]
        in_space(at, w.centre)


@kernel
def hold(at: int) -> None:
    """The least with the items of ``side`` held, less those that depend on others; what they push with."""
    w = space(at)
    s = views(w.sizes[CORE])
    k, d = w.sizes[ROWS], w.sizes[N] - w.sizes[FREE]
    w.sizes[STEPS] += 1
    rank = hold_items(at, d)
    for c in range(d):
        w.step[c] = w.centre[c]
    for c in range(rank):
        reflect(w.step, w.P[c], w.beta[c], c, d)
    size, far = 0.0, 0.0
    for i in range(k):
        size += dot(w.W[i], w.W[i], d)
        for c in range(d):
            w.A[i, c] = w.W[i, c]
        for c in range(rank):
            reflect(w.A[i], w.P[c], w.beta[c], c, d)
        w.order[i] = i
    if w.sizes[LAST]:
        settle(at, rank, d)
        for c in range(d):
            far += (w.t[c] - w.step[c]) ** 2
    else:
        reduce(at, rank, d)
    worst, square = 0.0, 0.0
    for i in range(k):
        worst = max(worst, abs(w.missing[i]))
        square += w.missing[i] * w.missing[i]
    pull = sqrt(size * square) + sqrt(far)
    counts = w.sizes[LAST] != 0 or worst > _ENOUGH
    for i in range(rank - 1, -1, -1):
        force = w.step[i] - w.t[i] if w.sizes[LAST] else 0.0
        for row in range(k):
            force -= w.A[row, i] * w.missing[row]
        for j in range(i + 1, rank):
            force -= w.B[j, i] * w.bound[j]
        w.bound[i] = force / w.B[i, i]
    for i in range(rank):
        item, force = w.item[i], w.bound[i]
        place = place_of(s, item)
        w.push[item] = force / w.reach[i]
        w.holds[i] = 1.0 if abs(force) > _HOLDS * pull else 0.0
        if counts and -force * w.side[item] > _ROUNDING * pull and s.lower[place] != s.upper[place]:
            w.wrong[item] = -force * w.side[item]
    for c in range(d):
        w.z[c] = w.t[c]
    for c in range(w.sizes[DECIDED] - 1, -1, -1):
        reflect(w.z, w.P[c], w.beta[c], c, d)


@kernel
def hold_items(at: int, d: int) -> int:
    """The held items as B P = [R 0], and t such that they are at their bounds; how many there are."""
    w = space(at)
    count = 0
    for item in range(w.sizes[ITEMS]):
        w.push[item] = w.wrong[item] = 0.0
        if w.side[item] != 0.0:
            whole = gradient_of_item(at, item)
            reach = in_space(at, w.B[count])
            if not reach > DEPENDENT * whole:
                w.side[item], w.idle[item] = 0.0, 1.0
                continue
            for c in range(d):
                w.B[count, c] /= reach
            w.v[count], w.size[count], w.holds[count] = reach, 1.0, item
            count += 1
    rank = triangular(at, w.B, count, 0, d, w.size, w.order, _HELD)
    for i in range(rank, count):
        w.side[int(w.holds[w.order[i]])] = 0.0
    for i in range(rank):
        item = int(w.holds[w.order[i]])
        w.item[i], w.reach[i] = item, w.v[w.order[i]]
        w.bound[i] = (w.high[item] if w.side[item] > 0.0 else w.low[item]) / w.reach[i]
    for i in range(rank):
        w.t[i] = (w.bound[i] - dot(w.B[i], w.t, i)) / w.B[i, i]
    for c in range(rank, d):
        w.t[c] = 0.0
    w.sizes[HELD] = rank
    return rank


@kernel
def reduce(at: int, rank: int, d: int) -> None:
    """The rest of t in a level that has no curvature of its own: what decides its rows; nothing else moves."""
    w = space(at)
    k = w.sizes[ROWS]
    for i in range(k):
        w.size[i] = sqrt(dot(w.W[i], w.W[i], d))
        w.v[i] = w.a[i] + dot(w.A[i], w.t, rank)
    decided = triangular(at, w.A, k, rank, d, w.size, w.order, _BESIDE)
    w.sizes[DECIDED] = rank + decided
    for i in range(k):
        w.missing[i] = w.v[w.order[i]]
    if decided == k:
        for i in range(k):
            w.t[rank + i] = -(w.missing[i] + dot(w.A[i, rank:], w.t[rank:], i)) / w.A[i, rank + i]
    else:
        for j in range(decided):
            for i in range(k):
                w.T[j, i] = w.A[i, rank + j]
        for i in range(k):
            w.rho[i] = -w.missing[i]
        for j in range(decided):  # L = Q R, whose columns are the rows of T
            beta = reflector(w.T[j], j, k, w.v)
            for i in range(j + 1, decided):
                reflect(w.T[i], w.v, beta, j, k)
            reflect(w.rho, w.v, beta, j, k)
        for j in range(decided - 1, -1, -1):
            x = w.rho[j]
            for i in range(j + 1, decided):
                x -= w.T[i, j] * w.t[rank + i]
            w.t[rank + j] = x / w.T[j, j]
    for i in range(k):
        left = w.missing[i] + dot(w.A[i, rank:], w.t[rank:], decided)
        w.missing[i] = left if decided < k else 0.0


@kernel
def settle(at: int, rank: int, d: int) -> None:
    """The rest of t in the last level, whose distance from the centre, in ``step``, has curvature 1.

    Newton steps on (t, missing), as in :mod:`wbc.qp.rows.compiled.equality`.
    """
    w = space(at)
    k = w.sizes[ROWS]
    rest = d - rank
    w.sizes[DECIDED] = rank
    for c in range(rank, d):
        w.t[c] = w.step[c]
    for i in range(k):
        w.missing[i] = 0.0
    for i in range(k if k <= rest else 0):
        products(w.A[:, rank:], i, 0, rest, w.K[i])
        w.K[i, i] += 1.0
    factor(w.K, 0, k if k <= rest else 0, 0.0)
    for i in range(rest if k > rest else 0):
        for c in range(i + 1):
            w.H[i, c] = 0.0
        w.H[i, i] = 1.0
        for row in range(k):
            add(w.A[row, rank + i], w.A[row, rank:], i + 1, w.H[i])
    factor(w.H, 0, rest if k > rest else 0, 0.0)
    for _ in range(_REFINED):
        for i in range(k):
            w.rho[i] = w.missing[i] - w.a[i] - dot(w.A[i], w.t, d)
        for c in range(rest):
            w.g[c] = w.step[rank + c] - w.t[rank + c]
        for i in range(k):
            add(-w.missing[i], w.A[i, rank:], rest, w.g)
        if k <= rest:
            for i in range(k):
                w.rho[i] -= dot(w.A[i, rank:], w.g, rest)
            forward(w.K, 0, k, w.rho)
            backward(w.K, 0, k, w.rho)
            for i in range(k):
                add(w.rho[i], w.A[i, rank:], rest, w.g)
                w.missing[i] -= w.rho[i]
        else:
            for i in range(k):
                add(w.rho[i], w.A[i, rank:], rest, w.g)
            forward(w.H, 0, rest, w.g)
            backward(w.H, 0, rest, w.g)
            for i in range(k):
                w.missing[i] += dot(w.A[i, rank:], w.g, rest) - w.rho[i]
        for c in range(rest):
            w.t[rank + c] += w.g[c]


# ---- the working set
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
        is_lower = cost < lowest * (1.0 - _ROUNDING)
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
    return bool(gain > (_GAIN * (1.0 + sqrt(left))) ** 2)


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
