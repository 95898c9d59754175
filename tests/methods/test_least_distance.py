"""Least distances as a specification: whatever the units, the answer is optimal for the problem as it was given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.reliability.faults import Saboteur, Script
from wbc.methods.least_distance import nearest, nearest_at_largest_scale
from wbc.qp import QP, certificate
from wbc.qp.solvers import usable
from wbc.testing.strategies import spd
from wbc.types import Status

SOLVERS = st.sampled_from(usable())


@st.composite
def distances(draw: Any) -> tuple[QP, np.ndarray, np.ndarray]:
    """A problem with a solution, its centre and root; some rows depend on others, some bounds are equal."""
    n = draw(st.integers(1, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    units = 10.0 ** rng.uniform(-2, 2, n)
    root = units[:, None] * np.linalg.cholesky(draw(spd(n, condition=1e3)))
    centre, point = (root @ rng.normal(size=(n, 2))).T
    A = rng.normal(size=(draw(st.integers(0, n)), n)) / units
    A = np.vstack([A, 3.0 * A[:1], 0.0 * A[:1]])
    C = rng.normal(size=(draw(st.integers(0, 6)), n)) / units
    room = [np.where(rng.uniform(size=k) < 0.3, np.inf, rng.uniform(0, 0.5, k)) for k in (len(C), len(C), n, n)]
    low, high = point - units * room[2], point + units * room[3]
    fixed = rng.uniform(size=n) < 0.1
    low[fixed] = high[fixed] = point[fixed]
    inverse = np.linalg.inv(root)
    H = inverse.T @ inverse
    qp = QP(0.5 * (H + H.T), -H @ centre, A=A, b=A @ point, C=C, cl=C @ point - room[0], cu=C @ point + room[1],
            lb=low, ub=high)  # fmt: skip
    return qp, centre, root


@given(distances(), SOLVERS)
def test_answer_and_multipliers_are_certified_in_the_units_of_the_problem(problem: Any, solver: str):
    qp, centre, root = problem
    found = nearest(qp, centre, root, solver)
    assert found.status is Status.SOLVED
    proof = certificate(qp, found.x, found.y, found.z, found.z_box)
    forces = np.abs(qp.H @ found.x).max() + np.abs(qp.g).max()
    assert proof.primal <= 1e-8 * (1.0 + np.abs(found.x).max())
    assert proof.dual <= 1e-6 * forces
    assert proof.gap <= 1e-7 * (1.0 + forces * np.abs(found.x).max())


@given(distances(), SOLVERS)
def test_rows_that_contradict_are_infeasible_on_every_solver(problem: Any, solver: str):
    qp, centre, root = problem
    row = qp.A[:1] if len(qp.A) and qp.A[0].any() else np.eye(1, qp.n)
    value = float(row[0] @ nearest(qp, centre, root).x)
    far = abs(value) + 1.0
    bad = QP(qp.H, qp.g, A=np.vstack([qp.A, row, row]), b=np.append(qp.b, [value, value + far]), C=qp.C, cl=qp.cl,
             cu=qp.cu, lb=qp.lb, ub=qp.ub)  # fmt: skip
    assert nearest(bad, centre, root, solver).status is Status.INFEASIBLE


@pytest.mark.parametrize("solver", usable())
@pytest.mark.parametrize("gap", [1.0, 1e-3, 1e-6])
def test_limits_that_leave_no_point_are_infeasible_and_those_that_leave_one_are_not(solver: str, gap: float):
    """x₁ + x₂ + x₃ = 3 (1 + gap), x ≤ 1: a plane is between them; without the gap, x = (1, 1, 1) alone is inside."""

    def found(gap: float) -> Any:
        qp = QP(np.eye(3), np.zeros(3), A=np.ones((1, 3)), b=[3.0 * (1.0 + gap)], ub=[1.0, 1.0, 1.0])
        return nearest(qp, np.zeros(3), np.diag([1.0, 10.0, 0.1]), solver)

    assert found(gap).status is Status.INFEASIBLE and np.isnan(found(gap).x).all()
    assert found(0.0).status is Status.SOLVED
    np.testing.assert_allclose(found(0.0).x, 1.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("solver", usable())
@pytest.mark.parametrize("lever", [1.0, 1e-2, 1e-4, 3e-6])
def test_the_scale_is_the_largest_however_dear_its_last_part_is(solver: str, lever: float):
    """x₁ + ε x₂ = 2 s with x₁ ≤ ½, x₂ ≤ 1: s = (½ + ε) / 2, and the last part of it costs 1/ε."""
    lever = min(lever, 0.9)
    qp = QP(np.eye(2), np.zeros(2), A=[[1.0, lever]], b=[2.0], ub=[0.5, 1.0])
    found, scale = nearest_at_largest_scale(qp, np.array([2.0]), np.zeros(2), np.eye(2), size=2.0, solver=solver)
    assert scale == pytest.approx((0.5 + lever) / 2, abs=1e-12)
    np.testing.assert_allclose(found.x, [0.5, 1.0], atol=1e-9)


def test_at_the_largest_scale_the_distance_is_the_least():
    """Three unknowns, one of them free beside the task: it stays at its centre."""
    qp = QP(np.eye(3), np.zeros(3), A=[[1.0, 1.0, 0.0]], b=[4.0], ub=[1.0, 1.0, np.inf])
    found, scale = nearest_at_largest_scale(qp, np.array([4.0]), np.array([0.0, 0.0, 7.0]), np.eye(3), size=3.0)
    assert scale == pytest.approx(0.5)
    np.testing.assert_allclose(found.x, [1.0, 1.0, 7.0], atol=1e-9)


def test_a_solver_that_calls_everything_infeasible_has_failed_where_there_is_a_point():
    qp = QP(np.eye(2), np.zeros(2), A=np.ones((1, 2)), b=[1.0], ub=[0.3, 1.0])
    assert nearest(qp, np.zeros(2), np.eye(2), Saboteur(Script("infeasible"))).status is Status.FAILED
