"""Rows about two frames: how one moves seen from the other, and how far apart they are."""

from __future__ import annotations

from math import sqrt

from wbc.compiled import callee, kernel
from wbc.stack.compiled.frame_kernel import pose_error
from wbc.stack.compiled.geometry import NEAREST, Three, back, cross, dot, plus, scaled, three
from wbc.stack.compiled.row_kernel import Rows, follow, rows
from wbc.types import Mat, Vec


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
def pose(at: int) -> int:
    """Position and orientation, or one of them."""
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
