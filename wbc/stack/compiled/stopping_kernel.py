"""The braking policies of :class:`~wbc.stack.stopping.Stopping`: one moment of a way to rest after the other."""

from __future__ import annotations

from math import copysign, floor, inf, isinf
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, entry, kernel, part
from wbc.tolerances import HUGE, SAME
from wbc.types import Index, Mat, Vec

#: Share of the torque range that the way to rest leaves free on either side: it is computed in few moments.
_MARGIN = 0.05
#: Share of that margin that may be used by what changes from one moment to the next.
_BETWEEN = 0.1
#: Moments that a way to rest has at least, and what a joint moves [rad, m] between two of them at most.
_MOMENTS, _TURN = 10, 0.1


class Braking(NamedTuple):
    """Views of the memory of one robot of nj joints."""

    sizes: Annotated[Index, "3"]  # nj, moments at most, moments so far
    numbers: Annotated[Vec, "3"]  # dt, gentle, time between moments: 0 before the second one
    now: Annotated[Mat, "2, nj"]  # q, v
    limits: Annotated[Mat, "16, 2 * nj"]  # of the intervals
    lower: Annotated[Vec, "nj"]  # of the torques
    upper: Annotated[Vec, "nj"]
    bias: Annotated[Vec, "nj"]  # what motors carry beside the robot
    carried: Annotated[Mat, "nj, nj"]
    M: Annotated[Mat, "nj, nj"]  # of the robot
    h: Annotated[Vec, "nj"]
    inertia: Annotated[Mat, "nj, nj"]  # bounds of |M|, |g|, and |C v| at the velocity limits
    weight: Annotated[Vec, "nj"]
    moving: Annotated[Vec, "nj"]
    fast: Annotated[Vec, "nj"]
    late: Annotated[Vec, "nj"]  # how far beyond its limit B stops each joint, signed as its velocity
    ahead: Annotated[Mat, "3, nj"]  # B, the room that stopping in ticks leaves, the deceleration v² / 2 s
    D: Annotated[Vec, "nj"]
    last: Annotated[Vec, "nj"]  # the acceleration up to here
    spare: Annotated[Vec, "nj"]  # what motors have left that hold the robot here
    kept: Annotated[Vec, "nj"]  # what they have to keep of it
    way: Annotated[Mat, "sizes[1], nj"]  # decelerations


LAYOUT = Layout(Braking, nj="sizes[0]")
views = LAYOUT.views


@part
def look(at: int) -> None:
    """Write ``ahead`` in the state ``now``. A joint at rest has the farther of its limits ahead."""
    s = views(at)
    nj, q, v = s.sizes[0], s.now[0], s.now[1]
    for j in range(nj):
        up, down = s.limits[0, j] - q[j], s.limits[0, nj + j] + q[j]
        room = max(up, down)
        if v[j] > 0.0:
            room = up + max(s.late[j], 0.0)
        elif v[j] < 0.0:
            room = down - min(s.late[j], 0.0)
        s.ahead[0, j] = -s.limits[3, j if v[j] > 0.0 else nj + j]
        s.ahead[1, j] = min(room - 0.5 * s.numbers[0] * abs(v[j]), HUGE)  # no limit ahead is one that is out of reach
        s.ahead[2, j] = v[j] * v[j] / (2.0 * max(s.ahead[1, j], SAME))


@entry
def surely(at: int) -> int:
    """Whether braking just enough for the nearer limit takes less than the motors have in any configuration."""
    s = views(at)
    nj, q, v, fastest = s.sizes[0], s.now[0], s.now[1], 0.0
    for j in range(nj):
        room = min(s.limits[0, j] - q[j], s.limits[0, nj + j] + q[j]) - 0.5 * s.numbers[0] * abs(v[j])
        s.D[j] = 0.5 * v[j] * v[j] / max(room, SAME)
        if s.D[j] > -max(s.limits[3, j], s.limits[3, nj + j]):
            return 0
        fastest = max(fastest, abs(v[j]) / s.fast[j])
    for j in range(nj):
        need = s.weight[j] + abs(s.bias[j]) + fastest * fastest * s.moving[j]
        for i in range(nj):
            need += s.inertia[j, i] * s.D[i]
        if not need <= min(s.upper[j], -s.lower[j]):
            return 0
    return 1


@kernel
def _largest(s: Braking) -> float:
    """The largest β in [0, 1] with which torques allow the acceleration −β D; −1 where there is none, or where torques
    no longer allow ``last``."""
    most, least = 1.0, 0.0
    for j in range(s.sizes[0]):
        push, pushed = 0.0, 0.0
        for i in range(s.sizes[0]):
            push += (s.M[j, i] + s.carried[j, i]) * s.D[i]
            pushed -= (s.M[j, i] + s.carried[j, i]) * s.last[i]
        above, below = s.h[j] + s.bias[j] - s.lower[j], s.h[j] + s.bias[j] - s.upper[j]
        s.spare[j] = min(above, -below)
        # In hand on either side; where holding the robot leaves less, half of what it leaves.
        free = min(_MARGIN * (above - below), 0.5 * s.spare[j] if s.spare[j] > 0.0 else inf)
        if isinf(free):
            free = 0.0
        above, below, changed = above - free, below + free, _BETWEEN * free
        if not below - changed <= pushed <= above + changed:
            return -1.0
        if push == 0.0:
            if above < 0.0 or below > 0.0:
                return -1.0
        else:  # below <= β push <= above
            most = min(most, max(above / push, below / push))
            least = max(least, min(above / push, below / push))
    return -1.0 if least > most else most


@entry
def brake(at: int) -> int:
    """How many moments a way to rest has that ends ``now``, where ``M`` and ``h`` are of; −1: there is none; 0: it goes
    on, and ``now`` is the next moment."""
    s = views(at)
    nj, k, dt, q, v, slowest = s.sizes[0], s.sizes[2], s.numbers[0], s.now[0], s.now[1], 0.0
    B, room, needed = s.ahead[0], s.ahead[1], s.ahead[2]
    look(at)
    for j in range(nj):
        if 0.5 * v[j] * v[j] > B[j] * room[j] + SAME:
            return -1
        slowest = max(slowest, abs(v[j]) / max(B[j], SAME))
    time = max(slowest * s.numbers[1], dt)
    for j in range(nj):
        speed = abs(v[j])
        s.D[j] = copysign(min(B[j], speed / dt, max(speed / time, needed[j])), v[j])
    share = _largest(s)
    if share < 0.0:
        return -1
    rests, longest, fastest = True, 0.0, 0.0
    for j in range(nj):
        speed, size = abs(v[j]), abs(share * s.D[j])
        s.way[k, j] = size
        if k == 0:
            s.kept[j] = min(_MARGIN * (s.upper[j] - s.lower[j]), s.spare[j])
        stops = speed <= 2.0 * dt * size and 0.5 * speed * speed <= size * room[j] + SAME
        rests = rests and stops and s.spare[j] > 0.0 and s.spare[j] >= s.kept[j] - SAME
        longest, fastest = max(longest, speed / size if size > 0.0 else 0.0), max(fastest, speed)
    s.sizes[2] += 1
    if rests:
        return int(s.sizes[2])
    if k == 0:
        s.numbers[2] = dt * max(1.0, floor(min(longest / _MOMENTS, _TURN / max(fastest, SAME)) / dt))
    for j in range(nj):
        speed, a = abs(v[j]), -share * s.D[j]
        stop = speed / abs(a) if a != 0.0 else inf
        s.last[j] = 0.0 if stop < (1.0 - SAME) * s.numbers[2] else a
        stop = min(stop, s.numbers[2])
        turn = (v[j] + 0.5 * a * stop) * stop
        if abs(turn) > room[j] + 0.5 * dt * speed + SAME:
            return -1
        q[j] += turn
        v[j] += a * stop
        if abs(v[j]) <= SAME * speed:
            v[j] = 0.0  # else rounding would give it a direction
    return 0
