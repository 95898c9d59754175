"""The dual form of :mod:`wbc.qp.rows.dual` as one compiled function: the same steps, the same letters.

A wrong guess costs a few microseconds here, so that it may be repaired many times before another solver is asked.
"""

from __future__ import annotations

from wbc.compiled import carray, floats, integers, kernel
from wbc.qp.rows.compiled.linear import factor, solve, solve_rows
from wbc.qp.rows.compiled.proof_kernel import certify
from wbc.types import Index, Mat, Vec

#: How a kernel ends: the first guess was right, or a repaired one; or it is for another solver.
FIRST, REPAIRED, GIVE_UP = 0, 1, 2

# A pivot below this share of its diagonal entry is rounding: the row depends on those above it.
_DEPENDENT = 1e-11
# As in the reference: smaller multipliers, beside the largest, are rounding.
_ROUNDING = 1e-12


@kernel
def _reduce(row: Vec, X: Mat, n_u: int, n_y: int, E: Vec) -> None:
    """E [y; 1] = row [u; y; 1] with u = −X [y; 1]."""
    for c in range(n_y + 1):
        E[c] = row[n_u + c]
    for j in range(n_u):
        share = row[j]
        if share != 0.0:
            other = X[j]
            for c in range(n_y + 1):
                E[c] -= share * other[c]


@kernel
def _dot(a: Vec, b: Vec, n: int) -> float:
    total = 0.0
    for c in range(n):
        total += a[c] * b[c]
    return total


@kernel
def _pull(E: Mat, Es: Mat, K: Mat, lam: Vec, give: Vec, root: Vec, y0: Vec, y: Vec, m: int, m0: int, n_soft: int,
          n_y: int) -> bool:  # fmt: skip
    """(E D⁻¹ Eᵀ + C) λ = −(E y₀ + e), y = y₀ + D⁻¹ Eᵀ λ. False: rows that always hold depend on each other."""
    for i in range(m):
        row, scaled = E[i], Es[i]
        for c in range(n_y):
            scaled[c] = row[c] * root[c]
        lam[i] = -(_dot(row, y0, n_y) + row[n_y])
        for j in range(i + 1):
            K[i, j] = _dot(scaled, Es[j], n_y)
        if i < n_soft:
            K[i, i] += give[i]
    if factor(K, m, _DEPENDENT, m0):
        return False
    solve(K, m, lam)
    for c in range(n_y):
        y[c] = 0.0
    for i in range(m):
        share, scaled = lam[i], Es[i]
        for c in range(n_y):
            y[c] += share * scaled[c]
    for c in range(n_y):
        y[c] = y0[c] + root[c] * y[c]
    return True


@kernel
def _larger(worst: float, value: float) -> float:
    """The larger one; NaN is larger than anything."""
    return worst if value <= worst else value


@kernel
def _reduce_base(G: Mat, B: Mat, X: Mat, n_u: int, n_y: int) -> bool:
    """X = B_u⁻¹ [B_y | b]. False: B_u is not positive definite."""
    for i in range(n_u):
        for j in range(n_u):
            B[i, j] = G[i, j]
        for c in range(n_y + 1):
            X[i, c] = G[i, n_u + c]
    if factor(B, n_u, 0.0, n_u):
        return False
    solve_rows(B, n_u, X, n_y + 1)
    return True


@kernel
def solve_dual(memory: Index, unit: float, regular: float, tolerance: float) -> int:
    """Solve for the working set ``active`` (items) on ``side`` (+1 upper, −1 lower), repair it until it is right.

    ``memory`` is what is read by name below. ``sizes``: n_u, n_y, n_range, n_soft, n_law, n_slots, tries, and k, how
    many are active, which changes. ``proof``: see :func:`certify`. Returns FIRST, REPAIRED or GIVE_UP.
    """
    sizes, proof = carray(integers(memory[17]), 8), carray(floats(memory[20]), 7)
    n_u, n_y, n_range, n_soft, n_law = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4]
    n_slots, tries, k = sizes[5], sizes[6], sizes[7]
    n, m0, first = n_u + n_y, n_soft + n_law, n_u + n_range
    rows, most, items = first + m0, m0 + n_slots, n + 1
    G = carray(floats(memory[0]), (rows, n + 1))
    value = carray(floats(memory[1]), items + rows)
    lower = carray(floats(memory[2]), items + rows)
    upper = carray(floats(memory[3]), items + rows)
    metric = carray(floats(memory[4]), n_y)
    free_root = carray(floats(memory[5]), n_y)
    centre = carray(floats(memory[6]), n_y)
    give = carray(floats(memory[7]), n_soft)
    B = carray(floats(memory[8]), (n_u, n_u))
    X = carray(floats(memory[9]), (n_u, n_y + 1))
    E = carray(floats(memory[10]), (most, n_y + 1))
    Es = carray(floats(memory[11]), (most, n_y))
    K = carray(floats(memory[12]), (most, most))
    lam = carray(floats(memory[13]), most)
    root = carray(floats(memory[14]), n_y)
    y0 = carray(floats(memory[15]), n_y)
    wrong = carray(floats(memory[16]), n + n_slots)
    active, side = carray(integers(memory[18]), n + n_slots), carray(floats(memory[19]), n + n_slots)
    change = carray(floats(memory[21]), most)
    weights = carray(floats(memory[22]), n_soft)
    compliance = carray(floats(memory[23]), n_soft)
    reach = carray(floats(memory[24]), n_soft + n_y)
    scale = carray(floats(memory[25]), n)
    push = carray(floats(memory[26]), rows)
    z = carray(floats(memory[27]), n)
    base = carray(floats(memory[28]), n_u)
    slope = carray(floats(memory[29]), n_y)
    y = value[n_u:n]

    if not _reduce_base(G, B, X, n_u, n_y):
        return GIVE_UP
    for i in range(m0):
        _reduce(G[first + i], X, n_u, n_y, E[i])
    fewest, chances = 1 << 30, 3
    for attempt in range(tries):
        # pins and slots of the working set
        for c in range(n_y):
            root[c], y0[c] = free_root[c], centre[c]
        m = m0
        for q in range(k):
            item = active[q]
            bound = upper[item] if side[q] > 0.0 else lower[item]
            if item < n:
                root[item - n_u], y0[item - n_u] = 0.0, bound
            else:
                _reduce(G[item - items], X, n_u, n_y, E[m])
                E[m, n_y] -= bound
                m += 1
        if not _pull(E, Es, K, lam, give, root, y0, y, m, m0, n_soft, n_y):
            return GIVE_UP
        # what must be zero at the solution of the linear system, whatever the guess; where it is not, once more with it
        primal, largest = 0.0, 0.0
        for refinement in range(2):
            for j in range(n_u):
                value[j] = -(_dot(X[j], y, n_y) + X[j, n_y])
            for i in range(rows):
                value[items + i] = _dot(G[i], value, n + 1)
            primal = 0.0
            for i in range(n_u):
                primal = _larger(primal, abs(value[items + i]))
            for i in range(m0):
                change[i] = value[items + first + i]
                if i < n_soft:
                    change[i] += give[i] * lam[i]
                primal = _larger(primal, abs(change[i]))
            row = m0
            for q in range(k):
                item = active[q]
                if item >= n:
                    change[row] = value[item] - (upper[item] if side[q] > 0.0 else lower[item])
                    if K[row, row] > 0.0:
                        primal = _larger(primal, abs(change[row]))
                    row += 1
            if primal <= tolerance or refinement == 1:
                break
            solve(K, m, change)
            for i in range(m):
                lam[i] -= change[i]
                share, scaled = change[i], Es[i]
                for c in range(n_y):
                    y[c] -= share * scaled[c] * root[c]
        for i in range(m0):
            largest = max(largest, abs(lam[i]))
        # the pull of what is held: positive is the wrong way
        row = m0
        for q in range(k):
            item = active[q]
            if item < n:
                c = item - n_u
                pull = metric[c] * (y[c] - centre[c])
                for i in range(m):
                    pull -= E[i, c] * lam[i]
            else:
                pull = lam[row]
                row += 1
            wrong[q] = 0.0 if lower[item] == upper[item] else pull * side[q]
            largest = max(largest, abs(pull))
        if not primal <= tolerance:
            return GIVE_UP
        # count what is wrong: pulls of the wrong sign, dependent rows, bounds that are broken
        rounding, bad, last = _ROUNDING * largest, 0, -1
        row = m0
        for q in range(k):
            if active[q] >= n:
                if K[row, row] == 0.0:
                    wrong[q] = 2.0 * rounding + 1.0  # it leaves, and comes back if it is broken without it
                row += 1
            if wrong[q] > rounding:
                bad += 1
                last = max(last, active[q])
        for i in range(items + first):
            if n <= i < items + n_u:
                continue
            broken = max(value[i] - upper[i], lower[i] - value[i])
            if not broken <= tolerance:
                bad += 1
                last = max(last, i)
        if bad == 0:
            sizes[7] = k
            for i in range(first):
                push[i] = 0.0
            for refinement in range(2):
                for i in range(m0):
                    push[first + i] = -lam[i]
                row = m0
                for q in range(k):
                    if active[q] >= n:
                        push[active[q] - items] = -lam[row]
                        row += 1
                if certify(G, value, lower, upper, metric, centre, weights, compliance, reach, scale, B, push, z, slope,
                           base, n_u, n_y, n_range, n_soft, n_law, unit, regular, proof):  # fmt: skip
                    return REPAIRED if attempt else FIRST
                if refinement == 1:
                    return GIVE_UP
                # once more with the residuals of rows and gradient, which has the regularisation of u
                for c in range(n_y):
                    slope[c] *= root[c]
                row = m0
                for i in range(m0):
                    change[i] = value[items + first + i] + (give[i] * lam[i] if i < n_soft else 0.0)
                for q in range(k):
                    if active[q] >= n:
                        change[row] = value[active[q]] - (upper[active[q]] if side[q] > 0.0 else lower[active[q]])
                        row += 1
                for i in range(m):
                    change[i] -= _dot(Es[i], slope, n_y)
                solve(K, m, change)
                for c in range(n_y):
                    y[c] -= slope[c] * root[c]
                for i in range(m):
                    lam[i] -= change[i]
                    share, scaled = change[i], Es[i]
                    for c in range(n_y):
                        y[c] -= share * scaled[c] * root[c]
                for j in range(n_u):
                    value[j] = -(_dot(X[j], y, n_y) + X[j, n_y])
                for i in range(rows):
                    value[items + i] = _dot(G[i], value, n + 1)

        # block principal pivoting: all at once while their number falls, then one at a time
        block = True
        if bad < fewest:
            fewest, chances = bad, 3
        elif chances > 0:
            chances -= 1
        else:
            block = False
        kept, slots = 0, 0
        for q in range(k):
            if not (wrong[q] > rounding and (block or active[q] == last)):
                active[kept], side[kept] = active[q], side[q]
                slots += active[q] >= n
                kept += 1
        k = kept
        for i in range(items + first):
            if n <= i < items + n_u or not (block or i == last):
                continue
            over, under = value[i] - upper[i], lower[i] - value[i]
            if max(over, under) > tolerance:
                slots += i >= n
                if slots > n_slots or k == len(active):
                    return GIVE_UP
                active[k], side[k] = i, 1.0 if over > under else -1.0
                k += 1
    return GIVE_UP
