"""A level: least squares in the space that is left, within bounds, by a working set.

    minimise ½ ‖W z + a‖² [ + ½ ‖z − c‖² in the last level ]      subject to  low ≤ B z ≤ high

z counts from where the level begins. The last rows of W may damp unknowns: they count while the level is decided, and
the levels below need not keep them. For the items that are held, B P = [R 0] with reflections P and R lower triangular
gives their share of P z; what is left of W there, W P = [W_B L 0] after more reflections, gives the rest. So the
products of B and W with themselves are never made in a level above the last. Where nothing decides, z stays 0: any
point of the least is as good, and the levels below choose among them. What held items push with is

    Rᵀ λ = −W_Bᵀ (W z + a) [ − (z − c)_B ]

A held item holds the level back where its push is more than rounding can make of it: ‖R⁻¹ eᵢ‖ times the rounding of the
gradient, which is that of the level's rows times their residuals, and the share that rounding has of a row in this
space times what the gradient and the pushes that balance it are made of. A smaller push says nothing, and levels below
may move the item. Of a push that is not much larger :mod:`~wbc.qp.lexicographic.compiled.rank` says what becomes.

Which items are held says :mod:`~wbc.qp.lexicographic.compiled.search`.

Björck: Numerical Methods for Least Squares Problems, SIAM, 1996, 5.1. Dimitrov, Sherikov, Wieber: Efficient resolution
of potentially conflicting linear constraints in robotics, 2015.
"""

from __future__ import annotations

from math import inf, sqrt

from wbc.compiled import copy, part, small_kernel
from wbc.qp.lexicographic.compiled.space import (
    Size,
    Space,
    gradient_of_own,
    in_space,
    item_in_space,
    known_in_space,
    left_by_rounding,
    reflect,
    reflect_rows,
    reflector,
    space,
    triangular,
)  # fmt: skip
from wbc.qp.rows.compiled.equality import reduced
from wbc.qp.rows.compiled.linear import add, backward, clear, dot, factor, forward, times
from wbc.qp.rows.compiled.work import place_of, views
from wbc.tolerances import CANCELS, ROUNDING, SHARP

#: Newton steps on the last level.
_REFINED = 3


@part
def read_level(at: int) -> None:
    """W and a of the level, and how far items may go from where it begins."""
    w = space(at)
    s = views(w.sizes[Size.CORE])
    n, first, own = w.sizes[Size.N], w.sizes[Size.FIRST], w.sizes[Size.OWN]
    for i in range(w.sizes[Size.ROWS]):
        whole = gradient_of_own(at, i)
        rounding = left_by_rounding(w, whole)
        weight = w.weigh[i] if known_in_space(at, whole, rounding, w.W[i]) > 0.0 else 0.0
        for c in range(n - w.sizes[Size.FREE]):
            w.W[i, c] *= weight
        w.noise[1 + i] = rounding * weight
        if i < own:
            reduced(s, s.G[first + i], w.g)
            w.a[i] = w.weigh[i] * (dot(w.g, w.y0, n) + w.g[n])
        elif w.which[i - own] >= 0:
            w.a[i] = w.weigh[i] * (w.y0[w.which[i - own]] - w.toward[i - own])
        else:
            c = -1 - w.which[i - own]
            w.a[i] = -w.weigh[i] * (dot(s.X[c], w.y0, n) + s.X[c, n])
    for item in range(w.sizes[Size.ITEMS]):
        place = place_of(s, item)
        w.low[item], w.high[item] = s.lower[place] - w.value0[item], s.upper[place] - w.value0[item]
        if w.sizes[Size.INSIDE]:
            w.low[item], w.high[item] = min(w.low[item], 0.0), max(w.high[item], 0.0)
    if w.sizes[Size.LAST]:
        for c in range(n):
            w.g[c] = (s.centre[c] - w.y0[c]) / w.root[c]
        in_space(at, w.centre)


@part
def hold_items(at: int, d: int, dependent: float) -> int:
    """The held items as B P = [R 0], and t such that they are at their bounds; how many there are."""
    w = space(at)
    count = 0
    for item in range(w.sizes[Size.ITEMS]):
        w.push[item] = w.wrong[item] = 0.0
        if w.side[item] != 0.0:
            reach = item_in_space(at, item)
            if not reach > 0.0:
                w.side[item], w.idle[item] = 0.0, 1.0
                continue
            for c in range(d):
                w.B[count, c] = w.R[item, c] / reach
            w.v[count], w.size[count] = reach, max(1.0, w.lost[item] / (reach * dependent))
            w.holds[count] = item
            count += 1
    rank = triangular(at, w.B, count, 0, d, dependent)
    for i in range(rank, count):
        w.side[int(w.holds[w.order[i]])] = 0.0
    for i in range(rank):
        item = int(w.holds[w.order[i]])
        w.item[i], w.reach[i] = item, w.v[w.order[i]]
        w.bound[i] = (w.high[item] if w.side[item] > 0.0 else w.low[item]) / w.reach[i]
    for i in range(rank):
        w.t[i] = (w.bound[i] - dot(w.B[i], w.t, i)) / w.B[i, i]
    clear(w.t[rank:d])
    w.sizes[Size.HELD] = rank
    return rank


@part
def reduce(at: int, rank: int, d: int) -> None:
    """The rest of t in a level that has no curvature of its own: what decides its rows; nothing else moves."""
    w = space(at)
    k = w.sizes[Size.ROWS]
    for i in range(k):
        w.size[i] = max(sqrt(dot(w.W[i], w.W[i], d)), w.noise[1 + i] / ROUNDING)
        w.v[i] = w.a[i] + dot(w.A[i], w.t, rank)
    decided = triangular(at, w.A, k, rank, d, ROUNDING)
    w.sizes[Size.DECIDED] = rank + decided
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


@part
def settle(at: int, rank: int, d: int) -> None:
    """The rest of t in the last level, whose distance from the centre, in ``step``, has curvature 1.

    Newton steps on (t, missing), as in :mod:`wbc.qp.rows.compiled.equality`.
    """
    w = space(at)
    k = w.sizes[Size.ROWS]
    rest = d - rank
    w.sizes[Size.DECIDED] = rank
    copy(w.step[rank:], w.t[rank:d])
    clear(w.missing)
    for i in range(k):
        times(w.A, rank, w.A[i, rank:], 0, i + 1, rest, w.K[i])
        w.K[i, i] += 1.0
    factor(w.K, 0, k, 0.0)
    for _ in range(_REFINED):
        for i in range(k):
            w.rho[i] = w.missing[i] - w.a[i] - dot(w.A[i], w.t, d)
        for c in range(rest):
            w.g[c] = w.step[rank + c] - w.t[rank + c]
        for i in range(k):
            add(-w.missing[i], w.A[i, rank:], rest, w.g)
        for i in range(k):
            w.rho[i] -= dot(w.A[i, rank:], w.g, rest)
        forward(w.K, 0, k, w.rho)
        backward(w.K, 0, k, w.rho)
        for i in range(k):
            add(w.rho[i], w.A[i, rank:], rest, w.g)
            w.missing[i] -= w.rho[i]
        for c in range(rest):
            w.t[rank + c] += w.g[c]


@small_kernel
def beside_rounding(w: Space, i: int, rank: int, force: float, rounding: float) -> float:
    """A force over ‖R⁻¹ eᵢ‖ times the rounding."""
    square = 0.0
    for j in range(i, rank):
        x = 1.0 if j == i else 0.0
        for c in range(i, j):
            x -= w.B[j, c] * w.v[c]
        w.v[j] = x / w.B[j, j]
        square += w.v[j] ** 2
    most = sqrt(square) * rounding
    return force / most if most > 0.0 else 0.0


@part
def hold(at: int, dependent: float) -> None:
    """The least with the items of ``side`` held; what they push with.

    Less those that depend on others: of whose length no more than the share ``dependent`` is left.
    """
    w = space(at)
    s = views(w.sizes[Size.CORE])
    k, d = w.sizes[Size.ROWS], w.sizes[Size.N] - w.sizes[Size.FREE]
    w.sizes[Size.STEPS] += 1
    rank = hold_items(at, d, dependent)
    copy(w.centre, w.step)
    for c in range(rank):
        reflect(w.step, w.P[c], w.beta[c], c, d)
    size, far = 0.0, 0.0
    for i in range(k):
        size += dot(w.W[i], w.W[i], d)
        copy(w.W[i], w.A[i])
        w.order[i] = i
    for c in range(rank):
        reflect_rows(w, w.A, 0, k, c, 0, d)
    if w.sizes[Size.LAST]:
        settle(at, rank, d)
        for c in range(d):
            far += (w.t[c] - w.step[c]) ** 2
    else:
        reduce(at, rank, d)
    worst, square, rounding = 0.0, 0.0, 0.0
    for i in range(k):
        worst = max(worst, abs(w.missing[i]))
        rounding += w.noise[1 + w.order[i]] * abs(w.missing[i])
        square += w.missing[i] * w.missing[i]
    pull = sqrt(size * square) + sqrt(far)
    made_of = pull + sqrt(size) * (sqrt(dot(w.a, w.a, k)) + sqrt(size * dot(w.t, w.t, d)))
    forces = 0.0
    counts = w.sizes[Size.LAST] != 0 or worst > SHARP
    for i in range(rank - 1, -1, -1):
        force, w.rho[i] = w.step[i] - w.t[i] if w.sizes[Size.LAST] else 0.0, 1.0
        for row in range(k):
            force -= w.A[row, i] * w.missing[row]
        for j in range(i + 1, rank):
            force -= w.B[j, i] * w.bound[j]
            w.rho[i] += abs(w.B[j, i]) * w.rho[j]
        w.bound[i], w.rho[i] = force / w.B[i, i], w.rho[i] / abs(w.B[i, i])
        forces += w.bound[i] ** 2
    rounding += w.noise[0] * (made_of + sqrt(forces))
    for i in range(rank):
        item, force = w.item[i], w.bound[i]
        place = place_of(s, item)
        w.push[item] = force / w.reach[i]
        # ``rho`` is no less than ‖R⁻¹ eᵢ‖, and at hand
        is_far_more = abs(force) > w.rho[i] * rounding
        w.holds[i] = inf if is_far_more else beside_rounding(w, i, rank, abs(force), rounding)
        if counts and -force * w.side[item] > CANCELS * pull and s.lower[place] != s.upper[place]:
            w.wrong[item] = -force * w.side[item]
    copy(w.t, w.z)
    for c in range(w.sizes[Size.DECIDED] - 1, -1, -1):
        reflect(w.z, w.P[c], w.beta[c], c, d)
