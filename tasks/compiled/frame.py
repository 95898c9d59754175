"""Rows about frames: where one is, in the world or seen from another, how far apart two are, and what holds one."""

from __future__ import annotations

from math import sqrt

from wbc.compiled import callee, kernel
from wbc.stack.compiled.geometry import (
    NEAREST,
    SHORTEST,
    Three,
    back,
    cross,
    dot,
    log3,
    log6,
    plus,
    scaled,
    three,
    times,
)
from wbc.stack.compiled.row_kernel import Rows, follow, rows
from wbc.types import Mat, Vec


@kernel
def turn_error(target: Mat, R: Mat, work: Vec) -> None:
    """log(R_target Rᵀ), the last three numbers of ``work`` (12,)."""
    S = work[:9].reshape((3, 3))
    for i in range(3):
        for j in range(3):
            S[i, j] = target[i, 0] * R[j, 0] + target[i, 1] * R[j, 1] + target[i, 2] * R[j, 2]
    log3(S, work[9:12])


@kernel
def pose_error(k: Rows, target: Mat, place: Vec, R: Mat, p: Vec, work: Vec) -> None:
    """e = (p_target − p, log(R_target Rᵀ)), of these six the rows ``numbers``."""
    turn_error(target, R, work)
    for r in range(len(k.e)):
        row = int(k.numbers[r])
        k.e[r] = place[row] - p[row] if row < 3 else work[6 + row]


@callee
def position(at: int) -> int:
    """Position of a frame, or of the centre of mass; ``numbers``: which axes."""
    k = rows(at)
    for r in range(len(k.e)):
        axis = int(k.numbers[r])
        k.e[r] = k.value[r] - k.place[0, 9 + axis]
        k.C[r, axis] = 1.0
    return follow(k)


@callee
def own_position(at: int) -> int:
    """The way d to a target along the frame's own axes a, ȧ = ω × a; ``numbers``: which.

    a·d falls as a·(ṗ + ω × d − ṗ_target), whose rate has −a·(ω × (2 (ṗ − ṗ_target) + ω × d)) beside accelerations.
    """
    k = rows(at)
    R, w = k.place[0], three(k.motion[0], 3)
    d = plus(three(k.value, 0), -1.0, three(R, 9))
    bent = cross(plus(cross(w, d), 2.0, plus(three(k.motion[0], 0), -1.0, three(k.rate, 0))), w)
    for r in range(len(k.e)):
        i = int(k.numbers[r])
        axis = R[i], R[3 + i], R[6 + i]
        lever = cross(d, axis)
        for c in range(3):
            k.C[r, c], k.C[r, 3 + c] = axis[c], lever[c]
        k.e[r], k.bent[r] = dot(axis, d), dot(axis, bent)
        k.rate_ref[r], k.acc_ref[r] = dot(axis, three(k.rate, 0)), dot(axis, three(k.second, 0))
    return 1


@callee
def pose(at: int) -> int:
    """Position and orientation, or one of them; ``numbers``: which of the six rows."""
    k = rows(at)
    R = k.place[0, :9].reshape((3, 3))
    pose_error(k, k.value[:9].reshape((3, 3)), k.value[9:], R, k.place[0, 9:], k.work)
    for r in range(len(k.e)):
        k.C[r, int(k.numbers[r])] = 1.0
    return follow(k)


@kernel
def _hold(k: Rows, r: int, axis: Three, arm: Three) -> float:
    """A row along an axis, of the point that is ``arm`` away; how far that is from the anchor."""
    turn = cross(arm, axis)
    for c in range(3):
        k.C[r, c], k.C[r, 3 + c] = axis[c], turn[c]
    point = plus(three(k.place[0], 9), 1.0, arm)
    return dot(axis, plus(three(k.origin, 0), -1.0, point))


@callee
def point(at: int) -> int:
    """A point is held; ``numbers``: axes of the surface, where it is from the frame, both in the world, the rows whose
    error counts."""
    k = rows(at)
    for r in range(3):
        k.e[r] = k.numbers[12 + r] * _hold(k, r, three(k.numbers, 3 * r), three(k.numbers, 9))
    return 1


@callee
def sole(at: int) -> int:
    """A body is held, in its own axes: twist of the point ``numbers``, and log6(actual⁻¹ anchor)."""
    k = rows(at)
    R, w = k.place[0], three(k.motion[0], 3)
    arm, turning = times(R, k.numbers), back(R, cross(w, three(k.motion[0], 0)))
    S, way, memory = k.work[:9].reshape((3, 3)), k.work[9:12], k.work[12:15]
    for r in range(3):
        axis = R[r], R[3 + r], R[6 + r]
        way[r] = _hold(k, r, axis, arm)
        for j in range(3):
            k.C[3 + r, 3 + j] = axis[j]
            S[r, j] = axis[0] * k.other[j, 0] + axis[1] * k.other[j, 1] + axis[2] * k.other[j, 2]
        k.bent[r] = -turning[r]  # axes that turn with the body: the spatial acceleration, not the classical one
    log6(S, way, memory, k.e)
    return 1


@callee
def edge(at: int) -> int:
    """An edge is held, in the axes of its anchor; ``numbers``: a point of it and its direction, in the frame."""
    k = rows(at)
    R, w = k.place[0], three(k.motion[0], 3)
    arm, along = times(R, k.numbers), times(R, k.numbers[3:])
    bent = cross(w, cross(w, arm))
    for r in range(3):
        axis = three(k.other[r], 0)
        k.e[r] = _hold(k, r, axis, arm)
        k.bent[r] = dot(axis, bent)
    for r in range(3, 5):
        axis = three(k.other[r - 2], 0)
        k.C[r, 3], k.C[r, 4], k.C[r, 5] = axis[0], axis[1], axis[2]
    # d × x in the axes of the surface is (0, z, −y)
    k.e[3], k.e[4] = dot(three(k.other[2], 0), along), -dot(three(k.other[1], 0), along)
    return 1


@callee
def admittance(at: int) -> int:
    """A pose that a wrench moves; ``numbers``: which rows are held, compliances, mobilities, six each."""
    k = rows(at)
    held, compliance, mobility, wrench = k.numbers[:6], k.numbers[6:12], k.numbers[12:18], k.value[12:18]
    turn_error(k.value[:9].reshape((3, 3)), k.place[0, :9].reshape((3, 3)), k.work)
    for i in range(3):
        k.e[i] = k.value[9 + i] - k.place[0, 9 + i] + compliance[i] * wrench[i]
        k.e[3 + i] = k.work[9 + i] + compliance[3 + i] * wrench[3 + i]
    for r in range(6):
        k.e[r] *= held[r]
        k.C[r, r] = 1.0
        k.rate_ref[r], k.acc_ref[r] = k.rate[r] + mobility[r] * wrench[r], k.second[r]
    return 1


@kernel
def _seen(k: Rows) -> tuple[Vec, Mat]:
    """The position (3,) and rotation (3, 3) of the first frame seen from the second; writes the rows of its motion.

    With d = p − p_ref, ω_ref the reference's angular velocity and R its axes:

        ẋ = Rᵀ (ḋ − ω_ref × d)                                       ω_rel = Rᵀ (ω − ω_ref)
        ẍ = Rᵀ (d̈ − ω̇_ref × d − 2 ω_ref × ḋ + ω_ref × (ω_ref × d))    ω̇_rel = Rᵀ (ω̇ − ω̇_ref − ω_ref × ω)

    ``numbers`` say which of the six rows are wanted.
    """
    at, R = k.work[:3], k.work[3:12].reshape((3, 3))
    axes, w_ref = k.place[1], three(k.motion[1], 3)
    d = plus(three(k.place[0], 9), -1.0, three(k.place[1], 9))
    d_rate = plus(three(k.motion[0], 0), -1.0, three(k.motion[1], 0))
    bent = back(axes, cross(w_ref, plus(cross(w_ref, d), -2.0, d_rate)))
    bent_turn = back(axes, cross(three(k.motion[0], 3), w_ref))
    x = back(axes, d)
    for i in range(3):
        at[i] = x[i]
        for j in range(3):
            R[i, j] = 0.0
            for c in range(3):
                R[i, j] += axes[3 * c + i] * k.place[0, 3 * c + j]
    for r in range(len(k.e)):
        row = int(k.numbers[r])
        i = row % 3
        axis = axes[i], axes[3 + i], axes[6 + i]
        if row < 3:
            arm = cross(axis, d)
            for c in range(3):
                k.C[r, c], k.C[r, 6 + c], k.C[r, 9 + c] = axis[c], -axis[c], arm[c]
            k.bent[r] = bent[i]
        else:
            for c in range(3):
                k.C[r, 3 + c], k.C[r, 9 + c] = axis[c], -axis[c]
            k.bent[r] = bent_turn[i]
    return at, R


@callee
def relative_pose(at: int) -> int:
    """Position and orientation of a frame seen from another, or one of them."""
    k = rows(at)
    p, R = _seen(k)
    if len(k.value) > 3:
        pose_error(k, k.value[:9].reshape((3, 3)), k.value[9:], R, p, k.work[12:])
    else:
        for i in range(3):
            k.e[i] = k.value[i] - p[i]
    return follow(k)


@callee
def closure(at: int) -> int:
    """What a loop that is closed has opened by: the pose at which it was closed is the target."""
    k = rows(at)
    p, R = _seen(k)
    pose_error(k, k.other.T, k.origin, R, p, k.work[12:])
    return 1


@callee
def distance(at: int) -> int:
    """How far a frame is from another, or from the point ``numbers``; in one point it counts as beside it along x."""
    k = rows(at)
    two = len(k.place) > 1
    p, velocity = three(k.place[0], 9), three(k.motion[0], 0)
    x = plus(p, -1.0, three(k.place[1], 9)) if two else plus(p, -1.0, three(k.numbers, 0))
    if two:
        velocity = plus(velocity, -1.0, three(k.motion[1], 0))
    r = sqrt(dot(x, x))
    n: Three = scaled(1.0 / r, x) if r > 0.0 else (1.0, 0.0, 0.0)
    for c in range(3):
        k.C[0, c] = n[c]
        if two:
            k.C[0, 6 + c] = -n[c]
    along = dot(n, velocity)
    k.e[0], k.bent[0] = k.value[0] - r, (dot(velocity, velocity) - along * along) / max(r, NEAREST)
    k.rate_ref[0], k.acc_ref[0] = k.rate[0], k.second[0]
    return 1


@callee
def wheel(at: int) -> int:
    """Velocities of the point of a wheel on level ground, along sums of the heading t, across it l and the normal n.

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
