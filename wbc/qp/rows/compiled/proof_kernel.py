"""The certificate of :mod:`wbc.qp.rows.proof` as one compiled function: the same steps, the same letters."""

from __future__ import annotations

from math import inf, sqrt

from wbc.compiled import kernel
from wbc.qp.rows.compiled.linear import solve
from wbc.types import Mat, Vec

#: As in the reference: an answer is certified at this tolerance, and within a hundred times that of the optimum.
_TOLERANCE, _DISTANCE = 1e-6, 1e-4


@kernel
def certify(G: Mat, value: Vec, lower: Vec, upper: Vec, metric: Vec, centre: Vec, weights: Vec, compliance: Vec,
            reach: Vec, scale: Vec, factor: Mat, push: Vec, z: Vec, slope: Vec, base: Vec, n_u: int, n_y: int,
            n_range: int, n_soft: int, n_law: int, unit: float, regular: float, proof: Vec) -> bool:  # fmt: skip
    """Whether the answer in ``value`` with these pushes (n_rows,) is certified.

    ``factor`` is the Cholesky factor of B_u with the inverse of its diagonal. ``proof`` becomes primal, dual, gap, the
    scales of these two, distance and spread; ``z`` (n,) the multipliers of the bounds and ``slope`` (n_y,) what is left
    of the gradient. ``regular`` is the regularisation of u over ``unit``.
    """
    n, first_soft = n_u + n_y, n_u + n_range
    rows, items, first_law = first_soft + n_soft + n_law, n + 1, first_soft + n_soft
    primal, gap, largest, cost = 0.0, 0.0, 0.0, 0.0
    for i in range(n_u):
        size = abs(value[items + i])
        primal = primal if size <= primal else size
        push[i] = 0.0
    for i in range(first_law, rows):
        size = abs(value[items + i])
        primal = primal if size <= primal else size
    for i in range(n_u, first_soft):
        at = value[items + i]
        over, under = at - upper[items + i], lower[items + i] - at
        worst = max(over, under)
        primal = primal if worst <= primal else worst
        slack = over if push[i] > 0.0 else under
        if push[i] != 0.0:
            if not slack >= -_TOLERANCE:
                push[i] = 0.0
            gap += abs(push[i] * slack)
    for _ in range(2):
        for c in range(n_u):
            base[c] = regular * value[c]
        for i in range(rows):
            share, row = push[i], G[i]
            if share != 0.0:
                for c in range(n_u):
                    base[c] += share * row[c]
        solve(factor, n_u, base)
        for c in range(n_u):
            push[c] -= base[c]
    for c in range(n_u, n):
        z[c] = 0.0
    for i in range(rows):
        share, row = push[i], G[i]
        largest = max(largest, abs(share))
        cost += abs(share) * (1.0 + abs(value[items + i]))
        if share != 0.0:
            for c in range(n_u, n):
                z[c] += share * row[c]
    square, dual, distance, bent = 0.0, 0.0, 0.0, 0.0
    for j in range(n_y):
        c = n_u + j
        away = metric[j] * (value[c] - centre[j])
        bent = max(bent, abs(away))
        left = z[c] + away
        over, under = (value[c] - upper[c]) * scale[c], (lower[c] - value[c]) * scale[c]
        worst = max(over, under)
        primal = primal if worst <= primal else worst
        held = 0.0
        if (left < 0.0 and over >= -_TOLERANCE) or (left > 0.0 and under >= -_TOLERANCE):
            held, left = left, 0.0
            room = upper[c] - value[c] if held < 0.0 else value[c] - lower[c]
            gap += abs(held) * max(room, 0.0)
            cost += abs(held) * (1.0 + abs(value[c]))
        z[c], slope[j] = -held, left
        dual = dual if abs(left) <= dual else abs(left)
        square += left * left / metric[j]
        distance = max(distance, reach[n_soft + j] / (1.0 + abs(value[c] * scale[c])))
    for i in range(n_soft):
        at = first_soft + i
        rho = value[items + at] - push[at] * compliance[i]
        square += rho * rho * weights[i]
        distance = max(distance, reach[i] / (1.0 + abs(G[at, n])))
    spread = sqrt(unit * square)
    proof[0], proof[1], proof[2] = primal, unit * dual, unit * gap
    proof[3], proof[4] = 1.0 + unit * (largest + bent), 1.0 + unit * cost
    proof[5], proof[6] = distance * spread, spread
    return bool(
        primal <= _TOLERANCE
        and proof[1] <= _TOLERANCE * proof[3]
        and proof[2] <= _TOLERANCE * proof[4]
        and proof[5] <= _DISTANCE
        and proof[4] < inf
    )
