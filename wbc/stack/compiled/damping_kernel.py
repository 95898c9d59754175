"""The damping of :class:`~wbc.stack.damping.ResidualDamping`, compiled: one task after the other."""

from __future__ import annotations

from math import inf, sqrt

from wbc.compiled import carray, floats, integers, kernel, part
from wbc.types import Mat, Vec

#: What :func:`observe` found: nothing to do, or another damping.
UNCHANGED, CHANGED = 0, 1
#: The Jacobian may grow by this factor before a residual that needed no damping is looked at again.
_GROWTH = 2.0
#: What counts as a small angle: a residual over the lever of a joint.
_WELL = 0.01


@kernel
def _asked(factor: float, square: float, lever: Vec, out: Vec) -> None:
    """Weight s² l / (s + l/100) for each joint, s = factor √square."""
    s = factor * sqrt(square)
    for j in range(len(lever)):
        out[j] = s * s * lever[j] / (s + _WELL * lever[j]) if lever[j] > 0.0 else 0.0


@kernel
def _squares(G: Mat, weights: Vec, start: int, stop: int, out: Vec) -> float:
    """Σ w J² over these rows for each of the first columns, as many as ``out`` has; the largest of them.

    Rows behind those that have a weight are constraints, of weight 1.
    """
    largest = 0.0
    for c in range(len(out)):
        out[c] = 0.0
        for i in range(start, stop):
            out[c] += (weights[i] if i < len(weights) else 1.0) * G[i, c] ** 2
        largest = max(largest, out[c])
    return largest


@part
def observe(at: int) -> int:
    """Read what the last answer left of each task; the damping that it needs: none where a number is not finite."""
    m = carray(integers(at), 21)
    sizes = carray(integers(m[0]), 8)
    tasks, rows, nj, width, column = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4]
    held, weighed, all_rows = sizes[5], sizes[6], sizes[7]
    first = carray(integers(m[1]), tasks + 1)
    numbers = carray(floats(m[2]), 4)  # λ | step | residual that needs no damping | 1 where one is damped
    G, left_of = carray(floats(m[3]), (rows, width)), carray(floats(m[4]), rows)
    weights, gain, kd = carray(floats(m[5]), rows), carray(floats(m[6]), rows), carray(floats(m[7]), rows)
    e, base, applied = carray(floats(m[8]), rows), carray(floats(m[9]), nj), carray(floats(m[10]), nj)
    asked, rate, residual = carray(floats(m[11]), (tasks, nj)), carray(floats(m[12]), nj), carray(floats(m[13]), rows)
    lever, needed, most = carray(floats(m[14]), nj), carray(floats(m[15]), nj), carray(floats(m[16]), nj)
    rows_of, G_held = carray(integers(m[17]), (held, 2)), carray(floats(m[18]), (all_rows, width))
    weights_held, square_of = carray(floats(m[19]), weighed), carray(floats(m[20]), (2, column + nj))
    was_on, largest = False, 0.0
    for j in range(nj):
        was_on = was_on or applied[j] != 0.0
        needed[j] = most[j] = rate[j] = 0.0
    for i in range(rows):
        residual[i] = abs(left_of[i])
        largest = max(largest, residual[i])
    numbers[3] = 0.0
    if largest <= numbers[2] and not was_on:
        return UNCHANGED
    finite = True
    for t in range(tasks):
        square, possible, fastest, damps = 0.0, 0.0, 0.0, 0.0
        for i in range(first[t], first[t + 1]):
            left = residual[i] / gain[i] if gain[i] > 0.0 else 0.0
            possible += weights[i] * left * left
            left = min(left, abs(e[i]))
            square += weights[i] * left * left
            fastest, damps = max(fastest, gain[i]), damps + kd[i]
        longest = _squares(G, weights, first[t], first[t + 1], square_of[0])
        for j in range(nj):
            lever[j] = sqrt(square_of[0, column + j])
        for k in range(held):
            long = _squares(G_held, weights_held, rows_of[k, 0], rows_of[k, 1], square_of[1])
            for j in range(nj if long > 0.0 else 0):
                lever[j] += sqrt(square_of[1, column + j] * longest / long)
        factor, damps = max(numbers[1] * fastest, numbers[0]), damps / (first[t + 1] - first[t])
        _asked(factor, possible, lever, asked[t])
        for j in range(nj):
            most[j] += asked[t, j]
        _asked(factor, square, lever, asked[t])
        for j in range(nj):
            needed[j] += asked[t, j]
            rate[j] += asked[t, j] * damps
            finite = finite and abs(needed[j]) < inf
    if not finite:
        for j in range(nj):
            applied[j] = 0.0
        numbers[2] = numbers[3] = 0.0
        return CHANGED if was_on else UNCHANGED
    is_on, share = False, 1.0
    for j in range(nj):
        applied[j] = max(needed[j] - base[j], 0.0)
        is_on = is_on or applied[j] > 0.0
        rate[j] = rate[j] / needed[j] if needed[j] > 0.0 else 0.0
        if most[j] > 0.0:
            share = min(share, sqrt(base[j] / most[j]))
    numbers[3] = 1.0 if is_on else 0.0
    if not is_on:
        # The same residuals x times as large need x² times as much at most, also where errors allow for all of them.
        numbers[2] = largest * share / _GROWTH
    return CHANGED if is_on or was_on else UNCHANGED


@part
def share(at: int) -> None:
    """The metric of the joints, and what part of it each task on them has; of the damping, what it makes of −v.

    At ``at``: sizes (tasks on joints, nj), unit of the cost, weights of the tasks (tasks, nj), base, applied, rate,
    shares (tasks + 1, nj), metric (nj).
    """
    m = carray(integers(at), 8)
    sizes = carray(integers(m[0]), 2)
    tasks, nj = sizes[0], sizes[1]
    unit, weights = carray(floats(m[1]), 1)[0], carray(floats(m[2]), (tasks, nj))
    base, applied, rate = carray(floats(m[3]), nj), carray(floats(m[4]), nj), carray(floats(m[5]), nj)
    shares, metric = carray(floats(m[6]), (tasks + 1, nj)), carray(floats(m[7]), nj)
    for j in range(nj):
        whole = base[j] + applied[j]
        for k in range(tasks):
            shares[k, j] = weights[k, j] / whole
        shares[tasks, j] = applied[j] * rate[j] / whole
        metric[j] = whole / unit


@part
def is_damped(at: int) -> bool:
    """Whether any joint was damped by what :func:`observe` found last at ``at``."""
    return bool(carray(floats(carray(integers(at), 3)[2]), 4)[3] != 0.0)
