"""A tick in one call: what a plan writes for its solver, whether all of it are numbers, and the solver's answer."""

from __future__ import annotations

from math import inf

from wbc.compiled import call_at, carray, copy, entry, floats, integers, part
from wbc.qp.rows.compiled.linear import add
from wbc.stack.compiled.damping_kernel import follow, observe_all, share
from wbc.stack.compiled.finish_kernel import write_all
from wbc.stack.compiled.interval_kernel import joint_bounds
from wbc.tolerances import MODERATE

#: Where the address of v (nv,) stands in what :func:`fill` reads.
VELOCITY = 5


@part
def fill(at: int) -> None:
    """What tasks that are followed, the gains of :class:`~wbc.stack.motion.MotionRows` and the plan itself write.

    At ``at``: sizes (order, nv, nb, nf, columns of G, motion rows m, blocks of joints, first motion row, first
    contact row, columns of u, whether there are dynamics, whether inertia is added, what
    ``write_all`` reads of tasks, and of others, items), what the code below reads by name, from place 14 on what
    ``joint_bounds`` does, and the lower and upper bounds of all items.
    """
    memory = carray(integers(at), 18)
    sizes = carray(integers(memory[0]), 14)
    order, nv, nb, nf, columns, m, n_joint_blocks = (
        sizes[0], sizes[1], sizes[2], sizes[3], sizes[4], sizes[5], sizes[6],
    )  # fmt: skip
    first, contact, n_u, dynamics = sizes[7], sizes[8], sizes[9], sizes[10] > 0
    nj = nv - nb
    total = m + n_joint_blocks * nj
    G, numbers = carray(floats(memory[1]), (first + m, columns)), carray(floats(memory[2]), (10, total))
    e, drift, rate_ref, acc_ref, wanted = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    kp, kd, rate, own_ed, writes_ed = numbers[5], numbers[6], numbers[7], numbers[8], numbers[9]
    share, centre = carray(floats(memory[3]), n_joint_blocks * nj), carray(floats(memory[4]), nv - n_u)
    v, q = carray(floats(memory[VELOCITY]), nv), carray(floats(memory[13]), nj)

    write_all(sizes[12], memory[VELOCITY])
    for i in range(total):
        if order == 1:
            wanted[i] = rate[i] * e[i] + rate_ref[i]
        else:
            if writes_ed[i] > 0.0:
                ed = own_ed[i]
            elif i < m:
                row, ed = G[first + i], rate_ref[i]
                for c in range(nv):
                    ed -= row[c] * v[c]
            else:
                ed = rate_ref[i] - v[nb + (i - m) % nj]
            wanted[i] = kp[i] * e[i] + kd[i] * ed + acc_ref[i] - drift[i]
        if i < m:
            G[first + i, columns - 1] = -wanted[i]
    for j in range(nj):
        pull = 0.0
        for k in range(n_joint_blocks):
            pull += share[k * nj + j] * wanted[m + k * nj + j]
        centre[nb - n_u + j] = pull
    if dynamics:
        M, h = carray(floats(memory[6]), (nv, nv)), carray(floats(memory[7]), nv)
        extra, force_scale = carray(floats(memory[8]), nv), carray(floats(memory[9]), nf)
        more_inertia = carray(floats(memory[10]), (nv, nv))
        for i in range(nv):
            copy(M[i], G[i][:nv])
            if sizes[11] > 0:
                add(1.0, more_inertia[i], nv, G[i])
            G[i, columns - 1] = h[i] + extra[i]
        for f in range(nf):
            J, scale = G[contact + f], -force_scale[f]
            for i in range(nv):
                G[i, nv + f] = scale * J[i]
    lower, upper = carray(floats(memory[11]), nj), carray(floats(memory[12]), nj)
    joint_bounds(memory[14:], nj, order, q, v[nb:], lower, upper)
    write_all(sizes[13], memory[VELOCITY])


#: What :func:`spoilt` finds.
ROW_SPOILT, BOUND_SPOILT = 1, 2


@part
def spoilt(at: int) -> int:
    """Whether the rows, or what is wanted of the joints, are not finite, or huge; and whether a bound is NaN.

    At ``at``: what :func:`fill` reads.
    """
    memory = carray(integers(at), 20)
    sizes = carray(integers(memory[0]), 15)
    total_rows = sizes[5] + sizes[6] * (sizes[1] - sizes[2])
    G = carray(floats(memory[1]), (sizes[7] + sizes[5]) * sizes[4])
    wanted = carray(floats(memory[2]), (10, total_rows))[4]
    lower, upper = carray(floats(memory[18]), sizes[14]), carray(floats(memory[19]), sizes[14])
    total = 0.0
    for i in range(len(G)):
        total += abs(G[i])
    for i in range(len(wanted)):
        total += abs(wanted[i])
    found = 0 if total < MODERATE else ROW_SPOILT
    for i in range(len(lower)):
        if not (lower[i] <= inf and upper[i] <= inf):
            found |= BOUND_SPOILT
    return found


#: The stages of a tick, to be asked for one by one or together.
OBSERVE, FILL, LOOK, ANSWER = 1, 2, 4, 8
#: What :func:`tick` reads: addresses of what ``fill``, the dampings and ``share`` read; place and argument of the
#: solver's code. What it writes: what ``spoilt`` found.
FILLS, DAMPINGS, SHARES, PLACE, SOLVER, SPOILT, NUMBER = range(7)


@entry
def tick(at: int, asked: int) -> int:
    """The stages of a tick that are asked for; the answer of the solver's code, 0 where it was not called.

    Less than zero: minus the stages that are left, since what comes before them is not compiled.
    """
    m = carray(integers(at), NUMBER)
    if asked & OBSERVE and observe_all(m[DAMPINGS]):
        share(m[SHARES])
    if asked & FILL:
        fill(m[FILLS])
        follow(m[DAMPINGS], carray(integers(m[FILLS]), VELOCITY + 1)[VELOCITY])
    if asked & LOOK:
        m[SPOILT] = spoilt(m[FILLS])
        if m[SPOILT]:
            return int(-(asked & ANSWER))
    return int(call_at(m[PLACE], m[SOLVER])) if asked & ANSWER else 0
