"""Rows that are linear in how a few things move: what a kernel says of them, and what becomes of it.

A kernel gets where these things are and how they move, and writes e, the rows C of J = Σ Cᵢ Jᵢ, ``bent`` of
J̇ v = Σ Cᵢ (J̇ᵢ v) + bent, and how the target moves. What it needs of Pinocchio is found here, for all kernels alike.
Matrices of Pinocchio are stored column by column, so that an array made of its memory is the transpose.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from wbc.compiled import Layout, call_at, carray, copy, floats, kernel
from wbc.qp.rows.compiled.linear import clear
from wbc.stack.compiled.geometry import cross, plus, three
from wbc.types import Index, Mat, Vec

#: What a thing is.
FRAME, CENTRE, MOMENTUM = 0, 1, 2
#: Numbers in the table of a thing before the columns that move it: what it is, how many columns move it, addresses of
#: rotation, position, velocity, acceleration and columns.
THING = 8


class Rows(NamedTuple):
    """What a kernel reads (of each of n things) and what it writes."""

    place: Annotated[Mat, "n, 12"]  # rotation by rows, position in the world
    motion: Annotated[Mat, "n, 12"]  # velocity J v and, at a = 0, its rate J̇ v; zero where velocities are decided
    numbers: Annotated[Vec, "settings"]
    value: Annotated[Vec, "values"]  # the target
    rate: Annotated[Vec, "rates"]  # its rate
    second: Annotated[Vec, "rates"]  # and its acceleration
    q: Annotated[Vec, "nj"]  # joints
    v: Annotated[Vec, "nj"]  # and their velocities
    other: Annotated[Mat, "3, 3"]  # the anchor of a contact: its rotation stored by columns
    origin: Annotated[Vec, "3"]  # and its position
    e: Annotated[Vec, "dim"]
    C: Annotated[Mat, "dim, width"]  # width 6 n, or that of A of a force; zero
    bent: Annotated[Vec, "dim"]  # zero
    rate_ref: Annotated[Vec, "dim"]  # zero
    acc_ref: Annotated[Vec, "dim"]  # zero
    drift: Annotated[Vec, "dim"]
    work: Annotated[Vec, "24"]
    bias: Annotated[Vec, "nv"]  # gravity, or all of h
    velocity: Annotated[Vec, "nv"]  # all velocities
    things: Annotated[Index, f"n, {THING} + nv"]  # of each its table
    placements: Annotated[Mat, "n, 12"]  # of frames, on their joints
    sizes: Annotated[Index, "12"]  # see :func:`write`


LAYOUT = Layout(
    Rows, dim="sizes[1]", n="sizes[2]", nv="sizes[3]", settings="sizes[6]", values="sizes[7]", rates="sizes[8]",
    nj="sizes[9]", width="sizes[10]",
)  # fmt: skip
#: In a kernel: the arrays at an address.
rows = LAYOUT.views


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
    copy(rate, motion[6 : 6 + width])
    for c in range(nv):
        for i in range(width):
            motion[i] += columns[c, i] * velocity[c]
    if width == 3:
        p = carray(floats(thing[3]), 3)
        copy(p, place[9:])


@kernel
def write(at: int) -> int:
    """Write the rows of one member.

    ``sizes``: place of the kernel, rows, things, nv, columns of G or 0 where J stays as it is, whether accelerations
    are decided, numbers, target, its rate, nj, columns of C, address of the first row of J.
    """
    k = rows(at)
    dim, n, nv, columns, second = k.sizes[1], k.sizes[2], k.sizes[3], k.sizes[4], k.sizes[5] > 0
    k.motion[:], k.C[:], k.bent[:], k.rate_ref[:], k.acc_ref[:] = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        if k.things[i, 0] == FRAME:
            _see_frame(k.things[i], k.placements[i], second, k.place[i], k.motion[i])
        else:
            _see_whole(k.things[i], nv, k.velocity, k.place[i], k.motion[i])
    if call_at(k.sizes[0], at) != 1:
        return 0
    if columns == 0:
        return 1
    J = carray(floats(k.sizes[11]), (dim, columns))
    for r in range(dim if n > 1 else 0):
        clear(J[r][:nv])
    for i in range(n):
        _write_columns(k.C, 6 * i, k.things[i], k.place[i], nv, n > 1, J)
    if second:
        for r in range(dim):
            k.drift[r] = k.bent[r]
            for i in range(n):
                for c in range(6):
                    k.drift[r] += k.C[r, 6 * i + c] * k.motion[i, 6 + c]
    return 1
