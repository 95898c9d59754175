"""The memory of the core: one vector of addresses, and the arrays that kernels see there.

Every kernel gets one number, the address of that vector, and makes the views that it uses. What a function does not use
costs nothing, and no view has an owner whose references would be counted.
"""

from __future__ import annotations

from typing import NamedTuple

from wbc.compiled import carray, floats, integers, small_kernel
from wbc.types import Index, Mat, Vec

#: What K and F are made of; see :mod:`wbc.qp.rows.compiled.equality`.
ROWS, VARIABLES = 0, 1
#: How a search ends.
SOLVED, INFEASIBLE, FAILED, INACCURATE = 0, 1, 2, 3


class Work(NamedTuple):
    """Views of the problem's memory, then of the core's own; k rows of E at most, m items that have bounds.

    *Items* are the unknowns y, then the range rows, then the equalities, whose bounds are equal.
    """

    G: Mat  # (n_rows, n + 1): [B; R; S; L]
    value: Vec  # [x | 1 | G x̂]
    lower: Vec  # bounds of ``value``
    upper: Vec
    metric: Vec  # D (n_y)
    centre: Vec  # c (n_y)
    scale: Vec  # (n)
    given: Vec  # weights of the soft rows (n_soft), in units of the cost
    weights: Vec  # w (n_soft + n_u): these over the unit, then the regularisation of u
    compliance: Vec  # 1 / w (n_soft + n_u), 0 without weight
    reach: Vec  # (n_soft + n_y): what a unit of distance is in the task's unit
    push: Vec  # π (n_rows): the multipliers that are certified
    z: Vec  # (n): those of the bounds
    left: Vec  # (n_y): what they leave of the gradient
    proof: Vec  # (7): primal, dual, gap, scales of the two, distance, spread
    numbers: Vec  # unit | regularisation | what is near enough | held rows, beside what counts
    sizes: Index  # n_u, n_y, n_range, n_soft, n_equal, form | rows of E, guesses, steps
    side: Vec  # (m): +1 held at the upper bound, −1 at the lower, 0 free
    best: Vec  # (m): the best guess
    wrong: Vec  # (m): 1 where the working set is wrong
    item: Index  # (k): item of each row of E, −1 of one with a weight
    root: Vec  # (n_y): D^−½, 0 at pins
    free: Vec  # (n_y): 0 at pins, else 1
    r: Vec  # (n_y): what is left of the gradient
    t: Vec  # (n_y + 1): work
    lam: Vec  # λ (k)
    rho: Vec  # (k): what is left of the rows
    a: Vec  # (k): work
    length: Vec  # (k): squared lengths of the rows of F
    base: Vec  # (n_u): work
    B: Mat  # (n_u, n_u): Cholesky factor of B_u
    X: Mat  # (n_u, n_y + 1): B_u⁻¹ [B_y | b]
    H: Mat  # (n_y, n_y): Cholesky factor of D + Sᵀ w S
    E: Mat  # (k, n_y + 1): soft rows, X, then held ones, in y
    F: Mat  # (k, n_y): E M^−½
    K: Mat  # (k, k): Cholesky factor of F Fᵀ + C
    unit: Vec  # (1): what the cost is divided by


@small_kernel
def views(at: int) -> Work:
    """The arrays whose addresses are at ``at``, in the order of :class:`Work`."""
    m = carray(integers(at), 37)
    s = carray(integers(m[16]), 9)
    nu, ny, nr, ns, nl = s[0], s[1], s[2], s[3], s[4]
    n, rows, items = nu + ny, nu + nr + ns + nl, ny + nr + nl
    k = ns + nu + items + 1 if items < ny + nl else ns + nu + ny + nl + 1
    return Work(
        carray(floats(m[0]), (rows, n + 1)), carray(floats(m[1]), n + 1 + rows), carray(floats(m[2]), n + 1 + rows),
        carray(floats(m[3]), n + 1 + rows), carray(floats(m[4]), ny), carray(floats(m[5]), ny), carray(floats(m[6]), n),
        carray(floats(m[7]), ns), carray(floats(m[8]), ns + nu), carray(floats(m[9]), ns + nu),
        carray(floats(m[10]), ns + ny), carray(floats(m[11]), rows), carray(floats(m[12]), n),
        carray(floats(m[13]), ny),
        carray(floats(m[14]), 7), carray(floats(m[15]), 4), s,
        carray(floats(m[17]), items), carray(floats(m[18]), items), carray(floats(m[19]), items),
        carray(integers(m[20]), k), carray(floats(m[21]), ny), carray(floats(m[22]), ny), carray(floats(m[23]), ny),
        carray(floats(m[24]), ny + 1), carray(floats(m[25]), k), carray(floats(m[26]), k), carray(floats(m[27]), k),
        carray(floats(m[28]), k), carray(floats(m[29]), nu), carray(floats(m[30]), (nu, nu)),
        carray(floats(m[31]), (nu, ny + 1)), carray(floats(m[32]), (ny, ny)), carray(floats(m[33]), (k, ny + 1)),
        carray(floats(m[34]), (k, ny)), carray(floats(m[35]), (k, k)), carray(floats(m[36]), 1),
    )  # fmt: skip


@small_kernel
def weighed(s: Work) -> int:
    """How many rows of E have a weight: the soft rows, and X for the regularisation of u."""
    return int(s.sizes[3] + s.sizes[0])


@small_kernel
def place_of(s: Work, item: int) -> int:
    """Where an item stands in ``value`` and its bounds."""
    nu, ny, nr, ns = s.sizes[0], s.sizes[1], s.sizes[2], s.sizes[3]
    if item < ny:
        return int(nu + item)
    first_range = 2 * nu + ny + 1
    return int(first_range + item - ny if item < ny + nr else first_range + item - ny + ns)


@small_kernel
def is_fixed(s: Work, item: int) -> bool:
    """Whether both bounds of an item are the same value."""
    place = place_of(s, item)
    return bool(s.lower[place] == s.upper[place])


@small_kernel
def bound_of(s: Work, item: int) -> float:
    """The bound at which an item is held."""
    place = place_of(s, item)
    return float(s.upper[place] if s.side[item] > 0.0 else s.lower[place])
