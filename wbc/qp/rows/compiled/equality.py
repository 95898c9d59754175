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

from wbc.compiled import part, small_kernel
from wbc.qp.rows.compiled.linear import add, add_four, backward, dot, factor, forward, products
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
        for j in range(nu):
            s.B[i, j] = s.G[i, j]
    if factor(s.B, 0, nu, 0.0):
        return False
    for i in range(nu):
        for c in range(ny + 1):
            s.X[i, c] = s.G[i, nu + c]
        for j in range(i):
            add(-s.B[i, j], s.X[j], ny + 1, s.X[i])
        for c in range(ny + 1):
            s.X[i, c] *= s.B[i, i]
    for i in range(nu - 1, -1, -1):
        for j in range(i + 1, nu):
            add(-s.B[j, i], s.X[j], ny + 1, s.X[i])
        for c in range(ny + 1):
            s.X[i, c] *= s.B[i, i]
    return True


@small_kernel
def reduced(s: Work, row: Vec, out: Vec) -> None:
    """A row of G in y alone."""
    nu, ny = s.sizes[0], s.sizes[1]
    for c in range(ny + 1):
        out[c] = row[nu + c]
    j = 0
    while j + 3 < nu:
        add_four(s.X, j, (-row[j], -row[j + 1], -row[j + 2], -row[j + 3]), 0, ny + 1, out)
        j += 4
    while j < nu:
        if row[j] != 0.0:
            add(-row[j], s.X[j], ny + 1, out)
        j += 1


@small_kernel
def drop_rounding(s: Work, row: Vec) -> None:
    """Take as constant in a row in y what its unknown cannot change by more than the row's rounding.

    An unknown changes the row by its entry times its travel at most: the range of its bounds, beyond which it may be by
    what counts as met, or one unit where that is wider. The row is known to the rounding of its constant. An entry that
    changes it by less says nothing of where the unknown should be, however the entries compare with one another.
    """
    nu, ny = s.sizes[0], s.sizes[1]
    rounding = NOISE * (1.0 + abs(row[ny]))
    for c in range(ny):
        low, high = s.lower[nu + c], s.upper[nu + c]
        if row[c] != 0.0 and abs(row[c]) * min(high - low + MET, 1.0) <= rounding:
            row[ny] += row[c] * min(max(s.centre[c], low), high)
            row[c] = 0.0


@small_kernel
def write_row(s: Work, k: int, item: int) -> None:
    """An item as row k of E, with its bound on the right side."""
    nu, ny = s.sizes[0], s.sizes[1]
    if item < ny:
        for c in range(ny + 1):
            s.E[k, c] = 0.0
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
    columns = s.F[:ns].reshape((ny, ns))  # of w^½ S̄, in memory that F does not use in this form
    for k in range(ns):
        root = sqrt(w[k])
        for c in range(ny):
            columns[c, k] = root * s.E[k, c] * s.free[c]
    for i in range(ny):
        products(columns, i, 0, ns, s.H[i])
        s.H[i, i] += s.metric[i] if s.free[i] != 0.0 else 1.0
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
def place(at: int) -> None:
    """Where the first step starts: the centre, pins at their bounds, nothing pushes."""
    s = views(at)
    nu, ny = s.sizes[0], s.sizes[1]
    for c in range(ny):
        s.value[nu + c] = s.centre[c] if s.free[c] != 0.0 else bound_of(s, c)
    for k in range(len(s.lam)):
        s.lam[k] = 0.0


@part
def hold_guess(at: int) -> bool:
    """Factors of the working set in ``side``: bounds are pins, rows that depend on others are left out."""
    s = views(at)
    ny, ns, first = s.sizes[1], weighed(s), first_row(s)
    m = ns
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
    for i in range(first, m):
        half(s, s.E[i], s.F[i])
        products(s.F, i, first, ny, s.K[i])
        if i < ns:
            s.K[i, i] += compliance(s, i)
        s.length[i] = s.K[i, i]
    factor(s.K, first, m, ROUNDING)
    return True


@part
def step(at: int, is_first: bool) -> None:
    """One Newton step on (y, λ) from where they are. ``is_first``: nothing pushes yet and y is the centre."""
    s = views(at)
    nu, ny, ns, m, first = s.sizes[0], s.sizes[1], weighed(s), s.sizes[6], first_row(s)
    y = s.value[nu:]
    for i in range(ns, m) if first else range(m):
        s.rho[i] = -(dot(s.E[i], y, ny) + s.E[i, ny] + compliance(s, i) * s.lam[i])
    if first > 0 or s.sizes[5] == VARIABLES or not is_first:
        for c in range(ny):
            s.r[c] = -s.metric[c] * (y[c] - s.centre[c])
        for i in range(m):
            share = -s.weights[i] * (dot(s.E[i], y, ny) + s.E[i, ny]) if i < first else s.lam[i]
            if share != 0.0:
                add(share, s.E[i], ny, s.r)
        half(s, s.r, s.t)
        for i in range(first, m):
            s.rho[i] -= dot(s.F[i], s.t, ny)
    else:
        for c in range(ny):
            s.t[c] = 0.0
    forward(s.K, first, m, s.rho)
    backward(s.K, first, m, s.rho)
    for i in range(first, m):
        s.lam[i] += s.rho[i]
        add(s.rho[i], s.F[i], ny, s.t)
    back(s, s.t)
    for c in range(ny):
        y[c] += s.t[c]


@part
def evaluate(at: int) -> None:
    """u from y, and every row."""
    s = views(at)
    nu, ny = s.sizes[0], s.sizes[1]
    for j in range(nu):
        s.value[j] = -(dot(s.X[j], s.value[nu:], ny) + s.X[j, ny])
    for i in range(len(s.G)):
        s.value[nu + ny + 1 + i] = dot(s.G[i], s.value, nu + ny + 1)
