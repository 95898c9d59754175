"""The formulas of :class:`~wbc.stack.interval.JointIntervals`: one joint and side after the other."""

from __future__ import annotations

from math import inf, isinf, sqrt

from wbc.compiled import carray, entry, floats, integers, kernel
from wbc.types import Index, Vec


@kernel
def joint_bounds(memory: Index, nj: int, order: int, dt: float, q: Vec, v: Vec, lower: Vec, upper: Vec) -> None:
    """Bounds (nj,) on velocities (order 1) or accelerations (2) of the joints; ``memory`` is the intervals' own."""
    flags = carray(integers(memory[0]), 3)
    position, fastest = carray(floats(memory[1]), 2 * nj), carray(floats(memory[2]), 2 * nj)
    strongest, minus_B = carray(floats(memory[3]), 2 * nj), carray(floats(memory[4]), 2 * nj)
    two_B, B_dt = carray(floats(memory[5]), 2 * nj), carray(floats(memory[6]), 2 * nj)
    B_dt_squared, return_speed = carray(floats(memory[7]), 2 * nj), carray(floats(memory[8]), 2 * nj)
    faster, room = carray(floats(memory[9]), 2 * nj), carray(floats(memory[10]), 2 * nj)
    reach, wanted = carray(floats(memory[11]), 2 * nj), carray(floats(memory[12]), 2 * nj)
    free, bound = carray(floats(memory[13]), 2 * nj), carray(floats(memory[14]), 2 * nj)
    if flags[0] > 0 and order == 2:  # nothing but velocities
        for j in range(nj):
            upper[j] = max((fastest[j] - v[j]) / dt, minus_B[j])
            lower[j] = -max((fastest[nj + j] + v[j]) / dt, minus_B[nj + j])
        return
    outside = False
    for i in range(2 * nj):
        sign, j = (1.0, i) if i < nj else (-1.0, i - nj)
        room[i] = position[i] - sign * (q[j] if order == 1 else q[j] + 0.5 * dt * v[j])
        outside = outside or room[i] < 0.0
        if order == 1 and (flags[1] == 0 or isinf(strongest[j + nj if i < nj else j])):
            reach[i] = room[i] / dt
        else:
            reach[i] = sqrt(max(room[i], 0.0) * two_B[i] + B_dt_squared[i]) - B_dt[i]
    flags[2] = outside
    for i in range(2 * nj):
        if not outside:
            wanted[i] = min(reach[i], fastest[i])
        else:
            other = i + nj if i < nj else i - nj
            allowed = min(max(reach[i], 0.0), fastest[i])
            back = min(max(reach[other], 0.0), fastest[other], return_speed[other])
            wanted[i] = allowed + max(min(room[i], 0.0) * (1.0 if order == 1 else 2.0) / dt, -back)
        sign, j = (1.0, i) if i < nj else (-1.0, i - nj)
        towards = sign * v[j]
        if order == 2:
            free[i] = max((wanted[i] - towards) / dt, minus_B[i])
            bound[i] = min(free[i], strongest[i])
        elif flags[1] > 0:
            slower = inf if isinf(strongest[j + nj if i < nj else j]) else B_dt[i]
            free[i] = max(towards - slower, wanted[i])
            # The product is rounded as B dt is: where both are the same, so are the two ends of an interval.
            bound[i] = min(free[i], towards + faster[i])
        else:
            bound[i] = wanted[i]
    for j in range(nj):
        upper[j], lower[j] = bound[j], -bound[nj + j]


@entry
def bound_joints(at: int) -> int:
    """``joint_bounds`` by itself; at ``at``: nj and the order; dt; q, v, lower and upper (nj,) each; the intervals'."""
    memory = carray(integers(at), 20)
    sizes, dt = carray(integers(memory[0]), 2), carray(floats(memory[1]), 1)[0]
    nj = sizes[0]
    q, v = carray(floats(memory[2]), nj), carray(floats(memory[3]), nj)
    lower, upper = carray(floats(memory[4]), nj), carray(floats(memory[5]), nj)
    joint_bounds(memory[6:], nj, sizes[1], dt, q, v, lower, upper)
    return 0
