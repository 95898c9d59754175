"""A point that follows samples: each axis by itself, |v| <= V, |a| <= A, |j| <= J, without overshoot.

Time goes in cells of h. In each cell an axis that is at (x, v, a) and has its sample s gets the jerk

    j = ω³ (s − x) − 3 ω² v − 3 ω a,      three poles at −ω,

or the one nearest to it that keeps |j| <= J, |a| <= A, |v + a |a| / (2 J)| <= V (the speed once the acceleration is
taken away) and moves the place of rest, x plus the way of the shortest stop from (v, a), towards s and not beyond. The
stop itself keeps all of this, so that there is always an answer: where no constant jerk does, the axis brakes.

Far from the sample this is the shortest time, near it the linear filter. A turn is a unit quaternion x y z w, its error
a rotation vector, its speed and what follows in world axes.
"""

from __future__ import annotations

from math import atan2, cos, inf, pi, sin, sqrt
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, copy, entry, kernel, small_kernel
from wbc.tolerances import NOISE, SAME
from wbc.types import Index, Mat, Vec

#: What a follower does: it moves, it rests at its sample, or it has one that it has not looked at.
MOVES, RESTS, WAKES = 0, 1, 2
_HALVINGS = 30
#: A turn is not begun the other way round while the way that it goes is no longer than this [rad].
_HALF_TURN = pi + 0.2


class _Follower(NamedTuple):
    sizes: Annotated[Index, "3"]  # linear axes, angular axes (0 or 3), what it does
    time: Annotated[Vec, "3"]  # since the cell began, h, ω
    limits: Annotated[Mat, "n, 3"]  # V, A, J
    sample: Annotated[Vec, "places"]  # linear, and a quaternion
    place: Annotated[Vec, "places"]  # where it was when the cell began
    there: Annotated[Vec, "places"]  # now
    v: Annotated[Vec, "n"]  # when the cell began
    a: Annotated[Vec, "n"]
    jerk: Annotated[Vec, "n"]  # of the cell
    brakes: Annotated[Vec, "n"]  # 1 where it is a stop instead
    left: Annotated[Vec, "n"]  # sample minus place
    rate: Annotated[Vec, "n"]  # now
    second: Annotated[Vec, "n"]


LAYOUT = Layout(_Follower, n="sizes[0] + sizes[1]", places="sizes[0] + (4 if sizes[1] else 0)")
#: In a kernel: the arrays at an address.
_follower = LAYOUT.views


@small_kernel
def _on(x: float, v: float, a: float, j: float, t: float) -> tuple[float, float, float]:
    """Where (x, v, a) is after a time t of constant jerk."""
    return x + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j


@kernel
def stop(v: float, a: float, A: float, J: float, t: float) -> tuple[float, float, float]:
    """Way, speed and acceleration after a time t of the shortest stop: jerk −J, none, J, or the other way round."""
    side = 1.0 if v + a * abs(a) / (2.0 * J) >= 0.0 else -1.0
    peak, hold = sqrt(max(side * J * v + a * a / 2.0, 0.0)), 0.0
    if peak > A:
        peak, hold = A, max((side * v + a * a / (2.0 * J) - A * A / J) / A, 0.0)
    first, last = max((side * a + peak) / J, 0.0), peak / J
    x = 0.0
    x, v, a = _on(x, v, a, -side * J, min(t, first))
    if t > first:
        x, v, a = _on(x, v, a, 0.0, min(t - first, hold))
    if t > first + hold:
        x, v, a = _on(x, v, a, side * J, min(t - first - hold, last))
    if t >= first + hold + last:
        v = a = 0.0
    return x, v, a


@kernel
def _beyond(j: float, v: float, a: float, least: float, most: float, limits: Vec, h: float) -> int:
    """On which side this jerk leaves what is allowed: 1 above, −1 below, 0 on none.

    ``least`` and ``most`` bound the place of rest.
    """
    V, A, J = limits[0], limits[1], limits[2]
    x, v, a = _on(0.0, v, a, j, h)
    ahead = v + a * abs(a) / (2.0 * J)
    x += stop(v, a, A, J, inf)[0]
    if x > most or ahead > V:
        return 1
    return -1 if x < least or ahead < -V else 0


@kernel
def _jerk(left: float, v: float, a: float, limits: Vec, h: float, omega: float) -> tuple[float, float]:
    """The jerk of a cell, and 1 where the axis brakes instead."""
    V, A, J = limits[0], limits[1], limits[2]
    rest = stop(v, a, A, J, inf)[0]
    least, most = min(rest, left), max(rest, left)
    low, high = max(-J, (-A - a) / h), min(J, (A - a) / h)
    j = min(max(omega * (omega * (omega * left - 3.0 * v) - 3.0 * a), low), high)
    side = _beyond(j, v, a, least, most, limits, h)
    if side:
        bad, good = j, low if side > 0 else high
        if _beyond(good, v, a, least, most, limits, h):
            return 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = (good + bad) / 2.0
            if _beyond(middle, v, a, least, most, limits, h) == side:
                bad = middle
            else:
                good = middle
        j = good
        if _beyond(j, v, a, least, most, limits, h):
            return 0.0, 1.0
    if a * (a + j * h) < 0.0 and abs(v - a * a / (2.0 * j)) > V:  # the speed peaks inside the cell
        return 0.0, 1.0
    return j, 0.0


@kernel
def _rotation_left(sample: Vec, place: Vec, left: Vec) -> None:
    """The rotation vector from one quaternion to another; ``left`` has the last one, which decides near half a turn."""
    a, b = sample, place
    x = a[0] * b[3] - a[3] * b[0] - a[1] * b[2] + a[2] * b[1]
    y = a[1] * b[3] - a[3] * b[1] - a[2] * b[0] + a[0] * b[2]
    z = a[2] * b[3] - a[3] * b[2] - a[0] * b[1] + a[1] * b[0]
    w = a[3] * b[3] + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    size = sqrt(x * x + y * y + z * z)
    angle = 2.0 * atan2(size, w)
    if 2.0 * pi - angle < _HALF_TURN and x * left[0] + y * left[1] + z * left[2] < 0.0:
        angle -= 2.0 * pi
    factor = angle / size if size > 0.0 else 2.0
    left[0], left[1], left[2] = factor * x, factor * y, factor * z


@kernel
def _turned(place: Vec, before: Vec, after: Vec, t: float, there: Vec) -> None:
    """The quaternion after a time t, from ω ``before`` to ``after``: Magnus to the fourth order.

    ``there`` has ∫ω before its quaternion.
    """
    c = t * t / 12.0
    x = there[0] - c * (before[1] * after[2] - before[2] * after[1])
    y = there[1] - c * (before[2] * after[0] - before[0] * after[2])
    z = there[2] - c * (before[0] * after[1] - before[1] * after[0])
    half = sqrt(x * x + y * y + z * z) / 2.0
    factor = sin(half) / (2.0 * half) if half > 0.0 else 0.5
    x, y, z, w = factor * x, factor * y, factor * z, cos(half)
    there[0] = w * place[0] + x * place[3] + y * place[2] - z * place[1]
    there[1] = w * place[1] + y * place[3] + z * place[0] - x * place[2]
    there[2] = w * place[2] + z * place[3] + x * place[1] - y * place[0]
    there[3] = w * place[3] - x * place[0] - y * place[1] - z * place[2]
    size = sqrt(there[0] ** 2 + there[1] ** 2 + there[2] ** 2 + there[3] ** 2)
    for i in range(4):
        there[i] /= size


@kernel
def _look(f: _Follower, t: float) -> None:
    """Write what there is after a time t of the cell."""
    k, n = f.sizes[0], f.sizes[0] + f.sizes[1]
    for i in range(n):
        v, a = f.v[i], f.a[i]
        if f.brakes[i] > 0.0:
            x, v, a = stop(v, a, f.limits[i, 1], f.limits[i, 2], t)
        else:
            x, v, a = _on(0.0, v, a, f.jerk[i], t)
        f.rate[i], f.second[i] = v, a
        f.there[i] = f.place[i] + x if i < k else x
    if n > k:
        _turned(f.place[k:], f.v[k:], f.rate[k:], t, f.there[k:])


@kernel
def _decide(f: _Follower) -> None:
    """Begin a cell.

    An axis rests where what is left to go, and what it goes in a cell, is the same as nothing beside what its limits
    allow in a cell, or is rounding of the sample.
    """
    k, n, h = f.sizes[0], f.sizes[0] + f.sizes[1], f.time[1]
    for i in range(k):
        f.left[i] = f.sample[i] - f.place[i]
    if n > k:
        _rotation_left(f.sample[k:], f.place[k:], f.left[k:])
    still = True
    for i in range(n):
        V, A, J = f.limits[i, 0], f.limits[i, 1], f.limits[i, 2]
        size = abs(f.sample[i]) if i < k else 1.0
        little = max(SAME * h * min(V, h * min(A, h * J)), NOISE * size)
        moves = max(abs(f.v[i]) * h, abs(f.a[i]) * h * h)
        still = still and abs(f.left[i]) <= little and moves <= little
    if still:
        f.sizes[2] = RESTS
        copy(f.sample, f.place)
    for i in range(n):
        if still:
            f.v[i] = f.a[i] = f.jerk[i] = f.brakes[i] = f.left[i] = 0.0
        else:
            f.jerk[i], f.brakes[i] = _jerk(f.left[i], f.v[i], f.a[i], f.limits[i], h, f.time[2])


@entry
def follow(at: int) -> int:
    """Go on to the time since the cell began, and write value, rate and acceleration there."""
    f = _follower(at)
    if f.sizes[2] == WAKES:
        f.sizes[2] = MOVES
        _decide(f)
    while f.sizes[2] == MOVES and f.time[0] >= f.time[1]:
        f.time[0] -= f.time[1]
        _look(f, f.time[1])
        copy(f.there, f.place)
        copy(f.rate, f.v)
        copy(f.second, f.a)
        _decide(f)
    if f.sizes[2] == RESTS:
        f.time[0] = 0.0
    _look(f, f.time[0])
    return 0
