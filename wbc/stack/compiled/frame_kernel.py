"""Rows about one frame: where it is, and what holds it."""

from __future__ import annotations

from wbc.compiled import callee, kernel
from wbc.stack.compiled.geometry import Three, back, cross, dot, log3, log6, plus, three, times
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
