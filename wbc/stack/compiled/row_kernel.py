"""Rows that are linear in how a few things move: what a kernel says of them, and what becomes of it.

A kernel gets where these things are and how they move, and writes e, the rows C of J = Σ Cᵢ Jᵢ, ``bent`` of
J̇ v = Σ Cᵢ (J̇ᵢ v) + bent, and how the target moves. What it needs of Pinocchio is found here, for all kernels alike.
Matrices of Pinocchio are stored column by column, so that an array made of its memory is the transpose.
"""

from __future__ import annotations

from typing import NamedTuple

from wbc.compiled import call_at, carray, floats, integers, kernel, small_kernel
from wbc.stack.compiled.geometry import cross, plus, three
from wbc.types import Index, Mat, Vec

#: What a thing is.
FRAME, CENTRE, MOMENTUM = 0, 1, 2
#: Numbers in the table of a thing before the columns that move it; addresses of an item, numbers to work in.
THING, ADDRESSES, WORK = 8, 23, 24


class Rows(NamedTuple):
    """What a kernel reads (of each thing) and what it writes."""

    place: Mat  # (things, 12): rotation by rows, position in the world
    motion: Mat  # (things, 12): velocity J v and, at a = 0, its rate J̇ v; zero where velocities are decided
    numbers: Vec  # settings
    value: Vec  # the target
    rate: Vec  # its rate
    second: Vec  # and its acceleration
    q: Vec  # joints (nj,)
    v: Vec  # and their velocities
    other: Mat  # (3, 3) and
    origin: Vec  # (3,): the anchor of a contact, its rotation stored by columns
    e: Vec
    C: Mat  # (dim, 6 things), or A of a force, zero
    bent: Vec  # (dim,), zero
    rate_ref: Vec  # (dim,), zero
    acc_ref: Vec  # (dim,), zero
    work: Vec  # (24,): memory
    bias: Vec  # (nv,): gravity, or all of h


@small_kernel
def rows(at: int) -> Rows:
    """What stands at ``at``; see :func:`write`."""
    m = carray(integers(at), ADDRESSES)
    sizes = carray(integers(m[0]), 11)
    dim, things, n, n_value, n_rate, nj = sizes[1], sizes[2], sizes[6], sizes[7], sizes[8], sizes[9]
    return Rows(
        carray(floats(m[3]), (things, 12)), carray(floats(m[4]), (things, 12)), carray(floats(m[12]), n),
        carray(floats(m[13]), n_value), carray(floats(m[14]), n_rate), carray(floats(m[15]), n_rate),
        carray(floats(m[16]), nj), carray(floats(m[17]), nj), carray(floats(m[18]), (3, 3)), carray(floats(m[19]), 3),
        carray(floats(m[8]), dim), carray(floats(m[5]), (dim, sizes[10])), carray(floats(m[6]), dim),
        carray(floats(m[10]), dim), carray(floats(m[11]), dim), carray(floats(m[21]), WORK),
        carray(floats(m[22]), sizes[3]),
    )  # fmt: skip


@kernel
def follow(k: Rows) -> int:
    """The rows move as their target does."""
    for r in range(len(k.e)):
        k.rate_ref[r], k.acc_ref[r] = k.rate[r], k.second[r]
    return 1


@kernel
def _see_frame(thing: Index, placement: Vec, second: bool, place: Vec, motion: Vec) -> None:
    """Where a frame is and how it moves, from its joint and its ``placement`` (12,) there."""
    R, p = carray(floats(thing[2]), (3, 3)), carray(floats(thing[3]), 3)
    for i in range(3):
        for j in range(3):
            place[3 * i + j] = R[0, i] * placement[j] + R[1, i] * placement[3 + j] + R[2, i] * placement[6 + j]
        place[9 + i] = p[i] + R[0, i] * placement[9] + R[1, i] * placement[10] + R[2, i] * placement[11]
    if not second:
        return
    V, A, arm = carray(floats(thing[4]), 6), carray(floats(thing[5]), 6), three(placement, 9)
    w, alpha = three(V, 3), three(A, 3)
    u, turn, bend = cross(w, arm), cross(alpha, arm), cross(w, three(V, 0))
    u = V[0] + u[0], V[1] + u[1], V[2] + u[2]
    centripetal = cross(w, cross(w, arm))
    for i in range(3):
        for j in range(3):
            # From the joint's axes; the classical acceleration has ω × v more than the spatial one.
            turned = R[j, i]
            motion[i] += turned * u[j]
            motion[3 + i] += turned * w[j]
            motion[6 + i] += turned * (A[j] + turn[j] + bend[j] + centripetal[j])
            motion[9 + i] += turned * alpha[j]


@kernel
def _write_columns(C: Mat, first: int, thing: Index, place: Vec, nv: int, adds: bool, J: Mat) -> None:
    """Six columns of C times what each velocity makes of one thing, in J or added to it. Those that do not move it
    stay."""
    width = 3 if thing[0] == CENTRE else 6
    columns, moving = carray(floats(thing[6]), (nv, width)), thing[THING:]
    for r in range(len(J)):
        row, out = C[r][first:], J[r]
        a, b = three(row, 0), three(row, 3)
        if thing[0] == FRAME:  # Pinocchio's columns are about the world's origin
            b = plus(b, 1.0, cross(three(place, 9), a))
        for k in range(thing[1]):
            c = moving[k]
            column = columns[c]
            x = a[0] * column[0] + a[1] * column[1] + a[2] * column[2]
            if width == 6:
                x += b[0] * column[3] + b[1] * column[4] + b[2] * column[5]
            out[c] = out[c] + x if adds else x


@kernel
def _see_whole(thing: Index, nv: int, velocity: Vec, place: Vec, motion: Vec) -> None:
    """Where the centre of mass is, and how it or the momentum changes."""
    width = 3 if thing[0] == CENTRE else 6
    columns, rate = carray(floats(thing[6]), (nv, width)), carray(floats(thing[5]), width)
    for i in range(width):
        motion[6 + i] = rate[i]
    for c in range(nv):
        for i in range(width):
            motion[i] += columns[c, i] * velocity[c]
    if width == 3:
        p = carray(floats(thing[3]), 3)
        for i in range(3):
            place[9 + i] = p[i]


@kernel
def write(at: int) -> int:
    """Write the rows of one member.

    At ``at``: sizes (address of the kernel, rows, things, nv, columns of G or 0 where J stays as it is, whether
    accelerations are decided, numbers, target, its rate, nj, columns of C); of each thing its kind, how many columns
    move it, addresses of rotation, position, velocity, acceleration and columns, and which columns; placements of
    frames; the memory of :class:`Rows`: places, motions, C, bent; the first row of J; e, drift, rate_ref, acc_ref;
    numbers, target, its rate and acceleration; joints, their velocities, rotation and position of an anchor, all
    velocities; memory; bias.
    """
    m = carray(integers(at), ADDRESSES)
    sizes = carray(integers(m[0]), 11)
    dim, n, nv, columns, second = sizes[1], sizes[2], sizes[3], sizes[4], sizes[5] > 0
    things, placements = carray(integers(m[1]), (n, THING + nv)), carray(floats(m[2]), (n, 12))
    places, motions = carray(floats(m[3]), (n, 12)), carray(floats(m[4]), (n, 12))
    C, bent = carray(floats(m[5]), (dim, sizes[10])), carray(floats(m[6]), dim)
    rate_ref, acc_ref = carray(floats(m[10]), dim), carray(floats(m[11]), dim)
    velocity = carray(floats(m[20]), nv)
    motions[:], C[:], bent[:], rate_ref[:], acc_ref[:] = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        if things[k, 0] == FRAME:
            _see_frame(things[k], placements[k], second, places[k], motions[k])
        else:
            _see_whole(things[k], nv, velocity, places[k], motions[k])
    if call_at(sizes[0], at) != 1:
        return 0
    if columns == 0:
        return 1
    J, drift = carray(floats(m[7]), (dim, columns)), carray(floats(m[9]), dim)
    for r in range(dim if n > 1 else 0):
        for c in range(nv):
            J[r, c] = 0.0
    for k in range(n):
        _write_columns(C, 6 * k, things[k], places[k], nv, n > 1, J)
    if second:
        for r in range(dim):
            drift[r] = bent[r]
            for k in range(n):
                for i in range(6):
                    drift[r] += C[r, 6 * k + i] * motions[k, 6 + i]
    return 1
