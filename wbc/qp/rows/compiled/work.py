"""The memory of the core: one vector of addresses, and the arrays that kernels see there.

Every kernel gets one number, the address of that vector, and makes the views that it uses. What a function does not use
costs nothing, and no view has an owner whose references would be counted.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from wbc.compiled import Layout, small_kernel
from wbc.types import Index, Mat, Vec

#: What K and F are made of; see :mod:`wbc.qp.rows.compiled.equality`.
ROWS, VARIABLES = 0, 1
#: How a search ends.
SOLVED, INFEASIBLE, FAILED, INACCURATE = 0, 1, 2, 3


class Work(NamedTuple):
    """Views of the problem's memory, then of the core's own; k rows of E at most, m items that have bounds.

    *Items* are the unknowns y, then the range rows, then the equalities, whose bounds are equal.
    """

    G: Annotated[Mat, "rows, n + 1"]  # [B; R; S; L]
    value: Annotated[Vec, "values"]  # [x | 1 | G x̂]
    lower: Annotated[Vec, "values"]  # bounds of ``value``
    upper: Annotated[Vec, "values"]
    metric: Annotated[Vec, "n_y"]  # D
    centre: Annotated[Vec, "n_y"]  # c
    scale: Annotated[Vec, "n"]
    given: Annotated[Vec, "n_soft"]  # weights of the soft rows, in units of the cost
    weights: Annotated[Vec, "n_soft + n_u"]  # w: these over the unit, then the regularisation of u
    compliance: Annotated[Vec, "n_soft + n_u"]  # 1 / w, 0 without weight
    reach: Annotated[Vec, "n_soft + n_y"]  # what a unit of distance is in the task's unit
    push: Annotated[Vec, "rows"]  # π: the multipliers that are certified
    z: Annotated[Vec, "n"]  # those of the bounds
    left: Annotated[Vec, "n_y"]  # what they leave of the gradient
    proof: Annotated[Vec, "7"]  # primal, dual, gap, scales of the two, distance, spread
    numbers: Annotated[Vec, "3"]  # regularisation | what is near enough | held rows, beside what counts
    sizes: Annotated[Index, "9"]  # n_u, n_y, n_range, n_soft, n_equal, form | rows of E, guesses, steps
    side: Annotated[Vec, "m"]  # +1 held at the upper bound, −1 at the lower, 0 free
    best: Annotated[Vec, "m"]  # the best guess
    wrong: Annotated[Vec, "m"]  # 1 where the working set is wrong
    item: Annotated[Index, "k"]  # item of each row of E, −1 of one with a weight
    root: Annotated[Vec, "n_y"]  # D^−½, 0 at pins
    free: Annotated[Vec, "n_y"]  # 0 at pins, else 1
    r: Annotated[Vec, "n_y"]  # what is left of the gradient
    t: Annotated[Vec, "n_y + 1"]  # work
    lam: Annotated[Vec, "k"]  # λ
    rho: Annotated[Vec, "k"]  # what is left of the rows
    a: Annotated[Vec, "k"]  # work
    length: Annotated[Vec, "k"]  # squared lengths of the rows of F
    base: Annotated[Vec, "n_u"]  # work
    B: Annotated[Mat, "n_u, n_u"]  # Cholesky factor of B_u
    X: Annotated[Mat, "n_u, n_y + 1"]  # B_u⁻¹ [B_y | b]
    H: Annotated[Mat, "n_y, n_y"]  # Cholesky factor of D + Sᵀ w S
    E: Annotated[Mat, "k, n_y + 1"]  # soft rows, X, then held ones, in y
    F: Annotated[Mat, "k, n_y"]  # E M^−½
    K: Annotated[Mat, "k, k"]  # Cholesky factor of F Fᵀ + C
    unit: Annotated[Vec, "1"]  # what the cost is divided by


LAYOUT = Layout(
    Work, n_u="sizes[0]", n_y="sizes[1]", n_range="sizes[2]", n_soft="sizes[3]", n_equal="sizes[4]", n="n_u + n_y",
    rows="n_u + n_range + n_soft + n_equal", values="n + 1 + rows", m="n_y + n_range + n_equal",
    k="n_soft + n_u + min(m, n_y + n_equal) + 1",
)  # fmt: skip
#: In a kernel: the arrays at an address.
views = LAYOUT.views


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
