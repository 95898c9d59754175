"""The verdict on an answer: what breaks its bounds, what pushes the wrong way, and the certificate.

The cost of a row problem has a diagonal D and the rows of its tasks, so that nothing is factored to bound the distance
from the optimum (:mod:`wbc.qp.certificate`). A push πᵢ on each row, in units of the cost over ``unit``, splits
the gradient into what is left of the unknowns and of the rows of the tasks:

    r_D = D (y − c) + Gᵀ π + z ,      ρ = S x̂ − π / w ,      |x̂ − x̃|_H ≤ √( r_Dᵀ D⁻¹ r_D + ρᵀ w ρ )

Every split is true; the working set gives the one it has. The rest is decided here:

* a range row that pushes on a bound that is not met within 1e-6, or on no bound, does not push;
* the rows that determine u push with what makes r_D zero on u, B_uᵀ π_B = −(G_uᵀ π + ε u): one solve and one
  refinement;
* a bound that an unknown meets takes the part of r_D that it can push against, z.

A push of 1e6 leaves its rounding in the gradient, 1e-10. This split measures that by D, as if no task resisted, and a
task of weight 1e-6 then seems to be far from its optimum. Where it says too little, :func:`split` finds the best one:
what is left goes to the rows that resist it, with (dy, dλ) of the Newton step for r_D alone,

    r_D := r_D − Eᵀ dλ ,      ρ := ρ + dλ / w ,      of which r_Dᵀ D⁻¹ r_D + ρᵀ w ρ = |dy|²_H is the least.
"""

from __future__ import annotations

from math import inf, sqrt

from wbc.compiled import copy, part, small_kernel
from wbc.qp.rows.compiled.equality import compliance, correct, first_row, reduced
from wbc.qp.rows.compiled.linear import add, add_rows, backward, clear, dot, forward
from wbc.qp.rows.compiled.work import Work, bound_of, is_fixed, place_of, views, weighed
from wbc.tolerances import DISTANCE, MET, NEAR, ROUNDING

#: An unknown whose cost is at most this many times the regularisation belongs to no task. No task asks for its value,
#: so it is only demanded that it can be no farther from its optimum than its own size (1 + |y|).
ALONE = 1.5
#: A bound is broken beyond this share of 1 + its size; held rows are brought to within it.
_BROKEN = 1e-10
#: How far a proof that there is no answer reaches [unit of the unknowns]: what is left of a gradient there counts.
_RADIUS = 1.0 / NEAR
#: A wrong push may be worth this part of what is near enough: it is left out, and the certificate counts it.
_WORTHLESS = 1e-3


@small_kernel
def weigh(s: Work) -> bool:
    """Weights over the unit, what they are the inverse of, and what a unit of distance is. False: no weights at all."""
    nu, ny, ns, unit, sound = s.sizes[0], s.sizes[1], s.sizes[3], s.unit[0], 0
    scale, reach = s.scale[nu:], s.reach[ns:]
    for k in range(ns + nu):
        given = s.given[k] if k < ns else s.numbers[0]
        if not 0.0 <= given < inf:
            return False
        s.weights[k] = given / unit
        s.compliance[k] = unit / given if given > 0.0 else 0.0
        if k < ns:
            s.reach[k] = 1.0 / sqrt(given) if given > 0.0 else 0.0
    for c in range(ny):
        sound += int(0.0 < s.metric[c]) & int(s.metric[c] < inf)
        reach[c] = scale[c] / sqrt(unit * s.metric[c])
    return bool(sound == ny)


@small_kernel
def certified(s: Work) -> bool:
    """Whether the certificate in ``proof`` holds."""
    return bool(
        s.proof[0] <= MET
        and s.proof[1] <= MET * s.proof[3]
        and s.proof[2] <= MET * s.proof[4]
        and s.proof[5] <= DISTANCE * MET
        and s.proof[4] < inf
    )


@part
def certify(at: int) -> bool:
    """Whether the answer in ``value`` with the pushes ``push`` of range rows, tasks and equalities is certified.

    ``push`` gets those of the rows of u, ``z`` the multipliers of the bounds, ``left`` what is left of the gradient and
    ``proof`` primal, dual, gap, the scales of these two, distance and spread.
    """
    s = views(at)
    n_u, n_y, n_range, n_soft = s.sizes[0], s.sizes[1], s.sizes[2], s.sizes[3]
    n, first_soft, rows = n_u + n_y, n_u + n_range, len(s.G)
    items, first_equal, unit, regular = n + 1, first_soft + n_soft, s.unit[0], s.numbers[0] / s.unit[0]
    push, value, z = s.push, s.value, s.z
    primal, gap, largest, cost = 0.0, 0.0, 0.0, 0.0
    for i in range(n_u):
        size = abs(value[items + i])
        primal = primal if size <= primal else size
        over, under = value[i] - s.upper[i], s.lower[i] - value[i]
        worst = max(over, under) * s.scale[i]
        primal = primal if worst <= primal else worst
        push[i] = 0.0
    for i in range(n_u, rows):
        if first_soft <= i < first_equal:
            continue
        over, under = value[items + i] - s.upper[items + i], s.lower[items + i] - value[items + i]
        worst = max(over, under)
        primal = primal if worst <= primal else worst
        slack = over if push[i] > 0.0 else under
        if push[i] != 0.0:
            if not slack >= -MET:
                push[i] = 0.0
            gap += abs(push[i] * slack)
    for c in range(n):
        z[c] = regular * value[c] if c < n_u else 0.0
    add_rows(1.0, push, s.G, n_u, rows, n, z)
    for _ in range(2 if n_u else 0):
        copy(z, s.base)
        add_rows(1.0, push, s.G, 0, n_u, n_u, s.base)
        forward(s.B, 0, n_u, s.base)
        backward(s.B, 0, n_u, s.base)
        add(-1.0, s.base, n_u, push)
    add_rows(1.0, push, s.G, 0, n_u, n, z)
    clear(z[:n_u])
    of_rows = value[items:]
    for i in range(rows):
        largest = max(largest, abs(push[i]))
        cost += abs(push[i]) * (1.0 + abs(of_rows[i]))
    square, dual, distance, bent = 0.0, 0.0, 0.0, 0.0
    for j in range(n_y):
        c = n_u + j
        away = s.metric[j] * (value[c] - s.centre[j])
        bent = max(bent, abs(away))
        left = z[c] + away
        over, under = (value[c] - s.upper[c]) * s.scale[c], (s.lower[c] - value[c]) * s.scale[c]
        worst = max(over, under)
        primal = primal if worst <= primal else worst
        held = 0.0
        if (left < 0.0 and over >= -MET) or (left > 0.0 and under >= -MET):
            held, left = left, 0.0
            room = s.upper[c] - value[c] if held < 0.0 else value[c] - s.lower[c]
            gap += abs(held) * max(room, 0.0)
            cost += abs(held) * (1.0 + abs(value[c]))
        z[c], s.left[j] = -held, left
        dual = dual if abs(left) <= dual else abs(left)
        square += left * left / s.metric[j]
        share = s.reach[n_soft + j] / (1.0 + abs(value[c] * s.scale[c]))
        if unit * s.metric[j] <= ALONE * s.numbers[0]:
            share *= DISTANCE * MET
        distance = max(distance, share)
    for i in range(n_soft):
        rho = value[items + first_soft + i] - push[first_soft + i] * s.compliance[i]
        square += rho * rho * s.weights[i]
        distance = max(distance, s.reach[i] / (1.0 + abs(s.G[first_soft + i, n])))
    spread = sqrt(unit * square)
    s.proof[0], s.proof[1], s.proof[2] = primal, unit * dual, unit * gap
    s.proof[3], s.proof[4] = 1.0 + unit * (largest + bent), 1.0 + unit * cost
    s.proof[5], s.proof[6] = distance * spread, spread
    s.numbers[1] = MET / (sqrt(unit) * distance) if distance > 0.0 else 0.0
    return certified(s)


@part
def split(at: int) -> None:
    """Certify the answer by the best split. The step is in ``rho`` and ``t``, for :func:`move`."""
    s = views(at)
    nu, ny, nr, ns, m, first = s.sizes[0], s.sizes[1], s.sizes[2], s.sizes[3], s.sizes[6], first_row(s)
    first_item, first_soft, first_held, square = nu + ny + 1, nu + nr, weighed(s), 0.0
    for k in range(ns):
        s.push[first_soft + k] = s.weights[k] * s.value[first_item + first_soft + k]
    certify(at)
    for c in range(ny):
        s.r[c] = -s.left[c]
    clear(s.rho)
    correct(at, False)
    for i in range(m):
        d = s.rho[i] if i >= first else -s.weights[i] * dot(s.E[i], s.t, ny)
        if i < first_held:
            square += compliance(s, i) * d * d
        elif s.item[i] < ny or not (
            is_fixed(s, s.item[i]) or abs(d) <= abs(s.push[place_of(s, s.item[i]) - first_item])
        ):
            d = 0.0  # bounds of y take what is left; a push may not change its sign
        s.a[i] = d
    add_rows(-1.0, s.a, s.E, 0, m, ny, s.left)
    for c in range(ny):
        if s.z[nu + c] != 0.0:
            held = s.left[c] - s.z[nu + c]
            s.left[c] = 0.0 if held * s.z[nu + c] < 0.0 else held
        square += s.left[c] * s.left[c] / s.metric[c]
    spread = sqrt(s.unit[0] * square)
    s.proof[5] *= spread / s.proof[6]
    s.proof[6] = spread


@small_kernel
def what_counts(s: Work, item: int) -> float:
    """By how much an item has to be beyond its nearest bound to be broken."""
    place = place_of(s, item)
    return float(_BROKEN * (1.0 + abs(s.upper[place] if s.value[place] > s.upper[place] else s.lower[place])))


@small_kernel
def beyond(s: Work, item: int) -> float:
    """By how much an item breaks its bounds, beside what counts: more than 1 is broken, and NaN is."""
    place = place_of(s, item)
    v, low, high = s.value[place], s.lower[place], s.upper[place]
    if v > high:
        return float((v - high) / what_counts(s, item))
    if v < low:
        return float((low - v) / what_counts(s, item))
    return 0.0 if low <= v <= high else inf


@small_kernel
def off(s: Work, item: int) -> float:
    """How far a held item is from its bound, on either side, beside what counts."""
    bound = bound_of(s, item)
    return float(abs(s.value[place_of(s, item)] - bound) / (_BROKEN * (1.0 + abs(bound))))


@small_kernel
def largest_push(s: Work) -> float:
    """The largest push of a row of E, in lengths of F."""
    nu, nr, m, first = s.sizes[0], s.sizes[2], s.sizes[6], first_row(s)
    largest = 0.0
    for i in range(first, m):
        largest = max(largest, abs(s.lam[i]) * sqrt(s.length[i]))
    for k in range(min(first, s.sizes[3])):
        rho = s.value[nu + s.sizes[1] + 1 + nu + nr + k]
        largest = max(largest, abs(rho) * sqrt(s.weights[k]))
    return largest


@small_kernel
def pushes_wrong(s: Work, push: float, side: float, length: float, largest: float) -> bool:
    """Whether to leave this push out would move the answer, and it is not rounding of the others."""
    return bool(push * side * length > max(ROUNDING * largest, _WORTHLESS * s.numbers[1]))


@small_kernel
def doubt(s: Work, item: int) -> float:
    """How far the certificate lets an item be from where the optimum of the working set has it: ‖row‖_{D⁻¹} spread."""
    nu, ny = s.sizes[0], s.sizes[1]
    square = 0.0
    if item < ny:
        square = 1.0 / s.metric[item]
    else:
        reduced(s, s.G[place_of(s, item) - nu - ny - 1], s.t)
        for c in range(ny):
            square += s.t[c] * s.t[c] / s.metric[c]
    return float(sqrt(square / s.unit[0]) * s.proof[6])


@part
def verify(at: int) -> int:
    """Certify the answer with the pushes of the working set that have the right sign; how many items are wrong.

    These are marked in ``wrong``; ``numbers[2]`` is how far items that push are from their bounds, and held ones beyond
    them, beside what counts. While all pushes have the right sign, an item that is broken by less than the answer is
    uncertain is not wrong: refining tells.
    """
    s = views(at)
    nu, ny, nr, ns, m = s.sizes[0], s.sizes[1], s.sizes[2], s.sizes[3], s.sizes[6]
    first_item, first_soft, first_held = nu + ny + 1, nu + nr, weighed(s)
    if first_row(s):
        for k in range(ns):
            s.lam[k] = -s.weights[k] * s.value[first_item + first_soft + k]
    largest, count = largest_push(s), 0
    clear(s.push)
    for k in range(ns):
        s.push[first_soft + k] = -s.lam[k]
    for i in range(first_held, m):
        item = s.item[i]
        if item >= ny and (is_fixed(s, item) or s.lam[i] * s.side[item] < 0.0):
            s.push[place_of(s, item) - first_item] = -s.lam[i]
    certify(at)
    clear(s.wrong)
    s.numbers[2] = 0.0
    for i in range(first_held, m):
        item = s.item[i]
        if s.lam[i] != 0.0:
            s.numbers[2] = max(s.numbers[2], off(s, item))
        if item >= ny and not is_fixed(s, item):
            if pushes_wrong(s, s.lam[i], s.side[item], sqrt(s.length[i]), largest):
                count += 1
                s.wrong[item] = 1.0
    for c in range(ny):
        if s.side[c] != 0.0 and not is_fixed(s, c):
            if pushes_wrong(s, s.left[c], s.side[c], 1.0 / sqrt(s.metric[c]), largest):
                count += 1
                s.wrong[c] = 1.0
    push_right = count == 0
    for item in range(len(s.side)):
        by = beyond(s, item)
        if s.side[item] != 0.0:
            s.numbers[2] = max(s.numbers[2], by)
        elif not by <= 1.0 and not (push_right and by * what_counts(s, item) <= doubt(s, item)):
            count += 1
            s.wrong[item] = 1.0
    return count


@part
def exchange(at: int) -> None:
    """All that is wrong leaves the working set or enters it."""
    s = views(at)
    for item in range(len(s.side)):
        if s.wrong[item] != 0.0:
            if s.side[item] != 0.0:
                s.side[item] = 0.0
            else:
                s.side[item] = 1.0 if s.value[place_of(s, item)] > s.upper[place_of(s, item)] else -1.0


@part
def disproved(at: int) -> bool:
    """Whether the multipliers in ``push`` (range rows, equalities) and bounds of y prove that no point meets them all.

    Farkas: their sum cancels in every unknown, and what the bounds allow of it is less than its constant, even if each
    is off by what counts as met; what does not cancel must be too little for every y within a radius.
    """
    s = views(at)
    nu, ny = s.sizes[0], s.sizes[1]
    n, first_item = nu + ny, nu + ny + 1
    constant, support, size, left, forces = 0.0, 0.0, 0.0, 0.0, 0.0
    clear(s.base)
    clear(s.z[nu:])
    for item in range(ny, len(s.side)):
        place = place_of(s, item)
        row, force = s.G[place - first_item], s.push[place - first_item]
        if force != 0.0:
            add(force, row, nu, s.base)
            add(force, row[nu:], ny, s.z[nu:])
            constant += force * row[n]
            bound = s.upper[place] if force > 0.0 else s.lower[place]
            support += force * bound
            size += abs(force) * (1.0 + abs(row[n]) + abs(bound))
            forces += abs(force)
    forward(s.B, 0, nu, s.base)
    backward(s.B, 0, nu, s.base)
    for j in range(nu):
        force = -s.base[j]
        s.push[j] = force
        add(force, s.G[j][nu:], ny, s.z[nu:])
        constant += force * s.G[j, n]
        size += abs(force * s.G[j, n])
        forces += abs(force)
    for c in range(nu):
        sum_of = 0.0
        for i in range(len(s.G)):
            sum_of += s.push[i] * s.G[i, c]
        left += abs(sum_of)
    for c in range(nu, n):
        force = -s.z[c]
        bound = s.upper[c] if force > 0.0 else s.lower[c]
        s.z[c] = 0.0
        if force == 0.0 or abs(bound) == inf:
            left += abs(force)
        else:
            s.z[c] = force
            support += force * bound
            size += abs(force) * (1.0 + abs(bound))
            forces += abs(force)
    margin = constant - support - MET * forces - _BROKEN * size
    return bool(margin > 0.0 and margin > _RADIUS * left)
