"""The finite method: a dual active-set method on the factors of :mod:`wbc.qp.rows.compiled.equality`.

It starts from the best guess, less what pushes the wrong way there. Each step takes the item n that is broken most and
raises its push by t. With f = M^−½ n, the held rows' pushes change by −t r, K r = F f, and the violation shrinks by
t (|f − Fᵀ r|² + rᵀ C r). The first event ends the step: the item is met and held, or a push comes to zero and its item
is let go. The cost of the optimum grows with each item that is held, so that no working set comes twice. Where nothing
is left of f and no push comes to zero, −r combines the held rows to a contradiction. One that is none once each row may
be off by what counts as met leaves the item as it is, and the certificate judges.

Goldfarb, Idnani: A numerically stable dual method for solving strictly convex quadratic programs, Mathematical
Programming 27, 1983.
"""

from __future__ import annotations

from math import inf, sqrt

from wbc.compiled import copy, part
from wbc.qp.rows.compiled.equality import (
    back,
    compliance,
    evaluate,
    factor_metric,
    factor_rows,
    first_row,
    half,
    place,
    step,
    write_row,
)  # fmt: skip
from wbc.qp.rows.compiled.linear import add, add_rows, backward, clear, dot, forward, remove, times
from wbc.qp.rows.compiled.verify import beyond, disproved, largest_push
from wbc.qp.rows.compiled.work import FAILED, INFEASIBLE, SOLVED, is_fixed, place_of, views, weighed
from wbc.tolerances import ROUNDING, SAME

#: What cancels to a smaller share is computed once more from what is left.
_CANCELLED = 1e-2
#: Steps after which the pushes are computed anew.
_ANEW = 10
#: Steps for each item, and beside these. Of thousands of random problems those that were solved took 1.3 an item at
#: most; where rounding leads in circles the search ends here.
_MOST, _ALWAYS = 3, 50
#: The mark of an item that is met only within rounding beside those held: the certificate judges it.
_SKIP = 9.0


@part
def direction(at: int, item: int) -> float:
    """Row m, not held yet: r (in ``rho``), L⁻¹ F f (in K[m]), t = f − Fᵀ r, and its room |t|² + rᵀ C r."""
    s = views(at)
    ny, ns, m, first = s.sizes[1], weighed(s), s.sizes[6], first_row(s)
    write_row(s, m, item)
    half(s, s.E[m], s.F[m])
    s.length[m] = dot(s.F[m], s.F[m], ny)
    copy(s.F[m], s.t[:ny])
    for i in range(first, m):
        s.K[m, i] = s.rho[i] = 0.0
    room = s.length[m]
    for _ in range(3):
        times(s.F, 0, s.t, first, m, ny, s.a)
        for i in range(first, m):
            s.a[i] -= compliance(s, i) * s.rho[i]
        forward(s.K, first, m, s.a)
        add(1.0, s.a[first:], m - first, s.K[m][first:])
        backward(s.K, first, m, s.a)
        add(1.0, s.a[first:], m - first, s.rho[first:])
        add_rows(-1.0, s.a, s.F, first, m, ny, s.t)
        before, room = room, dot(s.t, s.t, ny)
        for i in range(first, min(m, ns)):
            room += compliance(s, i) * s.rho[i] ** 2
        if room > _CANCELLED * before:
            break
    return float(room)


@part
def hold(at: int, item: int) -> None:
    """An item whose side is set becomes the next row of the factors; free again if it depends on those held."""
    s = views(at)
    m = s.sizes[6]
    room = direction(at, item)
    if m - weighed(s) >= s.sizes[1] or not room > SAME**2 * s.length[m]:
        s.side[item] = 0.0
        return
    s.K[m, m], s.lam[m], s.sizes[6] = 1.0 / sqrt(room), 0.0, m + 1


@part
def let_go(at: int, j: int) -> None:
    """Row j of the factors is held no longer."""
    s = views(at)
    m = s.sizes[6]
    s.side[s.item[j]] = 0.0
    remove(s.K, first_row(s), m, j)
    for i in range(j, m - 1):
        s.item[i], s.lam[i], s.length[i] = s.item[i + 1], s.lam[i + 1], s.length[i + 1]
        copy(s.E[i + 1], s.E[i])
        copy(s.F[i + 1], s.F[i])
    s.sizes[6] = m - 1


@part
def start(at: int) -> bool:
    """Hold what is fixed and, of the best guess, what pushes the right way. False: M or K is singular."""
    s = views(at)
    ny, ns = s.sizes[1], weighed(s)
    clear(s.side)
    for c in range(ny):
        s.free[c] = 1.0
    if not factor_metric(at):
        return False
    if factor_rows(at, ns, 0.0):
        return False
    s.sizes[6] = ns
    place(at)
    for fixed in (True, False):
        for item in range(len(s.side)):
            if is_fixed(s, item) == fixed and (fixed or s.best[item] != 0.0):
                s.side[item] = 1.0 if fixed else s.best[item]
                hold(at, item)
    step(at, True)
    left = 1
    while left:
        step(at, False)
        largest, left = largest_push(s), 0
        for i in range(s.sizes[6] - 1, ns - 1, -1):
            side = s.side[s.item[i]]
            if not is_fixed(s, s.item[i]) and s.lam[i] * side > 0.0:
                if s.lam[i] * side * sqrt(s.length[i]) > ROUNDING * largest:
                    let_go(at, i)
                    left += 1
                else:
                    s.lam[i] = 0.0
    return True


@part
def most_broken(at: int) -> int:
    """The free item that breaks its bounds most; −1 where none does."""
    s = views(at)
    found, most = -1, 1.0
    for item in range(len(s.side)):
        if s.side[item] == 0.0 and s.best[item] != _SKIP:
            by = beyond(s, item)
            if not by <= most * (1.0 + SAME):
                found, most = item, by
    return found


@part
def admit(at: int, item: int) -> int:
    """Raise the push of a broken item, letting go what would push the wrong way, until it is met and held.

    INFEASIBLE: the held rows contradict it; the multipliers of the contradiction are in ``push``.
    """
    s = views(at)
    nu, ny, ns, first = s.sizes[0], s.sizes[1], weighed(s), first_row(s)
    place_, first_item = place_of(s, item), nu + ny + 1
    sigma = 1.0 if s.value[place_] > s.upper[place_] else -1.0
    push = 0.0
    while True:
        s.side[item] = sigma
        room, m = direction(at, item), s.sizes[6]
        size = sqrt(s.length[m])
        for i in range(ns, m):
            size = max(size, abs(s.rho[i]) * sqrt(s.length[i]))
        blocking, first_stop = -1, inf
        for i in range(ns, m):
            held = s.item[i]
            rate = sigma * s.rho[i] * s.side[held]
            if not is_fixed(s, held) and rate * sqrt(s.length[i]) > ROUNDING * size:
                stop = max(-s.lam[i] * s.side[held], 0.0) / rate
                if stop < first_stop * (1.0 - SAME):
                    blocking, first_stop = i, stop
        depends = m - ns >= ny or not room > SAME**2 * s.length[m]
        if depends and blocking < 0:
            clear(s.push)
            if item >= ny:
                s.push[place_ - first_item] = sigma
            for i in range(ns, m):
                held = s.item[i]
                if held >= ny and (is_fixed(s, held) or -sigma * s.rho[i] * s.side[held] > 0.0):
                    s.push[place_of(s, held) - first_item] = -sigma * s.rho[i]
            return INFEASIBLE
        broken = max(sigma * (dot(s.E[m], s.value[nu:], ny) + s.E[m, ny]), 0.0)
        t = inf if depends else broken / room
        is_met = t <= first_stop
        t = min(t, first_stop)
        if not depends:
            back(s, s.t)
            add(-sigma * t, s.t, ny, s.value[nu:])
        add(sigma * t, s.rho[first:], m - first, s.lam[first:])
        push -= sigma * t
        if is_met or blocking < 0:
            s.K[m, m], s.lam[m], s.sizes[6] = 1.0 / sqrt(room), push, m + 1
            return SOLVED
        let_go(at, blocking)


@part
def finite(at: int) -> int:
    """The optimum, or the proof that there is none, in finitely many steps from the guess in ``best``."""
    s = views(at)
    nothing = 0.0
    for i in range(len(s.G)):
        for c in range(s.sizes[0] + s.sizes[1] + 1):
            nothing += 0.0 * s.G[i, c]
    if nothing != 0.0 or not start(at):  # NaN is not zero
        return FAILED
    limit = _MOST * len(s.side) + _ALWAYS
    while s.sizes[8] < limit:
        s.sizes[8] += 1
        evaluate(at)
        item = most_broken(at)
        if item < 0:
            return SOLVED
        if admit(at, item) == INFEASIBLE:
            if disproved(at):
                return INFEASIBLE
            s.side[item] = 0.0  # what cannot be proven may have been drift
            step(at, False)
            evaluate(at)
            if not beyond(s, item) <= 1.0:
                s.best[item] = _SKIP
        if s.sizes[8] % _ANEW == 0:
            step(at, False)
    return FAILED
