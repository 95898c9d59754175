"""What becomes of rows that are no task's: barriers, bounds and linear tasks on velocities, torques and forces."""

from __future__ import annotations

from math import nan

from wbc.compiled import carray, floats, integers, part
from wbc.qp.rows.compiled.linear import add
from wbc.stack.compiled.reference_kernel import refer
from wbc.stack.compiled.row_kernel import rows, write

#: What rows are about: h(q, t) >= 0, the unknown itself, the velocity that a tick ends with, torques, forces.
BARRIER, UNKNOWN, VELOCITY, TORQUE, FORCE = range(5)


@part
def finish(at: int, v_at: int) -> None:
    """Rows of x̂ = [x | 1] and their bounds, from what a member wrote, for all velocities at ``v_at``.

    At ``at``: sizes (what the rows are about, how many, nv, columns of G, whether accelerations are decided, columns of
    A, whether b is the bounds, the first column by which rows may be broken or −1); the rows; h or b, its drift,
    ∂h/∂t; lower and upper bounds; A; rows of torques; columns of forces; scale of the columns; the rate of a barrier,
    dt.
    """
    m = carray(integers(at), 12)
    sizes = carray(integers(m[0]), 8)
    about, dim, nv, columns, second, width = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4] > 0, sizes[5]
    G, last, numbers = carray(floats(m[1]), (dim, columns)), columns - 1, carray(floats(m[11]), 2)
    b, drift, rate = carray(floats(m[2]), dim), carray(floats(m[3]), dim), carray(floats(m[4]), dim)
    lower, upper = carray(floats(m[5]), dim), carray(floats(m[6]), dim)
    A, scale, v = carray(floats(m[7]), (dim, width)), carray(floats(m[10]), columns), carray(floats(v_at), nv)
    for r in range(dim):
        row = G[r]
        if about == BARRIER:
            gamma = numbers[0]
            if second:  # ḧ >= −2 γ ḣ − γ² h
                h_rate = rate[r]
                for c in range(nv):
                    h_rate += row[c] * v[c]
                row[last], lower[r] = drift[r], -2.0 * gamma * h_rate - gamma * gamma * b[r]
            else:  # ḣ >= −γ h
                lower[r] = -gamma * b[r] - rate[r]
        elif about == VELOCITY:  # v + a dt
            row[last] = 0.0
            for c in range(nv):
                row[last] += A[r, c] * v[c]
                row[c] = A[r, c] * numbers[1]
        elif about == TORQUE:
            torques = carray(floats(m[8]), (width, columns))
            row[:] = 0.0
            for k in range(width):
                share = A[r, k]
                if share != 0.0:
                    add(share, torques[k], columns, row)
        else:
            row[last] = 0.0
            if about == FORCE:
                where = carray(integers(m[9]), width)
                for k in range(width):
                    row[where[k]] = A[r, k] * scale[where[k]]
        if sizes[6] > 0:
            lower[r] = upper[r] = b[r] - drift[r]
        elif sizes[6] == 0:
            row[last] -= b[r] - drift[r]
        if sizes[7] >= 0:
            row[sizes[7] + r] = scale[sizes[7] + r]


@part
def pick(at: int) -> None:
    """Rows of a barrier h = s e + bound, ḣ = s (ẏ_ref − J v), of the error e of a task.

    At ``at``: sizes (rows, rows of the task, nv, columns of G); of each row which one of the task it is, s, and bound;
    e, drift, rate and acceleration of the target, and J of the task; h, its drift, ∂h/∂t; the rows of G.
    """
    m = carray(integers(at), 13)
    sizes = carray(integers(m[0]), 4)
    dim, of_task, nv, columns = sizes[0], sizes[1], sizes[2], sizes[3]
    picked, sign, bound = carray(integers(m[1]), dim), carray(floats(m[2]), dim), carray(floats(m[3]), dim)
    e, own_drift = carray(floats(m[4]), of_task), carray(floats(m[5]), of_task)
    rate_ref, acc_ref = carray(floats(m[6]), of_task), carray(floats(m[7]), of_task)
    J, h, drift = carray(floats(m[8]), (of_task, nv)), carray(floats(m[9]), dim), carray(floats(m[10]), dim)
    rate, G = carray(floats(m[11]), dim), carray(floats(m[12]), (dim, columns))
    for r in range(dim):
        i, s = picked[r], sign[r]
        h[r], rate[r], drift[r] = s * e[i] + bound[r], s * rate_ref[i], s * (acc_ref[i] - own_drift[i])
        for c in range(nv):
            G[r, c] = -s * J[i, c]


@part
def write_all(at: int, v_at: int) -> None:
    """Evaluate what targets follow, and write the rows of each member; errors of one whose kernel failed are NaN.

    At ``at``: sizes (members, targets that are known motions), these, the time, and of each member where its memory is,
    and where those of :func:`pick` and :func:`finish` are, 0 where these have nothing to do.
    """
    m = carray(integers(at), 4)
    sizes = carray(integers(m[0]), 2)
    refer(carray(integers(m[1]), (sizes[1], 6)), carray(floats(m[2]), 1)[0])
    items = carray(integers(m[3]), (sizes[0], 3))
    for k in range(len(items)):
        if write(items[k, 0]) == 0:
            rows(items[k, 0]).e[:] = nan
        if items[k, 1] > 0:
            pick(items[k, 1])
        if items[k, 2] > 0:
            finish(items[k, 2], v_at)
