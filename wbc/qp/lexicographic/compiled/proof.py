"""The certificate of a level: how far its rows can be from the least that the levels above leave.

In coordinates ỹ = √D y, with W the rows of the level times the roots of their weights, m the residual that the answer
was found with and r the one that it has, the level is the least of ½ ‖W ỹ + …‖² among all points that meet the
constraints and keep every row above. The items that are held push with λ; one that pushes on a bound from which the
answer is g away can be worth λ g. What is left of the gradient in the space V that the rows above leave, made of the
rows anew, splits into

    Vᵀ (Wᵀ m + Rᵀ λ) = (W V)ᵀ ρ + s ,      ‖W (ỹ − ỹ*)‖ ≤ ‖ρ‖ + ‖r − m‖ + √( Σ |λ| g + ‖s‖ ‖V Vᵀ (ỹ − ỹ*)‖ )

for any optimum ỹ*. A level has no curvature along s; there the distance to the nearest optimum is taken to be no larger
than the distance of the answer from the centre. With the same, ‖W (ỹ − ỹ*)‖ ≤ ‖W V‖ ‖V Vᵀ (ỹ − ỹ*)‖: rows that the
space hardly moves are near their optimum. The last level has the curvature D: s is measured as it is. Columns that the
rows above hardly take from the space count as free.
"""

from __future__ import annotations

from math import inf, sqrt

from wbc.compiled import copy, part, small_kernel
from wbc.qp.lexicographic.compiled.space import (
    DEPENDENT,
    Size,
    Space,
    gradient_of_item,
    gradient_of_own,
    in_space,
    item_in_space,
    reflect,
    space,
    triangular,
    value_of_own,
)  # fmt: skip
from wbc.qp.rows.compiled.linear import add, clear, dot
from wbc.qp.rows.compiled.work import Work, place_of, views
from wbc.tolerances import NEAR

#: What each product of the gradient loses, of rows and of pushes alike, as a share of their sum.
_ROUNDING = 8.0 * 2.0**-52


@small_kernel
def pulls(w: Space, s: Work, item: int) -> bool:
    """Whether an item pulls at the bound that it is held at: it is better let go."""
    place = place_of(s, item)
    return bool(w.push[item] * w.side[item] < 0.0 and s.lower[place] != s.upper[place])


@part
def fit_pushes(at: int) -> None:
    """The pushes that balance the gradient in ``step`` best, less those of the wrong sign, until none is.

    Rounding gives items that nearly depend on others pushes of any sign. Without them the others balance it as well.
    """
    w = space(at)
    s = views(w.sizes[Size.CORE])
    n, m = w.sizes[Size.N], w.sizes[Size.ITEMS]
    d = n - w.sizes[Size.FREE]
    for _ in range(m):
        count, is_right = 0, True
        for item in range(m):
            if w.side[item] != 0.0 and pulls(w, s, item):
                w.idle[item], is_right = 1.0, False
            w.push[item] = 0.0
            if w.side[item] != 0.0 and w.idle[item] == 0.0 and item_in_space(at, item) > 0.0:
                w.rho[count] = w.span[item]
                for c in range(d):
                    w.C[count, c] = w.R[item, c] / w.rho[count]
                w.size[count], w.v[count] = 1.0, item
                count += 1
        copy(w.step, w.g[:n])
        in_space(at, w.z)
        rank = triangular(at, w.C, count, 0, d, DEPENDENT)
        for c in range(rank):
            reflect(w.z, w.P[c], w.beta[c], c, d)
        for i in range(rank - 1, -1, -1):
            for j in range(i + 1, rank):
                w.z[i] += w.C[j, i] * w.t[j]
            w.t[i] = -w.z[i] / w.C[i, i]
            w.push[int(w.v[w.order[i]])] = w.t[i] / w.rho[w.order[i]]
        if is_right:
            return


@part
def certify(at: int) -> None:
    """Of the level solved last: what is beyond its bounds, and how far its rows can be off, ‖W (ỹ − ỹ*)‖."""
    w = space(at)
    s = views(w.sizes[Size.CORE])
    n, k, free, rank = w.sizes[Size.N], w.sizes[Size.ROWS], w.sizes[Size.FREE], w.sizes[Size.HELD]
    nu = s.sizes[0]
    d, decided = n - free, w.sizes[Size.DECIDED] - rank
    # the gradient, and what the pushes leave of it
    off, square, size, doubtful, pushes, gap = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        w.at[c] = (s.value[nu + c] - s.centre[c]) / w.root[c]
        w.step[c] = w.at[c] if w.sizes[Size.LAST] else 0.0
    for i in range(k):
        row = w.order[i]
        gradient_of_own(at, row)
        add(w.weigh[row] * w.missing[i], w.g, n, w.step)
        off += (w.weigh[row] * value_of_own(w, s, row) - w.missing[i]) ** 2
        square += w.missing[i] ** 2
        length = dot(w.W[row], w.W[row], d)
        if length == 0.0:  # the search takes for zero what is hardly more than rounding
            length = (w.weigh[row] * in_space(at, w.z)) ** 2
        size += length
        for j in range(free):
            if w.doubt[j] != 0.0:
                doubtful += (w.weigh[row] * dot(w.V[:, j], w.g, n)) ** 2
    fits = True
    for i in range(rank):
        fits = fits and not pulls(w, s, w.item[i])
    if not fits:
        clear(w.idle)
        fit_pushes(at)
        rank = decided = 0
    for item in range(w.sizes[Size.ITEMS]):
        force = w.push[item] if w.side[item] != 0.0 else 0.0
        place = place_of(s, item)
        near = s.upper[place] - s.value[place] if force > 0.0 else s.value[place] - s.lower[place]
        if force != 0.0 and near < inf:
            gradient_of_item(w, item)
            add(force, w.g, n, w.step)
            pushes += abs(force) * sqrt(dot(w.g, w.g, n))
            if near > NEAR:
                gap += abs(force) * near
    copy(w.at, w.g[:n])
    far = in_space(at, w.z) ** 2
    copy(w.step, w.g[:n])
    in_space(at, w.z)
    slope = 0.0
    for j in range(free):
        if w.doubt[j] != 0.0:
            slope += dot(w.V[:, j], w.g, n) ** 2
            far += dot(w.V[:, j], w.at, n) ** 2
    reach = 1.0 + sqrt(far)
    # what rows of the level take of it
    for c in range(rank + decided):
        reflect(w.z, w.P[c], w.beta[c], c, d)
    for c in range(d):
        if c < rank or c >= rank + decided:
            slope += w.z[c] ** 2
    rho = 0.0
    for step in range(decided):
        i = decided - 1 - step if decided == k else step
        left = w.z[rank + i]
        if decided == k:
            for j in range(i + 1, k):
                left -= w.A[j, rank + i] * w.z[rank + j]
            share = left / w.A[i, rank + i]
        else:
            left -= dot(w.T[i], w.z[rank:], i)
            share = left / w.T[i, i]
        if share * share > abs(left) * reach:  # hardly any curvature: less is said by none
            slope, share = slope + left**2, 0.0
        w.z[rank + i] = share
        rho += share**2
    # what must hold
    primal = 0.0
    for c in range(nu):
        primal = max(primal, s.value[c] - s.upper[c], s.lower[c] - s.value[c])
    for item in range(w.sizes[Size.ITEMS]):
        place = place_of(s, item)
        primal = max(primal, s.value[place] - s.upper[place], s.lower[place] - s.value[place])
    slope = max(sqrt(slope) - _ROUNDING * n * (sqrt(size * square) + pushes), 0.0)
    w.proof[0] = primal
    if w.sizes[Size.LAST]:
        w.proof[1] = sqrt((sqrt(off) + sqrt(rho)) ** 2 + slope**2) + sqrt(gap)
    else:
        w.proof[1] = sqrt(off) + min(sqrt(rho) + sqrt(gap + slope * reach), sqrt(size + doubtful) * reach)
