"""A contradiction that was built into a problem is found and proven; a problem with a point has no such proof."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.seeds import generator
from wbc.qp import QP, solve
from wbc.qp.proof import contradiction, descent
from wbc.types import Mat, Status, Vec


def rows_of(rng: np.random.Generator) -> Mat:
    """Rows of integers, some of them repeated, with columns scaled by powers of two down to 2⁻³⁰: sums are exact."""
    n, m = int(rng.integers(1, 9)), int(rng.integers(1, 21))
    M = rng.integers(-3, 4, (m, n)).astype(np.float64)
    M[rng.random(m) < 0.2] = M[0]
    return M * 2.0 ** -rng.integers(0, rng.choice([1, 10, 30]) + 1, n)


def sides(rng: np.random.Generator, M: Mat, x: Vec) -> tuple[Vec, Vec]:
    """Sides that the point x meets, some of them exactly, one of them often missing."""
    value, m = M @ x, len(M)
    lower, upper = value - rng.integers(0, 3, m), value + rng.integers(0, 3, m)
    lower[rng.random(m) < 0.4], upper[rng.random(m) < 0.4] = -np.inf, np.inf
    return lower, upper


def contradictory(rng: np.random.Generator) -> QP:
    """A problem whose last row asks for more than a sum of others allows."""
    M = rows_of(rng)
    m, n = M.shape
    x = rng.integers(-3, 4, n) * 10.0 ** rng.integers(0, 3)
    lower, upper = sides(rng, M, x)
    weights = rng.integers(0, 3, m) * (rng.random(m) < 0.4)
    weights[int(rng.integers(m))] = 1
    upper[weights > 0] = (M @ x)[weights > 0] + rng.integers(0, 2)
    # weights · M y <= weights · upper for every y that meets the rows; one more row asks for more than that.
    more = float(weights @ upper.clip(max=1e30)) + 10.0 ** rng.integers(-2, 3) * (1.0 + np.abs(M @ x).max())
    box = 10.0 ** rng.integers(3, 5) if rng.random() < 0.5 else np.inf
    C, cl = np.vstack([M, weights @ M]), np.append(lower, more)
    return QP(np.eye(n), np.zeros(n), C=C, cl=cl, cu=np.append(upper, np.inf), lb=np.full(n, -box), ub=np.full(n, box))


def test_contradictions_that_were_built_in_are_proven():
    unproven = 0
    for seed in range(1000):
        qp = contradictory(np.random.default_rng(seed))
        push = contradiction(qp, 1e-6)
        if push is None:
            unproven += 1
            continue
        low, high = np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub])
        side = np.where(push > 0.0, high, low)[np.abs(push) > 1e-9]
        assert np.isfinite(side).all() and push[np.abs(push) > 1e-9] @ side < 0.0
    assert unproven <= 2  # of others about one in a thousand, whose sums hold to less than 1e-11 only


@given(st.integers(0, 10_000))
def test_a_problem_with_a_point_has_no_contradiction(seed: int):
    rng = np.random.default_rng(seed)
    M = rows_of(rng)
    x = rng.integers(-3, 4, M.shape[1]) * 10.0 ** rng.integers(0, 3)
    lower, upper = sides(rng, M, x)
    assert contradiction(QP(np.eye(len(x)), np.zeros(len(x)), C=M, cl=lower, cu=upper), 1e-6) is None


def opposed(rng: np.random.Generator) -> tuple[QP, Vec]:
    """Two tasks of one weight that ask for opposite values, a regularisation of 1e-8, and a direction they leave."""
    n = int(rng.integers(2, 11))
    J = rng.standard_normal((int(rng.integers(1, n)), n))
    weight, target = 10.0 ** rng.uniform(0.0, 7.0), 10.0 ** rng.uniform(-1.0, 3.0) * rng.standard_normal(len(J))
    g = (weight * J).T @ target - J.T @ (weight * target)
    return QP(2.0 * weight * J.T @ J + 1e-8 * np.eye(n), g), np.linalg.svd(J)[2][-1]


def test_a_slope_that_rounding_of_the_curvature_may_hide_is_no_endless_descent():
    """The optimum is x = 0; g is nothing but rounding, and the regularisation is lost in the products in H."""
    unproven = 0
    for seed in range(300):
        qp, left = opposed(np.random.default_rng(seed))
        assert descent(qp, 1e-6) is None
        assert solve(qp).status.name in ("SOLVED", "INACCURATE")
        assert solve(qp, "daqp").status is not Status.UNBOUNDED
        size = np.abs(qp.H).max()
        unproven += descent(QP(qp.H - 1e-8 * np.eye(qp.n), 1e-3 * size * left), 1e-6) is None
    assert unproven <= 3  # with a slope of that size along it, the cost falls for ever


def endless(rng: np.random.Generator, spread: int, *, ends: bool) -> QP:
    """A linear program that falls along a direction with entries 1 and -1, in units of 2 to the ±``spread`` at most.

    All rows are orthogonal to the direction, and all bounds are left behind on it; a last row ends it, or does not.
    Nearly all of the slope is pushed back by the rows. All sums of this problem are exact.
    """
    n = int(rng.integers(2, 7))
    d = rng.choice([-1.0, 1.0], n)
    rows = rng.integers(-4, 5, (n, n)).astype(np.float64)
    rows[:, -1] = -d[-1] * (rows[:, :-1] @ d[:-1])
    rows[-1] = d
    g = n * rng.integers(-4, 5, n - 1) @ rows[:-1] - d
    column, row = 2.0 ** rng.integers(-spread, spread + 1, n), 2.0 ** rng.integers(-spread, spread + 1, n)
    point = rng.integers(-3, 4, n)
    low, high = (rows @ point - rng.integers(0, 2, n)) * row, rows @ point * row
    low[-1], high[-1] = -np.inf, high[-1] if ends else np.inf
    lb, ub = np.where(d > 0.0, point, -np.inf) / column, np.where(d < 0.0, point, np.inf) / column
    return QP(np.zeros((n, n)), g * column, C=rows * row[:, None] * column, cl=low, cu=high, lb=lb, ub=ub)


@pytest.mark.parametrize("spread", [0, 4, 8])
def test_a_linear_program_falls_for_ever_where_nothing_ends_its_direction(spread: int):
    rng = generator("endless", spread)
    for _ in range(60):
        assert solve(endless(rng, spread, ends=False)).status is Status.UNBOUNDED
        assert descent(endless(rng, spread, ends=True), 1e-6) is None


@pytest.mark.parametrize("k", [2.0**power for power in range(1, 15)])
def test_a_direction_is_found_that_is_nearly_at_right_angles_to_the_slope(k: float):
    """Along x₁ = 2 k² x₂ the cost −k x₂ falls, and x₁ is the longer one."""
    qp = QP(np.zeros((2, 2)), [0.0, -k], A=[[1.0 / k, -2.0 * k]], b=[0.0], lb=[-1.0, -np.inf])
    found = descent(qp, 1e-6)
    assert found is not None
    np.testing.assert_allclose(found, [1.0, 0.5 / k**2], rtol=1e-9)
    assert solve(qp).status is Status.UNBOUNDED
