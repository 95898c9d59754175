"""Rows of frames and of the centre of mass, from Pinocchio's own memory: what ``fill`` of a task writes, compiled.

Matrices of Pinocchio are stored column by column, so that an array (3, 3) made of its memory is the transpose.
"""

from __future__ import annotations

from wbc.compiled import carray, floats, integers, kernel
from wbc.stack.compiled.geometry import log3, log6
from wbc.types import Index, Mat, Vec

#: Kinds of items.
WORLD, LOCAL, CENTRE, JOINTS = 0, 1, 2, 3


@kernel
def _place(R_joint: Mat, p_joint: Vec, placement: Vec, R: Mat, p: Vec) -> None:
    """Rotation and position of a frame in the world, from its joint's and its ``placement`` (12,) there."""
    for i in range(3):
        for j in range(3):
            R[i, j] = R_joint[0, i] * placement[j] + R_joint[1, i] * placement[3 + j] + R_joint[2, i] * placement[6 + j]
        p[i] = p_joint[i] + R_joint[0, i] * placement[9] + R_joint[1, i] * placement[10] + R_joint[2, i] * placement[11]


@kernel
def _moved(spatial: Vec, placement: Vec, out: Vec) -> None:
    """A joint's spatial velocity or acceleration (6,) seen from a frame on it: linear, then angular."""
    x, y, z = placement[9], placement[10], placement[11]
    w0, w1, w2 = spatial[3], spatial[4], spatial[5]
    u0, u1, u2 = spatial[0] - (y * w2 - z * w1), spatial[1] - (z * w0 - x * w2), spatial[2] - (x * w1 - y * w0)
    for i in range(3):
        a, b, c = placement[i], placement[3 + i], placement[6 + i]
        out[i] = a * u0 + b * u1 + c * u2
        out[3 + i] = a * w0 + b * w1 + c * w2


@kernel
def _columns(Jw: Mat, support: Index, n_support: int, R: Mat, p: Vec, local: bool, turn: Vec, turned: bool,
             where: Index, G: Mat) -> None:  # fmt: skip
    """The Jacobian of a point p, from the joints' columns about the world's origin; ``where`` each of six rows goes."""
    for s in range(n_support):
        c = support[s]
        J = Jw[c]
        w0, w1, w2 = J[3], J[4], J[5]
        x0, x1, x2 = J[0] + w1 * p[2] - w2 * p[1], J[1] + w2 * p[0] - w0 * p[2], J[2] + w0 * p[1] - w1 * p[0]
        if local:
            for i in range(3):
                G[where[i], c] = R[0, i] * x0 + R[1, i] * x1 + R[2, i] * x2
                G[where[3 + i], c] = R[0, i] * w0 + R[1, i] * w1 + R[2, i] * w2
            continue
        if turned:
            y0, y1, y2 = x0, x1, x2
            x0 = turn[0] * y0 + turn[1] * y1 + turn[2] * y2
            x1 = turn[3] * y0 + turn[4] * y1 + turn[5] * y2
            x2 = turn[6] * y0 + turn[7] * y1 + turn[8] * y2
        if where[0] >= 0:
            G[where[0], c] = x0
        if where[1] >= 0:
            G[where[1], c] = x1
        if where[2] >= 0:
            G[where[2], c] = x2
        if where[3] >= 0:
            G[where[3], c], G[where[4], c], G[where[5], c] = w0, w1, w2


@kernel
def _error(local: bool, R: Mat, p: Vec, target: Mat, place: Vec, table: Vec, where: Index, S: Mat, w: Vec, six: Vec,
           e: Vec) -> None:  # fmt: skip
    """``target`` and ``place``: rotation and position wanted. A local one is an anchor, in Pinocchio's memory."""
    x, y, z = place[0] - p[0], place[1] - p[1], place[2] - p[2]
    if local:
        for i in range(3):
            for j in range(3):
                S[i, j] = R[0, i] * target[j, 0] + R[1, i] * target[j, 1] + R[2, i] * target[j, 2]
        for i in range(3):
            six[i] = R[0, i] * x + R[1, i] * y + R[2, i] * z
        w[0], w[1], w[2] = six[0], six[1], six[2]
        log6(S, w, six[3:], six)
    else:
        for i in range(3):
            six[i] = table[12 + i] * (table[3 * i] * x + table[3 * i + 1] * y + table[3 * i + 2] * z)
        if where[3] >= 0:
            for i in range(3):
                for j in range(3):
                    S[i, j] = target[i, 0] * R[j, 0] + target[i, 1] * R[j, 1] + target[i, 2] * R[j, 2]
            log3(S, six[3:])
    for i in range(6):
        if where[i] >= 0:
            e[where[i]] = six[i]


@kernel
def _drift(local: bool, V: Vec, A: Vec, R: Mat, offset: Vec, turn: Vec, where: Index, drift: Vec) -> None:
    """J̇ v from the frame's spatial velocity V and acceleration A (with a = 0) in its own axes."""
    if local:
        for i in range(6):
            drift[where[i]] = A[i]
        return
    a0 = A[0] + V[4] * V[2] - V[5] * V[1]
    a1 = A[1] + V[5] * V[0] - V[3] * V[2]
    a2 = A[2] + V[3] * V[1] - V[4] * V[0]
    x0, w0 = R[0, 0] * a0 + R[0, 1] * a1 + R[0, 2] * a2, R[0, 0] * A[3] + R[0, 1] * A[4] + R[0, 2] * A[5]
    x1, w1 = R[1, 0] * a0 + R[1, 1] * a1 + R[1, 2] * a2, R[1, 0] * A[3] + R[1, 1] * A[4] + R[1, 2] * A[5]
    x2, w2 = R[2, 0] * a0 + R[2, 1] * a1 + R[2, 2] * a2, R[2, 0] * A[3] + R[2, 1] * A[4] + R[2, 2] * A[5]
    x0 += w1 * offset[2] - w2 * offset[1]
    x1 += w2 * offset[0] - w0 * offset[2]
    x2 += w0 * offset[1] - w1 * offset[0]
    if where[0] >= 0:
        drift[where[0]] = turn[0] * x0 + turn[1] * x1 + turn[2] * x2
    if where[1] >= 0:
        drift[where[1]] = turn[3] * x0 + turn[4] * x1 + turn[5] * x2
    if where[2] >= 0:
        drift[where[2]] = turn[6] * x0 + turn[7] * x1 + turn[8] * x2
    if where[3] >= 0:
        drift[where[3]], drift[where[4]], drift[where[5]] = w0, w1, w2


@kernel
def fill_rows(memory: Index, n_items: int, nv: int, q: Vec, second: bool, G: Mat, e: Vec, drift: Vec) -> None:
    """Write J into ``G``, e and, at the ``second`` order, the drift of every item; ``q`` (nj,) are the joints.

    ``memory``: items (k, 9), of each its kind, the size of its support, whether it is turned, and where its six rows go
    (−1: nowhere); supports (k, nv), the columns that move it; tables (k, 27), its placement in its joint (rotation by
    rows, position) and :meth:`FrameRows.table`; addresses (k, 6), rotation and position of its joint, its velocity and
    acceleration, rotation and position of the target; joint Jacobians; Jacobian, position and drift of the centre of
    mass; 42 numbers to work in.
    """
    items, supports = carray(integers(memory[0]), (n_items, 9)), carray(integers(memory[1]), (n_items, nv))
    tables, addresses = carray(floats(memory[2]), (n_items, 27)), carray(integers(memory[3]), (n_items, 6))
    Jw, J_com = carray(floats(memory[4]), (nv, 6)), carray(floats(memory[5]), (nv, 3))
    com, com_drift = carray(floats(memory[6]), 3), carray(floats(memory[7]), 3)
    nj, work = len(q), carray(floats(memory[8]), 42)
    R, S = work[0:9].reshape((3, 3)), work[9:18].reshape((3, 3))
    p, w, six, V, A = work[18:21], work[21:24], work[24:30], work[30:36], work[36:42]
    for k in range(n_items):
        item, table = items[k], tables[k]
        where, turn, offset = item[3:], table[12:21], table[21:24]
        if item[0] == JOINTS:
            target, row = carray(floats(addresses[k, 4]), nj), item[3]
            for j in range(nj):
                e[row + j] = target[j] - q[j]
            continue
        place = carray(floats(addresses[k, 5]), 3)
        if item[0] == CENTRE:
            for i in range(3):
                row = where[i]
                if row >= 0:
                    for c in range(nv):
                        G[row, c] = J_com[c, i]
                    e[row] = place[i] - com[i]
                    if second:
                        drift[row] = com_drift[i]
            continue
        local = item[0] == LOCAL
        _place(carray(floats(addresses[k, 0]), (3, 3)), carray(floats(addresses[k, 1]), 3), table, R, p)
        if not local:
            for i in range(3):
                p[i] += offset[i]
        _columns(Jw, supports[k], item[1], R, p, local, turn, item[2] > 0, where, G)
        _error(local, R, p, carray(floats(addresses[k, 4]), (3, 3)), place, table[12:], where, S, w, six, e)
        if second:
            _moved(carray(floats(addresses[k, 2]), 6), table, V)
            _moved(carray(floats(addresses[k, 3]), 6), table, A)
            _drift(local, V, A, R, offset, turn, where, drift)
