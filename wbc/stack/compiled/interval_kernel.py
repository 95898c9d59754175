"""The formulas of :class:`~wbc.stack.interval.JointIntervals`: one joint and side after the other."""

from __future__ import annotations

import sys
from math import inf, isinf, sqrt

from wbc.compiled import carray, entry, floats, integers, kernel
from wbc.types import Index, Vec

#: Share of the jerk that the approach to a bound on velocity may use; the bound itself, which falls while a position
#: limit comes nearer, uses less than a sixth of the rest.
_SHARE = 0.5
#: Share of the way to a position limit that a slow joint may go in a tick: with 0.7 and more it swings about the limit
#: in plants that integrate otherwise.
_OF_THE_WAY = 0.6
#: The smallest number that one may divide by.
_TINY = sys.float_info.min


@kernel
def _approach(
    jerk: float, opposite: float, B: float, fastest: float, strongest: float, room: float, towards: float, dt: float
) -> float:
    """The largest acceleration towards a limit with which accelerations need not jump later.

    The velocity u towards the limit is bounded as without jerk, but with room for the time B/j that braking takes to
    set in: u <= w(s) = −B T + √((B T)² + 2 B s), T = dt + B/j. Along that bound the acceleration −u B / (w + B T) ends
    at zero and changes by 0.15 j at most. It is approached as a position is, one derivative higher: with the room
    r = min(w, v_max) − u left, and j' = j / 2, a <= ẇ − j' dt + √((j' dt)² + 2 j' r).
    """
    if isinf(jerk):
        return inf
    # Upwards towards a limit a joint brakes with the jerk that it has downwards.
    least = max(min(jerk, 1.0 if isinf(opposite) else opposite), _TINY)
    delay = B * (dt + B / least)
    reach = sqrt(max(room, 0.0) * max(2.0 * B, _TINY) + delay * delay)  # w + B T
    slope = max(towards, 0.0) * B / max(reach, _TINY)
    reach -= delay
    if reach >= fastest:
        reach, slope = fastest, 0.0
    left, share = reach - towards, _SHARE * least
    soft = sqrt(max(left, 0.0) * 2.0 * share + (share * dt) ** 2) - share * dt
    # Beyond the bound on velocity: back to it within the tick.
    return min(max(soft + min(left, 0.0) / dt - slope, -B), strongest)


@kernel
def joint_bounds(memory: Index, nj: int, order: int, q: Vec, v: Vec, lower: Vec, upper: Vec) -> None:
    """Bounds (nj,) on velocities (order 1) or accelerations (2) of the joints; ``memory`` is the intervals' own."""
    flags, numbers = carray(integers(memory[0]), 4), carray(floats(memory[1]), (16, 2 * nj))
    last, dt = carray(floats(memory[2]), nj), carray(floats(memory[3]), 1)[0]
    position, fastest, strongest, minus_B, two_B = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    B_dt, B_dt_squared, return_speed, faster, jerk = numbers[5], numbers[6], numbers[7], numbers[8], numbers[9]
    room, reach, wanted, free, bound, narrowed = (
        numbers[10], numbers[11], numbers[12], numbers[13], numbers[14], numbers[15],
    )  # fmt: skip
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
            if order == 2:
                slow = _OF_THE_WAY * max(room[i], 0.0) / dt
                reach[i] = min(reach[i], max(slow, (1.0 - 0.5 * _OF_THE_WAY) * sign * v[j]))
    flags[2] = outside
    for i in range(2 * nj):
        sign, j, other = (1.0, i, i + nj) if i < nj else (-1.0, i - nj, i - nj)
        if not outside:
            wanted[i] = min(reach[i], fastest[i])
        else:
            allowed = min(max(reach[i], 0.0), fastest[i])
            back = min(max(reach[other], 0.0), fastest[other], return_speed[other])
            wanted[i] = allowed + max(min(position[i] - sign * q[j], 0.0) / dt, -back)
        towards = sign * v[j]
        if order == 2:
            free[i] = max((wanted[i] - towards) / dt, minus_B[i])
            bound[i] = min(free[i], strongest[i])
        elif flags[1] > 0:
            slower = inf if isinf(strongest[other]) else B_dt[i]
            free[i] = max(towards - slower, wanted[i])
            # The product is rounded as B dt is: where both are the same, so are the two ends of an interval.
            bound[i] = min(free[i], towards + faster[i])
        else:
            bound[i] = wanted[i]
    for j in range(nj):
        upper[j], lower[j] = bound[j], -bound[nj + j]
        if flags[3] == 0:
            continue
        above, below, speed = upper[j], lower[j], v[j]
        if order == 1:  # by way of accelerations
            above, below = (above - speed) / dt, (below - speed) / dt
        k, limits = nj + j, (jerk[j], jerk[nj + j])
        most = _approach(limits[0], limits[1], -minus_B[j], fastest[j], strongest[j], room[j], speed, dt)
        least = -_approach(limits[1], limits[0], -minus_B[k], fastest[k], strongest[k], room[k], -speed, dt)
        # From outside both sides may ask for the way back at once. Jerk comes after them, the other limits last.
        least, most = min(least, most), max(least, most)
        least = min(max(min(max(least, last[j] - limits[1] * dt), last[j] + limits[0] * dt), below), above)
        most = min(max(min(max(most, last[j] - limits[1] * dt), last[j] + limits[0] * dt), below), above)
        if order == 1:
            least, most = least * dt + speed, most * dt + speed
        narrowed[j], narrowed[k] = most < upper[j], least > lower[j]
        lower[j], upper[j] = least, most


@entry
def bound_joints(at: int) -> int:
    """``joint_bounds`` by itself; at ``at``: nj and the order; q, v, lower and upper (nj,) by rows; the intervals'."""
    memory = carray(integers(at), 6)
    sizes = carray(integers(memory[0]), 2)
    now = carray(floats(memory[1]), (4, sizes[0]))
    joint_bounds(memory[2:], sizes[0], sizes[1], now[0], now[1], now[2], now[3])
    return 0
