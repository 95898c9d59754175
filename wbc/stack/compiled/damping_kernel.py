"""The damping of :mod:`wbc.stack.damping`, compiled: one task after the other, then one level after the other."""

from __future__ import annotations

from math import inf, sqrt
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, carray, copy, floats, integers, kernel, part
from wbc.qp.rows.compiled.linear import add, clear, dot
from wbc.types import Index, Mat, Vec

#: The Jacobian may grow by this factor before a residual that needed no damping is looked at again.
_GROWTH = 2.0
#: What counts as a small angle: a residual over the lever of a joint.
_WELL = 0.01
#: Levels below one that can do nothing of what it asks go on at this share of their speed.
_SLOWEST = 1e-3


class Residual(NamedTuple):
    """Views of the memory of one damping of nj joints by the residuals of some tasks."""

    first: Annotated[Index, "tasks + 1"]  # row of each task
    numbers: Annotated[Vec, "4"]  # λ | step | residual that needs no damping | 1 where one is damped
    G: Annotated[Mat, "rows, width"]  # the rows of the tasks
    left: Annotated[Vec, "rows"]  # what the last answer left of them
    weights: Annotated[Vec, "rows"]
    gain: Annotated[Vec, "rows"]
    kd: Annotated[Vec, "rows"]
    e: Annotated[Vec, "rows"]
    base: Annotated[Vec, "nj"]  # weight that the joints have without it
    applied: Annotated[Vec, "nj"]  # weight of the damping
    rate: Annotated[Vec, "nj"]  # a = −rate v is what it wants
    cost: Annotated[Mat, "2, nj"]  # of a level that is damped by itself: weight of each joint, and what it wants there
    asked: Annotated[Mat, "tasks, nj"]
    residual: Annotated[Vec, "rows"]
    lever: Annotated[Vec, "nj"]
    needed: Annotated[Vec, "nj"]
    most: Annotated[Vec, "nj"]
    held: Annotated[Index, "held, 2"]  # first row and last of what is held meanwhile
    G_held: Annotated[Mat, "all_rows, width"]
    weights_held: Annotated[Vec, "weighed"]
    square: Annotated[Mat, "2, column + nj"]
    sizes: Annotated[Index, "8"]  # tasks, rows, nj, width, first joint's column, blocks held, rows with weights, all


RESIDUAL = Layout(
    Residual, tasks="sizes[0]", rows="sizes[1]", nj="sizes[2]", width="sizes[3]", column="sizes[4]", held="sizes[5]",
    weighed="sizes[6]", all_rows="sizes[7]",
)  # fmt: skip
#: In a kernel: the arrays at an address.
residual_of = RESIDUAL.views


class Dampings(NamedTuple):
    """Views of the memory of all dampings of a plan, those of levels first and that of the metric last."""

    at: Annotated[Index, "count"]  # addresses
    v: Annotated[Vec, "nj"]  # joint velocities of the last fill, at order 2
    stalled: Annotated[Vec, "nj"]
    rate: Annotated[Vec, "nj"]
    own: Annotated[Mat, "2, nj"]  # the same two, of one damping
    least: Annotated[Vec, "1"]  # the regularisation
    brakes: Annotated[Index, "brakes, 4"]  # which damping, first row and last, address of the drift of these rows
    kd: Annotated[Vec, "rows"]
    G: Annotated[Mat, "rows, width"]  # all motion rows
    sizes: Annotated[Index, "7"]  # count, nj, brakes, rows, width, column of the first joint, order


DAMPINGS = Layout(
    Dampings, count="sizes[0]", nj="sizes[1]", brakes="sizes[2]", rows="sizes[3]", width="sizes[4]"
)  # fmt: skip
#: In a kernel: the arrays at an address.
dampings_of = DAMPINGS.views


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
def observe(at: int) -> bool:
    """Read what the last answer left of each task, and the damping that it needs: none where a number is not finite.

    Whether the damping is another than before.
    """
    r = residual_of(at)
    tasks, nj, column, held = r.sizes[0], r.sizes[2], r.sizes[4], r.sizes[5]
    was_on, largest = False, 0.0
    for j in range(nj):
        was_on = was_on or r.applied[j] != 0.0
        r.needed[j] = r.most[j] = r.rate[j] = 0.0
    for i in range(len(r.left)):
        r.residual[i] = abs(r.left[i])
        largest = max(largest, r.residual[i])
    r.numbers[3] = 0.0
    if largest <= r.numbers[2] and not was_on:
        return False
    finite = True
    for t in range(tasks):
        square, possible, fastest, damps = 0.0, 0.0, 0.0, 0.0
        for i in range(r.first[t], r.first[t + 1]):
            left = r.residual[i] / r.gain[i] if r.gain[i] > 0.0 else 0.0
            possible += r.weights[i] * left * left
            left = min(left, abs(r.e[i]))
            square += r.weights[i] * left * left
            fastest, damps = max(fastest, r.gain[i]), damps + r.kd[i]
        longest = _squares(r.G, r.weights, r.first[t], r.first[t + 1], r.square[0])
        for j in range(nj):
            r.lever[j] = sqrt(r.square[0, column + j])
        for k in range(held):
            long = _squares(r.G_held, r.weights_held, r.held[k, 0], r.held[k, 1], r.square[1])
            for j in range(nj if long > 0.0 else 0):
                r.lever[j] += sqrt(r.square[1, column + j] * longest / long)
        factor, damps = max(r.numbers[1] * fastest, r.numbers[0]), damps / (r.first[t + 1] - r.first[t])
        _asked(factor, possible, r.lever, r.asked[t])
        add(1.0, r.asked[t], nj, r.most)
        _asked(factor, square, r.lever, r.asked[t])
        for j in range(nj):
            r.needed[j] += r.asked[t, j]
            r.rate[j] += r.asked[t, j] * damps
            finite = finite and abs(r.needed[j]) < inf
    if not finite:
        clear(r.applied)
        r.numbers[2] = r.numbers[3] = 0.0
        return was_on
    is_on, share = False, 1.0
    for j in range(nj):
        r.applied[j] = max(r.needed[j] - r.base[j], 0.0)
        is_on = is_on or r.applied[j] > 0.0
        r.rate[j] = r.rate[j] / r.needed[j] if r.needed[j] > 0.0 else 0.0
        if r.most[j] > 0.0:
            share = min(share, sqrt(r.base[j] / r.most[j]))
    r.numbers[3] = 1.0 if is_on else 0.0
    if not is_on:
        # The same residuals x times as large need x² times as much at most, also where errors allow for all of them.
        r.numbers[2] = largest * share / _GROWTH
    return is_on or was_on


@kernel
def _stall(r: Residual, v: Vec, out: Vec) -> bool:
    """Ratio of the residual of the tasks to the motion that the damped joints made; whether it is above 0 for any.

    That is d/σ² for a task along the direction of its residual, σ² the curvature that J has there.
    """
    nj, last, column = r.sizes[2], r.sizes[3] - 1, r.sizes[4]
    largest, before, after = 0.0, 0.0, 0.0
    for j in range(nj):
        largest = max(largest, r.applied[j])
        out[j] = 0.0
    if largest == 0.0:
        return False
    for i in range(len(r.left)):
        asked = r.G[i, last]
        for j in range(nj):
            asked -= r.G[i, column + j] * r.rate[j] * v[j]
        before += r.weights[i] * asked * asked
        after += r.weights[i] * r.left[i] * r.left[i]
    before, after = sqrt(before), sqrt(after)
    if not min(before, after) > 0.0:
        return False
    ratio = min(after, before) / max(before - after, _SLOWEST * before) / largest
    for j in range(nj):
        out[j] = r.applied[j] * ratio
    return True


@part
def observe_all(at: int) -> bool:
    """Observe every damping, and slow down what stands below a level that is damped.

    Its joints are damped by as many times the curvature of the tasks as the levels above are stalled. Whether the
    damping in the metric is another than before.
    """
    d = dampings_of(at)
    count, nj = d.sizes[0], d.sizes[1]
    is_changed, slows, stalls = False, False, False
    for k in range(count):
        is_changed = observe(d.at[k]) != 0
        slows = slows or (k < count - 1 and residual_of(d.at[k]).numbers[3] != 0.0)
    if not slows:
        return is_changed
    clear(d.stalled)
    clear(d.rate)
    for k in range(count):
        r = residual_of(d.at[k])
        own = _stall(r, d.v, d.own[0])
        copy(r.rate, d.own[1])
        if stalls:
            _squares(r.G, r.weights, 0, len(r.left), r.square[0])
            is_on = False
            for j in range(nj):
                more = d.stalled[j] * (r.base[j] + r.square[0, r.sizes[4] + j])
                total = r.applied[j] + more
                r.rate[j] = (r.rate[j] * r.applied[j] + d.rate[j] * more) / total if total > 0.0 else d.rate[j]
                r.applied[j] = total
                is_on = is_on or total != 0.0
            r.numbers[3] = 1.0 if is_on else 0.0
        stalls = stalls or own
        for j in range(nj):
            if d.own[0, j] > d.stalled[j]:
                d.stalled[j], d.rate[j] = d.own[0, j], d.own[1, j]
    return True


@part
def follow(at: int, v_at: int) -> None:
    """After a fill for the velocities at ``v_at``: what the damping of each level costs, and brakes of its own.

    What a task does in part it brakes with all of its kd.
    """
    d = dampings_of(at)
    nj, column, order = d.sizes[1], d.sizes[5], d.sizes[6]
    v = carray(floats(v_at), column + nj)
    for j in range(nj if order > 1 else 0):
        d.v[j] = v[column + j]
    for k in range(d.sizes[0] - 1):
        r = residual_of(d.at[k])
        clear(r.cost[0])
        if r.numbers[3] != 0.0:
            for j in range(nj):
                r.cost[0, j] = r.applied[j] + d.least[0]
                r.cost[1, j] = -r.applied[j] / r.cost[0, j] * r.rate[j] * d.v[j]
    for k in range(d.sizes[2]):
        first, last = d.brakes[k, 1], d.brakes[k, 2]
        if residual_of(d.at[d.brakes[k, 0]]).numbers[3] != 0.0:
            drift = carray(floats(d.brakes[k, 3]), last - first)
            for i in range(last - first):
                drift[i] += d.kd[first + i] * dot(d.G[first + i], v, column + nj)


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
