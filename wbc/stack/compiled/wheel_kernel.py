"""Rows of a wheel on level ground: how its material point there moves."""

from __future__ import annotations

from math import sqrt

from wbc.compiled import callee
from wbc.stack.compiled.geometry import SHORTEST, cross, dot, plus, scaled, three, times
from wbc.stack.compiled.row_kernel import rows


@callee
def wheel(at: int) -> int:
    """Velocities of the point on the ground, each along a sum of the heading t, across it l and the normal n.

    ``numbers``: the axle in the frame, the radius, the height of the ground, and of each row its shares of t, l and n;
    what is along the normal has an error, ground − z. With a the axle in the world, c = n·a and s = √(1 − c²) the
    point is p − radius m, m = (n − c a) / s; t = a × n / s, l = n × t.
    """
    k = rows(at)
    radius, a, w = k.numbers[3], times(k.place[0], k.numbers), three(k.motion[0], 3)
    n, c = (0.0, 0.0, 1.0), a[2]
    s = max(sqrt(1.0 - min(c * c, 1.0)), SHORTEST)  # one that lies nearly flat has no heading
    m, t = plus(scaled(1.0 / s, n), -c / s, a), (a[1] / s, -a[0] / s, 0.0)
    a_rate = cross(w, a)
    s_rate = -c * a_rate[2] / s
    m_rate = plus(plus(scaled(-a_rate[2] / s, a), -c / s, a_rate), -s_rate / s, m)
    t_rate = (a_rate[1] - s_rate * t[0]) / s, (-a_rate[0] - s_rate * t[1]) / s, 0.0
    arm = scaled(radius, m)
    velocity = plus(three(k.motion[0], 0), -1.0, cross(w, arm))
    bent = scaled(-radius, cross(w, m_rate))
    for r in range(len(k.e)):
        share = three(k.numbers, 5 + 3 * r)
        axis = plus(plus(scaled(share[0], t), share[1], (-t[1], t[0], 0.0)), share[2], n)
        axis_rate = plus(scaled(share[0], t_rate), share[1], (-t_rate[1], t_rate[0], 0.0))
        turn = cross(axis, arm)
        for i in range(3):
            k.C[r, i], k.C[r, 3 + i] = axis[i], turn[i]
        k.bent[r] = dot(axis, bent) + dot(axis_rate, velocity)
        k.e[r] = 0.0
        if share[2] != 0.0:
            k.e[r] = share[2] * (k.numbers[4] - k.place[0, 11] + arm[2])
    return 1
