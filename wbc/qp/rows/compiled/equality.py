"""The equality problem of a working set W: rows that are held at their bounds, and a Newton step to its optimum.

u = −X [y; 1] turns every row of the problem into E [y; 1]. With the working set held at its bounds b, the optimum has

    [ M  −Eᵀ ] [ dy ]   [ −r ]        r = D (y − c) − Eᵀ λ        what is left of the gradient
    [ E   C  ] [ dλ ] = [ −ρ ]        ρ = E y + e − b + C λ       what is left of the rows

from whatever (y, λ) it stands at: the first solution, its refinement and a step after a change of W are the same
function, :func:`step`. The regularisation ½ ε ‖u‖² of the cost makes X soft rows of weight ε. With S̄ = [S; X] and
w̄ = [w; ε], two factorisations:

    rows       M = D,              E = [S̄; W], C = 1/w̄ on the soft rows     while there are fewer rows than unknowns
    variables  M = D + S̄ᵀ w̄ S̄,     E = W,      C = 0

In both, F = E M^−½ and K = F Fᵀ + C, of which the Cholesky factor is kept. Bounds of unknowns that are guessed to be
held are *pins*: their entry of M^−½ is 0. The finite method holds them as rows.
"""

from __future__ import annotations

from math import sqrt

from wbc.compiled import copy, part, small_kernel
from wbc.qp.rows.compiled.linear import add, add_rows, backward, clear, dot, factor, forward, times
from wbc.qp.rows.compiled.work import VARIABLES, Work, bound_of, place_of, views, weighed
from wbc.tolerances import MET, NOISE, ROUNDING
from wbc.types import Vec

#: A D + SᵀwS with a smaller share of its diagonal left is singular.
_SINGULAR = 1e-15
#: The weight of a soft row that counts for nothing.
_WEIGHTLESS = 1e-30


@part
def reduce_base(at: int) -> bool:
    """X = B_u⁻¹ [B_y | b]; False where B_u is not positive definite."""
    s = views(at)
    nu, ny = s.sizes[0], s.sizes[1]
    for i in range(nu):
        copy(s.G[i], s.B[i])
    if factor(s.B, 0, nu, 0.0):
        return False
    for i in range(nu):
        x, pivot = s.X[i], s.B[i, i]
        copy(s.G[i][nu:], x)
        add_rows(-1.0, s.B[i], s.X, 0, i, ny + 1, x)
        for c in range(ny + 1):
            x[c] *= pivot
    for i in range(nu - 1, -1, -1):
        x, pivot = s.X[i], s.B[i, i]
        add_rows(-1.0, s.B[:, i], s.X, i + 1, nu, ny + 1, x)
        for c in range(ny + 1):
            x[c] *= pivot
    return True


@small_kernel
def reduced(s: Work, row: Vec, out: Vec) -> None:
    """A row of G in y alone."""
    nu = s.sizes[0]
    copy(row[nu:], out)
    add_rows(-1.0, row, s.X, 0, nu, len(out), out)


@small_kernel
def drop_rounding(s: Work, row: Vec) -> None:
    """Take as constant in a row in y what its unknown cannot change by more than the row's rounding.

    An unknown changes the row by its entry times its travel at most: the range of its bounds, beyond which it may be by
    what counts as met, or one unit where that is wider. The row is known to the rounding of its constant. An entry that
    changes it by less says nothing of where the unknown should be, however the entries compare with one another.
    """
    nu, ny = s.sizes[0], s.sizes[1]
    lower, upper, constant = s.lower[nu:], s.upper[nu:], row[ny]
    rounding = NOISE * (1.0 + abs(constant))
    for c in range(ny):
        drops = abs(row[c]) * min(upper[c] - lower[c] + MET, 1.0) <= rounding
        constant += row[c] * min(max(s.centre[c], lower[c]), upper[c]) if drops else 0.0
        row[c] = 0.0 if drops else row[c]
    row[ny] = constant


@small_kernel
def write_row(s: Work, k: int, item: int) -> None:
    """An item as row k of E, with its bound on the right side."""
    nu, ny = s.sizes[0], s.sizes[1]
    if item < ny:
        clear(s.E[k])
        s.E[k, item] = 1.0
    else:
        reduced(s, s.G[place_of(s, item) - nu - ny - 1], s.E[k])
        drop_rounding(s, s.E[k])
    s.E[k, ny] -= bound_of(s, item)
    s.item[k] = item


# ---- M^−½
@part
def factor_metric(at: int) -> bool:
    """M^−½ with the pins of ``free``; False where M is singular."""
    s = views(at)
    ny, ns, w = s.sizes[1], weighed(s), s.weights
    for c in range(ny):
        s.root[c] = s.free[c] / sqrt(s.metric[c])
    if s.sizes[5] != VARIABLES:
        return True
    for k in range(ns):  # w^½ S̄, in memory that F does not use in this form
        root, row, out = sqrt(w[k]), s.E[k], s.F[k]
        for c in range(ny):
            out[c] = root * row[c] * s.free[c]
    for i in range(ny):
        out = s.H[i]
        clear(out[: i + 1])
        add_rows(1.0, s.F[:, i], s.F, 0, ns, i + 1, out)
        out[i] += s.metric[i] if s.free[i] != 0.0 else 1.0
    return bool(factor(s.H, 0, ny, _SINGULAR) == 0)


@small_kernel
def half(s: Work, row: Vec, out: Vec) -> None:
    """out = M^−½ row, nothing at pins."""
    ny = s.sizes[1]
    if s.sizes[5] == VARIABLES:
        for c in range(ny):
            out[c] = row[c] * s.free[c]
        forward(s.H, 0, ny, out)
    else:
        for c in range(ny):
            out[c] = row[c] * s.root[c]


@small_kernel
def back(s: Work, out: Vec) -> None:
    """out := M^−½ᵀ out."""
    ny = s.sizes[1]
    if s.sizes[5] == VARIABLES:
        backward(s.H, 0, ny, out)
    else:
        for c in range(ny):
            out[c] *= s.root[c]


@small_kernel
def first_row(s: Work) -> int:
    """The first row of E that K has: soft rows are in M where that is D + S̄ᵀ w̄ S̄."""
    return weighed(s) if s.sizes[5] == VARIABLES else 0


@small_kernel
def compliance(s: Work, k: int) -> float:
    """C of row k of E."""
    return 1.0 / max(s.weights[k], _WEIGHTLESS) if k < weighed(s) else 0.0


# ---- the working set and its optimum
@part
def factor_rows(at: int, m: int, tolerance: float) -> int:
    """K of the first m rows of E, less those that depend on others to ``tolerance``; how many these are."""
    s = views(at)
    first = first_row(s)
    for i in range(first, m):
        half(s, s.E[i], s.F[i])
        times(s.F, 0, s.F[i], first, i + 1, s.sizes[1], s.K[i])
        s.K[i, i] += compliance(s, i)
        s.length[i] = s.K[i, i]
    return int(factor(s.K, first, m, tolerance))


@part
def place(at: int) -> None:
    """Where the first step starts: the centre, pins at their bounds, nothing pushes."""
    s = views(at)
    nu, ny = s.sizes[0], s.sizes[1]
    for c in range(ny):
        s.value[nu + c] = s.centre[c] if s.free[c] != 0.0 else bound_of(s, c)
    clear(s.lam)


@part
def hold_guess(at: int) -> bool:
    """Factors of the working set in ``side``: bounds are pins, rows that depend on others are left out."""
    s = views(at)
    ny, m = s.sizes[1], weighed(s)
    for c in range(ny):
        s.free[c] = 1.0 if s.side[c] == 0.0 else 0.0
    for item in range(ny, len(s.side)):
        if s.side[item] != 0.0:
            if m == len(s.lam):
                return False
            write_row(s, m, item)
            m += 1
    s.sizes[6] = m
    if not factor_metric(at):
        return False
    factor_rows(at, m, ROUNDING)
    return True


@part
def correct(at: int, is_at_centre: bool) -> None:
    """Solve for what corrects what is left, ``r`` and ``rho``: dλ is written in ``rho``, dy in ``t``.

    ``is_at_centre``: nothing is left of the gradient, and ``r`` is not read.
    """
    s = views(at)
    ny, m, first = s.sizes[1], s.sizes[6], first_row(s)
    if is_at_centre:
        clear(s.t)
    else:
        half(s, s.r, s.t)
        times(s.F, 0, s.t, first, m, ny, s.a)
        add(-1.0, s.a[first:], m - first, s.rho[first:])
    forward(s.K, first, m, s.rho)
    backward(s.K, first, m, s.rho)
    add_rows(1.0, s.rho, s.F, first, m, ny, s.t)
    back(s, s.t)


@part
def move(at: int) -> None:
    """Go where :func:`correct` says."""
    s = views(at)
    first = first_row(s)
    add(1.0, s.rho[first:], s.sizes[6] - first, s.lam[first:])
    add(1.0, s.t, s.sizes[1], s.value[s.sizes[0] :])


@part
def step(at: int, is_first: bool) -> None:
    """One Newton step on (y, λ) from where they are. ``is_first``: nothing pushes yet and y is the centre."""
    s = views(at)
    nu, ny, m, first = s.sizes[0], s.sizes[1], s.sizes[6], first_row(s)
    y = s.value[nu:]
    times(s.E, 0, y, 0, m, ny, s.a)
    for i in range(m):
        s.a[i] += s.E[i, ny]
        s.rho[i] = -(s.a[i] + compliance(s, i) * s.lam[i])
        s.a[i] = -s.weights[i] * s.a[i] if i < first else s.lam[i]
    is_at_centre = is_first and s.sizes[5] != VARIABLES
    if not is_at_centre:
        for c in range(ny):
            s.r[c] = -s.metric[c] * (y[c] - s.centre[c])
        add_rows(1.0, s.a, s.E, 0, m, ny, s.r)
    correct(at, is_at_centre)
    move(at)


@part
def evaluate(at: int) -> None:
    """u from y, and every row."""
    s = views(at)
    nu, ny = s.sizes[0], s.sizes[1]
    y, x1, rows = s.value[nu:], s.value, s.value[nu + ny + 1 :]
    for j in range(nu):
        x1[j] = -(dot(s.X[j], y, ny) + s.X[j, ny])
    times(s.G, 0, x1, 0, len(s.G), nu + ny + 1, rows)
