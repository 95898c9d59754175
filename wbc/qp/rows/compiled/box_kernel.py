"""Bounds and nothing else, compiled: guess which bounds hold, factor the cost of the others, verify, repair.

    minimise ½ (x − c)ᵀD(x − c) + ½ Σ (wᵢ) (Sᵢ x + sᵢ)²   subject to lb <= x <= ub

A held unknown is masked: its column is zero and its diagonal one, so that nothing changes size.
"""

from __future__ import annotations

from wbc.compiled import carray, floats, integers, kernel
from wbc.qp.rows.compiled.dual_kernel import FIRST, GIVE_UP, REPAIRED
from wbc.qp.rows.compiled.linear import factor, solve
from wbc.qp.rows.compiled.proof_kernel import certify
from wbc.types import Index, Mat, Vec


@kernel
def _cost(S: Mat, weights: Vec, metric: Vec, centre: Vec, held: Vec, x0: Vec, W: Mat, H: Mat, g: Vec, m: int,
          n: int) -> None:  # fmt: skip
    """H and g of the unknowns that are free, about x₀: lower triangle of Wᵀ W + D, and −Wᵀ(S x₀ + s) √w."""
    for i in range(n):
        row = H[i]
        for c in range(i + 1):
            row[c] = 0.0
        g[i] = 0.0
    for r in range(m):
        row, weighted, weight = S[r], W[r], weights[r]
        residual = row[n]
        for c in range(n):
            residual += row[c] * x0[c]
            weighted[c] = 0.0 if held[c] != 0.0 else row[c]
        for i in range(n):
            share = weight * weighted[i]
            if share != 0.0:
                target = H[i]
                for c in range(i + 1):
                    target[c] += share * weighted[c]
                g[i] -= share * residual
    for i in range(n):
        H[i, i] += metric[i]
        if held[i] == 0.0:
            g[i] -= metric[i] * (x0[i] - centre[i])


@kernel
def _gradient(S: Mat, weights: Vec, metric: Vec, centre: Vec, x: Vec, values: Vec, gradient: Vec, m: int,
              n: int) -> None:  # fmt: skip
    """D (x − c) + Σ wᵢ Sᵢᵀ (Sᵢ x + sᵢ) from the data; the rows' ``values`` on the way."""
    for c in range(n):
        gradient[c] = metric[c] * (x[c] - centre[c])
    for r in range(m):
        row = S[r]
        residual = row[n]
        for c in range(n):
            residual += row[c] * x[c]
        values[r] = residual
        push = weights[r] * residual
        for c in range(n):
            gradient[c] += push * row[c]


@kernel
def solve_box(memory: Index, unit: float, tolerance: float) -> int:
    """Solve for the bounds that are ``held`` (+1 upper, −1 lower, 0 free), repair that until it is right.

    ``sizes``: n, n_soft, tries. ``proof``: see :func:`certify`. Returns FIRST, REPAIRED, GIVE_UP.
    """
    sizes, proof = carray(integers(memory[13]), 3), carray(floats(memory[14]), 7)
    n, m, tries = sizes[0], sizes[1], sizes[2]
    S = carray(floats(memory[0]), (m, n + 1))
    value = carray(floats(memory[1]), n + 1 + m)
    lower = carray(floats(memory[2]), n)
    upper = carray(floats(memory[3]), n)
    metric = carray(floats(memory[4]), n)
    centre = carray(floats(memory[5]), n)
    weights = carray(floats(memory[6]), m)
    held = carray(floats(memory[7]), n)
    W = carray(floats(memory[8]), (m, n))
    H = carray(floats(memory[9]), (n, n))
    step = carray(floats(memory[10]), n)
    x0 = carray(floats(memory[11]), n)
    gradient = carray(floats(memory[12]), n)
    compliance = carray(floats(memory[15]), m)
    reach = carray(floats(memory[16]), m + n)
    scale = carray(floats(memory[17]), n)
    push = carray(floats(memory[18]), m)
    z = carray(floats(memory[19]), n)
    x, g0 = value[:n], z[:0]

    fewest, chances, block = 1 << 30, 3, True
    for attempt in range(tries):
        for c in range(n):
            x0[c] = upper[c] if held[c] > 0.0 else (lower[c] if held[c] < 0.0 else centre[c])
        _cost(S, weights, metric, centre, held, x0, W, H, step, m, n)
        if factor(H, n, 0.0, n):
            return GIVE_UP
        solve(H, n, step)
        for c in range(n):
            x[c] = x0[c] + step[c] if held[c] == 0.0 else x0[c]
        # One step of refinement: the residual of the rows is exact where their products lose half the digits.
        _gradient(S, weights, metric, centre, x, value[n + 1 :], gradient, m, n)
        for c in range(n):
            step[c] = -gradient[c] if held[c] == 0.0 else 0.0
        solve(H, n, step)
        for c in range(n):
            x[c] += step[c]
        _gradient(S, weights, metric, centre, x, value[n + 1 :], gradient, m, n)
        size = 0.0
        for c in range(n):
            x0[c] = -metric[c] * centre[c]
        for r in range(m):
            still, row = weights[r] * S[r, n], S[r]
            for c in range(n):
                x0[c] += still * row[c]
        for c in range(n):
            size = max(size, abs(x0[c]))
        size += 1.0

        bad, last, sound = 0, -1, True
        for c in range(n):
            if held[c] == 0.0:
                broken = max(x[c] - upper[c], lower[c] - x[c])
                wrong = not broken <= tolerance
                sound = sound and abs(gradient[c]) <= tolerance * size
            else:
                pull = gradient[c] * held[c]
                wrong = pull > tolerance * size and lower[c] != upper[c]
            if wrong:
                bad += 1
                last = c
        if not sound:
            return GIVE_UP
        if bad == 0:
            for r in range(m):
                push[r] = weights[r] * value[n + 1 + r]
            if not certify(S, value, lower, upper, metric, centre, weights, compliance, reach, scale, H, push, z, step,
                           g0, 0, n, 0, m, 0, unit, 0.0, proof):  # fmt: skip
                return GIVE_UP
            return REPAIRED if attempt else FIRST
        if bad < fewest:
            fewest, chances = bad, 3
        elif chances > 0:
            chances -= 1
        else:
            block = False
        for c in range(n):
            if not (block or c == last):
                continue
            if held[c] == 0.0:
                if x[c] - upper[c] > tolerance:
                    held[c] = 1.0
                elif lower[c] - x[c] > tolerance:
                    held[c] = -1.0
            elif gradient[c] * held[c] > tolerance * size and lower[c] != upper[c]:
                held[c] = 0.0
    return GIVE_UP
