"""The space that is left below rows that hold: an orthonormal basis, and the rows that narrow it.

With y = y₀ + √D⁻¹ V₊ z, the columns V₊ of an orthogonal V are what is free and the others, V₀, span the rows that
hold: a row e of the problem is eᵀ √D⁻¹ V₊ in z, and nothing there where it holds. Rows that hold are not kept as
equations, because once a level is least but not zero they depend on one another, as thin as rounding. To narrow the
space, rows are made triangular by Householder reflections, the one with the most left of its length first, and V is
turned by them; rows with next to nothing left depend on those before.
"""

from __future__ import annotations

from enum import IntEnum
from math import copysign, sqrt
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, copy, kernel, part, small_kernel
from wbc.qp.rows.compiled.equality import drop_rounding, evaluate, reduced
from wbc.qp.rows.compiled.linear import add, clear, dot, times
from wbc.qp.rows.compiled.work import Work, place_of, views
from wbc.tolerances import NOISE, ROUNDING, SAME
from wbc.types import Index, Mat, Vec

#: A row depends on those before it where no more than this share of its length is left.
DEPENDENT = 1e-10
#: Held items depend on others where no more than this share of their length is left: with less, what their bounds are
#: off by would decide where the answer is. Rows of a level with a residual that reach no further out of the others
#: matter in the second order only. Rows beside held items have no bounds, and count down to rounding.
HARDLY = 1e-7


class Space(NamedTuple):
    """Views of the memory of the levels: n unknowns y, m items with bounds, k rows of a level at most.

    *Items* are those of the core without its equalities: the unknowns y, then the range rows.
    """

    V: Annotated[Mat, "n, n"]  # columns from ``free`` on are a basis of what is free
    root: Annotated[Vec, "n"]  # √D⁻¹
    y0: Annotated[Vec, "n"]  # where the level begins
    value0: Annotated[Vec, "m"]  # the items there
    low: Annotated[Vec, "m"]  # how far each item may go from there
    high: Annotated[Vec, "m"]
    side: Annotated[Vec, "m"]  # +1 held at its upper bound, −1 at its lower, 0 free
    kept: Annotated[Vec, "m"]  # 1 where an item held a level above back, and stays
    idle: Annotated[Vec, "m"]  # 1 where an item cannot stop a step
    push: Annotated[Vec, "m"]  # what a held item pushes with, down from above
    wrong: Annotated[Vec, "m"]  # how much a held item pulls instead; −1 where a free one is beyond a bound
    B: Annotated[Mat, "m, n"]  # the held items in z, of unit length, made triangular
    bound: Annotated[Vec, "m"]  # where they are held
    reach: Annotated[Vec, "m"]  # their lengths in z
    item: Annotated[Index, "m"]  # which items they are
    holds: Annotated[Vec, "m"]  # pushes beside rounding, in the order of elimination: above 1 they hold the level back
    P: Annotated[Mat, "n, n"]  # reflections, row by row
    beta: Annotated[Vec, "n"]
    pivot: Annotated[Vec, "n"]  # what was left of each row when it was eliminated
    z: Annotated[Vec, "n"]  # the answer
    at: Annotated[Vec, "n"]  # where a descent stands
    t: Annotated[Vec, "n"]  # the answer as reflected
    g: Annotated[Vec, "n + 1"]  # a gradient
    step: Annotated[Vec, "n"]  # work
    centre: Annotated[Vec, "n"]  # the centre of the last level's distance, as reflected
    W: Annotated[Mat, "k, n"]  # rows of the level in z, weighed
    A: Annotated[Mat, "k, n"]  # the same, as reflected
    T: Annotated[Mat, "n, k"]  # the part of A that decides z, transposed
    a: Annotated[Vec, "k"]  # residual of the rows where the level begins, weighed
    weigh: Annotated[Vec, "k"]  # roots of the weights
    missing: Annotated[Vec, "k"]  # residual of the answer, weighed, in the order of elimination
    rho: Annotated[Vec, "l"]  # work
    v: Annotated[Vec, "l"]  # work
    share: Annotated[Vec, "l"]  # of a reflection, in each row
    size: Annotated[Vec, "l"]  # lengths that rows are measured by
    order: Annotated[Index, "l"]  # rows in the order of elimination
    K: Annotated[Mat, "k, k"]
    C: Annotated[Mat, "l, n"]  # rows that narrow the space
    doubt: Annotated[Vec, "n"]  # 1 for a column that is not free, but hardly
    blur: Annotated[Vec, "n"]  # what rounding leaves in the space of a row along a column that is not free, as a share
    E: Annotated[Mat, "m - n, n"]  # range rows in √D y with the base eliminated
    whole: Annotated[Vec, "m"]  # lengths of the items there
    R: Annotated[Mat, "m, n"]  # items in z, of which ``span`` says where they are written
    span: Annotated[Vec, "m"]  # their lengths in z, −1 where none is
    lost: Annotated[Vec, "m"]  # what of these is rounding
    proof: Annotated[Vec, "2"]  # what is beyond bounds, and how far the rows of the level can be off
    held: Annotated[Vec, "m"]  # the side that the core found for each item
    which: Annotated[Index, "k"]  # which of y each row behind those in G is about, −1 − c of u where it is c
    toward: Annotated[Vec, "k"]  # where it pulls
    noise: Annotated[Vec, "1 + k"]  # rounding, as a share of the length of a row in the space; of each row of W
    base: Annotated[Vec, "1"]  # the length of X in √D y
    sizes: Annotated[Index, "16"]  # see below


#: What stands in ``sizes``: n, m, k of this level, its first row in G, 1 for the last level, 1 where it begins within
#: all bounds, columns of V that are not free, held items, columns that are decided, address of the core's memory, k and
#: l of the memory, steps, how many of the k rows stand in G (those behind them damp unknowns, one each, while the level
#: is decided), the address of the memory of a core for problems in z, and how often it was asked.
Size = IntEnum(
    "Size", "N ITEMS ROWS FIRST LAST INSIDE FREE HELD DECIDED CORE MOST LONG STEPS OWN FINDER FINDS", start=0
)


LAYOUT = Layout(Space, n="sizes[0]", m="sizes[1]", k="sizes[10]", l="sizes[11]")
#: In a kernel: the arrays at an address.
space = LAYOUT.views


# ---- reflections


@kernel
def reflector(row: Vec, first: int, last: int, v: Vec) -> float:
    """β and v of I − β v vᵀ, which turns row[first:last] into its length on ``first``; the row becomes that."""
    x, y, n = row[first:], v[first:], last - first
    square = dot(x, x, n)
    if square == 0.0:
        clear(y[:n])
        return 0.0
    alpha = -copysign(sqrt(square), x[0])
    beta = 1.0 / (square - alpha * x[0])
    for c in range(n):
        y[c] = x[c]
        x[c] = 0.0
    y[0] -= alpha
    x[0] = alpha
    return float(beta)


@small_kernel
def reflect(row: Vec, v: Vec, beta: float, first: int, last: int) -> None:
    """row := row (I − β v vᵀ)."""
    x, y, n = row[first:], v[first:], last - first
    add(-beta * dot(x, y, n), y, n, x)


@kernel
def reflect_rows(w: Space, A: Mat, begin: int, end: int, k: int, column: int, last: int) -> None:
    """Reflection k, about columns k to ``last`` as counted from ``column``, of rows ``begin`` to ``end`` of A."""
    n, v, first = last - k, w.P[k][k:], column + k
    times(A, first, v, begin, end, n, w.share)
    for i in range(begin, end):
        add(-w.beta[k] * w.share[i], v, n, A[i][first:])


@kernel
def triangular(at: int, A: Mat, m: int, first: int, last: int, tolerance: float) -> int:
    """Make the columns from ``first`` on of m rows of A lower triangular, rows that depend last; how many do not.

    Reflection i is row i of ``P``. In ``size`` stands what the rest of a row is compared with; ``order`` gets which row
    stands where.
    """
    w = space(at)
    rank, size, order = 0, w.size, w.order
    for i in range(m):
        order[i] = i
    while first + rank < last and rank < m:
        best, most = -1, tolerance
        for i in range(rank, m):
            rest = A[i][first + rank :]
            left = sqrt(dot(rest, rest, last - first - rank)) / size[i] if size[i] > 0.0 else 0.0
            if left > most * (1.0 + SAME):
                best, most = i, left
        if best < 0:
            break
        if best != rank:
            for c in range(last):
                A[best, c], A[rank, c] = A[rank, c], A[best, c]
            size[best], size[rank] = size[rank], size[best]
            order[best], order[rank] = order[rank], order[best]
        k = first + rank
        w.beta[k] = reflector(A[rank], k, last, w.P[k])
        w.pivot[rank] = most
        reflect_rows(w, A, rank + 1, m, k, 0, last)
        rank += 1
    return rank


# ---- rows in the coordinates of the space


@part
def gradient_of_row(at: int, row: int) -> float:
    """The gradient of a row of G in √D y with the base eliminated, in ``g``; its length.

    A row of which the base takes all but rounding is zero: without contacts no torque moves the centre of mass.
    """
    w = space(at)
    s = views(w.sizes[Size.CORE])
    n = w.sizes[Size.N]
    reduced(s, s.G[row], w.g)
    drop_rounding(s, w.g)
    square, size = 0.0, 0.0
    for c in range(n):
        w.g[c] *= w.root[c]
        square += w.g[c] * w.g[c]
    for j in range(s.sizes[0]):
        size += abs(s.G[row, j]) * w.base[0]
    if square <= (ROUNDING * size) ** 2:
        clear(w.g[:n])
        return 0.0
    return sqrt(square)


@small_kernel
def gradient_of_item(w: Space, item: int) -> None:
    """That of an item."""
    n = w.sizes[Size.N]
    for c in range(n):
        w.g[c] = w.E[item - n, c] if item >= n else 0.0
    if item < n:
        w.g[item] = w.root[item]


@part
def gradient_of_own(at: int, i: int) -> float:
    """That of row i of the level, which stands in G or is about one unknown."""
    w = space(at)
    own = w.sizes[Size.OWN]
    if i < own:
        return gradient_of_row(at, w.sizes[Size.FIRST] + i)
    c = w.which[i - own]
    if c >= 0:
        gradient_of_item(w, c)
        return float(w.root[c])
    s, n = views(w.sizes[Size.CORE]), w.sizes[Size.N]
    for j in range(n):
        w.g[j] = -w.root[j] * s.X[-1 - c, j]
    return sqrt(dot(w.g, w.g, n))


@small_kernel
def value_of_own(w: Space, s: Work, i: int) -> float:
    """What row i of the level comes to in ``value``."""
    nu, own = s.sizes[0], w.sizes[Size.OWN]
    if i < own:
        return float(s.value[nu + w.sizes[Size.N] + 1 + w.sizes[Size.FIRST] + i])
    c = w.which[i - own]
    return float(s.value[nu + c] - w.toward[i - own] if c >= 0 else s.value[-1 - c])


@kernel
def in_space(at: int, out: Vec) -> float:
    """out = V₊ᵀ g; its length."""
    w = space(at)
    n, free = w.sizes[Size.N], w.sizes[Size.FREE]
    clear(out[: n - free])
    for i in range(n):
        if w.g[i] != 0.0:
            add(w.g[i], w.V[i, free:], n - free, out)
    return sqrt(dot(out, out, n - free))


@small_kernel
def left_by_rounding(w: Space, whole: float) -> float:
    """What rounding can leave in the space of the row in ``g``, of this length, that rows which hold take whole.

    A column is known the less well the more nearly the row that it was made of depended on those before.
    """
    square = (NOISE * whole) ** 2
    for j in range(w.sizes[Size.FREE]):
        if w.blur[j] > DEPENDENT:
            square += (w.blur[j] * dot(w.V[:, j], w.g, w.sizes[Size.N])) ** 2
    return sqrt(square)


@kernel
def known_in_space(at: int, whole: float, rounding: float, out: Vec) -> float:
    """out = V₊ᵀ g, of a row of length ``whole``; its length. Both are zero where there is no more than rounding."""
    w = space(at)
    length = in_space(at, out)
    if length <= max(DEPENDENT * whole, rounding):
        length = 0.0
        clear(out[: w.sizes[Size.N] - w.sizes[Size.FREE]])
    return length


@part
def item_in_space(at: int, item: int) -> float:
    """Write row ``item`` of R, if it is not there; its length, zero where it is no more than rounding."""
    w = space(at)
    if w.span[item] < 0.0:
        gradient_of_item(w, item)
        w.lost[item] = left_by_rounding(w, w.whole[item])
        w.span[item] = known_in_space(at, w.whole[item], w.lost[item], w.R[item])
    return float(w.span[item])


@kernel
def go(at: int, z: Vec) -> None:
    """y = y₀ + √D⁻¹ V₊ z, u, and every row."""
    w = space(at)
    s = views(w.sizes[Size.CORE])
    n, free = w.sizes[Size.N], w.sizes[Size.FREE]
    for i in range(n):
        s.value[s.sizes[0] + i] = w.y0[i] + w.root[i] * dot(w.V[i, free:], z, n - free)
    evaluate(w.sizes[Size.CORE])


@part
def begin_here(at: int) -> None:
    """The space begins where ``value`` is."""
    w = space(at)
    s = views(w.sizes[Size.CORE])
    for i in range(w.sizes[Size.N]):
        w.y0[i] = s.value[s.sizes[0] + i]
    for item in range(w.sizes[Size.ITEMS]):
        w.value0[item] = s.value[place_of(s, item)]


@part
def narrow(at: int, m: int, tolerance: float) -> int:
    """Keep only what the m rows in ``C`` leave, and turn V; how many of them did not depend on others.

    ``v`` holds the rounding of each row. That of the rows eliminated before adds to it in the rest of a row.
    """
    w = space(at)
    n, free = w.sizes[Size.N], w.sizes[Size.FREE]
    rank = triangular(at, w.C, m, 0, n - free, tolerance)
    for k in range(rank):
        left = w.pivot[k] * w.size[k]
        square = (NOISE * w.size[k]) ** 2 + w.v[w.order[k]] ** 2
        for j in range(k):
            square += (w.blur[free + j] * w.C[k, j]) ** 2
        w.doubt[free + k] = 1.0 if w.pivot[k] <= w.noise[0] else 0.0
        w.blur[free + k] = sqrt(square) / left
    for k in range(rank):
        reflect_rows(w, w.V, 0, n, k, free, n - free)
    w.sizes[Size.FREE] = free + rank
    for item in range(w.sizes[Size.ITEMS]):
        w.span[item] = -1.0
    return rank


@part
def open_space(at: int, first: int) -> float:
    """The point nearest to the centre where the rows of G from ``first`` on hold, and what is free there.

    What the worst of them is missing then. Rounding in the space is as large as the rows that open it are near to
    depending on one another.
    """
    w = space(at)
    s = views(w.sizes[Size.CORE])
    n, rows = w.sizes[Size.N], len(s.G)
    nu = s.sizes[0]
    square = 0.0
    for j in range(nu):
        for c in range(n):
            square += (s.X[j, c] * w.root[c]) ** 2
    w.base[0] = sqrt(square)
    for i in range(n):
        clear(w.V[i])
        w.V[i, i] = 1.0
        w.y0[i] = s.value[nu + i] = s.centre[i]
    clear(w.doubt)
    clear(w.kept)
    for item in range(w.sizes[Size.ITEMS]):
        if item < n:
            w.whole[item] = w.root[item]
        else:
            w.whole[item] = gradient_of_row(at, place_of(s, item) - nu - n - 1)
            copy(w.g, w.E[item - n])
    w.sizes[Size.FREE] = 0
    w.noise[0] = ROUNDING
    m = rows - first
    evaluate(w.sizes[Size.CORE])
    clear(w.v[:m])
    for i in range(m):
        w.size[i] = gradient_of_row(at, first + i)
        w.rho[i] = s.value[nu + n + 1 + first + i]
        copy(w.g, w.C[i])
    rank = narrow(at, m, DEPENDENT)
    for i in range(rank):
        w.noise[0] = max(w.noise[0], ROUNDING / w.pivot[i])
        w.z[i] = (-w.rho[w.order[i]] - dot(w.C[i], w.z, i)) / w.C[i, i]
    for i in range(n):
        w.y0[i] += w.root[i] * dot(w.V[i], w.z, rank)
        s.value[nu + i] = w.y0[i]
    evaluate(w.sizes[Size.CORE])
    begin_here(at)
    worst = 0.0
    for i in range(first, rows):
        worst = max(worst, abs(s.value[nu + n + 1 + i]))
    return worst
