"""The best split of a gradient: weights any decades apart are certified, and no bound of it is less than the truth.

The oracle solves for the optimum in rational numbers, from the rows and with the working set of the answer.
"""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sympy import QQ
from sympy.polys.matrices import DomainMatrix

from tests.qp.rows.test_proof import move_to
from tests.qp.rows.test_row_solvers import row_problem
from wbc.qp.rows.compiled.equality import evaluate, hold_guess, place, step
from wbc.qp.rows.compiled.search import prepare
from wbc.qp.rows.compiled.verify import split, verify
from wbc.qp.rows.compiled.work import SOLVED
from wbc.qp.rows.core import CoreSolver
from wbc.qp.rows.problem import RowProblem
from wbc.tolerances import MET
from wbc.types import Status, Vec

exact = np.vectorize(Fraction, otypes=[object])


def spread_problem(seed: int, decades: float, tight: float) -> RowProblem:
    """Tasks that conflict, far from what limits allow, of weights some decades apart; next to no regularisation."""
    rng = np.random.default_rng(seed)
    p = row_problem(
        seed, n_u=int(rng.choice([0, 2])), n_y=int(rng.integers(2, 9)), n_range=int(rng.integers(7)), n_equal=1,
        n_soft=int(rng.integers(2, 12)), tight=tight, weights=(10.0**-decades, 10.0**decades),
    )  # fmt: skip
    p.metric[:], p.regularisation = 1e-7, 1e-8
    p.G[p.soft] *= 10.0 ** rng.integers(-1, 2, (p.n_soft, 1))
    p.G[p.soft, p.n] *= 10.0 ** rng.integers(0, 3, p.n_soft)
    return p


def curvature(p: RowProblem) -> Any:
    """H (n, n) of the cost, exactly."""
    S = exact(p.G[p.soft, : p.n])
    own = np.concatenate([exact(np.full(p.n_u, p.regularisation)), Fraction(p.unit) * exact(p.metric)])
    return S.T @ (exact(p.weights)[:, None] * S) + np.diag(own)


def to_the_optimum(p: RowProblem, side: Vec) -> Any:
    """From the answer to the optimum (n,) of the problem whose held bounds are where the answer has them, exactly.

    None: a multiplier has the wrong sign, so that the working set is that of another optimum, which rounding hides.
    """
    G, x1 = exact(p.G[: p.n_rows]), exact(p.x1)
    H, y = curvature(p), range(p.n_u, p.n)
    g = G[p.soft, : p.n].T @ (exact(p.weights) * (G[p.soft] @ x1))
    g[: p.n_u] += Fraction(p.regularisation) * x1[: p.n_u]
    g[y] += Fraction(p.unit) * exact(p.metric) * (x1[y] - exact(p.centre))
    items = np.concatenate([exact(np.eye(p.n)[p.n_u :]), G[p.range, : p.n], G[p.equal, : p.n]])
    held = np.flatnonzero(side)
    C = np.concatenate([G[p.base, : p.n], items[held]])
    zero = exact(np.zeros((len(C), len(C))))
    K = np.concatenate([np.concatenate([H, C.T], 1), np.concatenate([C, zero], 1)])
    right = np.concatenate([-g, exact(np.zeros(len(C)))])[:, None]
    A, b = (DomainMatrix([[QQ(*v.as_integer_ratio()) for v in r] for r in m.tolist()], m.shape, QQ) for m in (K, right))
    found = np.array([Fraction(int(v.numerator), int(v.denominator)) for (v,) in A.lu_solve(b).to_list()])
    pushes = found[p.n + p.n_u :] * exact(side[held])
    is_bound = held < p.n_y + p.n_range  # not an equality
    return found[: p.n] if (pushes[is_bound] >= 0).all() else None


def free(p: RowProblem, items: NDArray[np.bool_]) -> None:
    """Take the bounds off some of the unknowns y and the range rows."""
    for bounds, unbounded in ((p.lower, -np.inf), (p.upper, np.inf)):
        bounds[p.n_u : p.n][items[: p.n_y]] = unbounded
        bounds[p.first_row + p.range.start : p.first_row + p.range.stop][items[p.n_y :]] = unbounded


def judge(p: RowProblem, core: CoreSolver) -> bool:
    """Compare the certificate with the optimum; whether there is one with the working set."""
    dx = to_the_optimum(p, core._side)
    if dx is None:
        return False
    bounds = core.certificate.bounds
    for row in range(p.soft.start, p.soft.stop):
        off = abs(float(exact(p.G[row, : p.n]) @ dx))
        assert off <= bounds[p.rows[row].owner] * (1.0 + 1e-6) + 1e-12 * (1.0 + abs(p.G[row, p.n])), (row, off)
    for j in range(p.n_u, p.n):
        off = abs(float(dx[j])) * p.scale[j]
        assert off <= bounds[p.rows[p.n_rows + j].owner] * (1.0 + 1e-6) + 1e-12 * (1.0 + abs(p.x[j])), (j, off)
    return True


@pytest.mark.parametrize("decades", [1.0, 3.0, 6.0])
def test_weights_any_decades_apart_are_certified_and_the_bounds_are_true(decades: float) -> None:
    ended: Counter[str] = Counter()
    for seed in range(40):
        p = spread_problem(seed, decades, 10.0 ** -(seed % 4))
        core = CoreSolver(p)
        ended[core.solve().value] += 1
        ended["judged"] += judge(p, core)
    # Of weights 1e12 apart and rows a hundred times as long as others, D + SᵀwS may be singular to working precision.
    assert ended[Status.SOLVED.value] >= (40 if decades < 6.0 else 38) and ended["judged"] >= 36, ended


@given(seed=st.integers(0, 10**6), size=st.sampled_from([1e-6, 1e-3, 1.0]))
def test_without_limits_the_split_is_the_distance_from_the_optimum(seed: int, size: float) -> None:
    p, rng = spread_problem(seed, 2.0, 1.0), np.random.default_rng(seed)
    free(p, np.ones(p.n_y + p.n_range, dtype=bool))
    core = CoreSolver(p)
    core.solve()
    move_to(p, p.x[p.n_u :] + size * rng.normal(size=p.n_y))
    core.push *= rng.uniform(0.5, 1.5, len(core.push))  # any pushes lead to the best split
    split(core.address)
    dx = to_the_optimum(p, core._side)
    ratio = core._report[6] / float(dx @ curvature(p) @ dx) ** 0.5
    assert 0.999 <= ratio <= 1.001, ratio


@given(seed=st.integers(0, 10**6))
def test_of_bounds_that_pull_the_bound_is_true(seed: int) -> None:
    """An answer held at bounds of which some should not be: their pushes have the wrong sign, or none."""
    p, rng = spread_problem(seed, 2.0, 1.0), np.random.default_rng(seed)
    items = p.n_y + p.n_range
    held = rng.random(items) < 0.7 * p.n_y / items
    free(p, ~held)
    first, second = CoreSolver(p), CoreSolver(p)
    assume(first.solve() is Status.SOLVED)
    dx = to_the_optimum(p, first._side)
    assume(dx is not None)
    best = exact(p.x) + dx
    prepare(second.address)
    finite = np.isfinite(p.lower[second.places[:items]]), np.isfinite(p.upper[second.places[:items]])
    second._side[:items] = np.where(finite[0] & (~finite[1] | (rng.random(items) < 0.5)), -1.0, 1.0 * finite[1])
    hold_guess(second.address)
    place(second.address)
    for is_first in (True, False, False):
        step(second.address, is_first)
    evaluate(second.address)
    verify(second.address)
    second.push *= rng.uniform(0.0, 2.0, len(second.push))
    split(second.address)
    assume(second._report[0] <= MET)  # else nothing is said of the optimum
    second.concluded(SOLVED)
    for row in range(p.soft.start, p.soft.stop):
        off = abs(float(exact(p.G[row, : p.n]) @ (best - exact(p.x))))
        bound = second.certificate.bounds[p.rows[row].owner]
        assert off <= bound * (1.0 + 1e-6) + 1e-7 * (1.0 + abs(p.G[row, p.n])), (row, off)
