"""Least distances as a specification: whatever the units, the answer is optimal for the problem as it was given."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.reliability.faults import Saboteur, Script
from wbc.methods.least_distance import CLOSE, nearest, nearest_at_largest_scale
from wbc.qp import QP, certificate
from wbc.qp.problem import Shape
from wbc.qp.solver import Session, Solution, Solver
from wbc.qp.solvers import usable
from wbc.qp.solvers.daqp_ import Daqp
from wbc.testing.strategies import spd
from wbc.types import Status

SOLVERS = st.sampled_from(usable())


@final
@dataclass(frozen=True)
class Beside(Solver):
    """DAQP; after the first ``good`` answers, x is moved by ``share`` of its length, 1 at least."""

    name: ClassVar[str] = "beside"
    share: float = 0.0
    good: int = 0
    asked: list[int] = field(default_factory=list, compare=False)

    def open(self, shape: Shape) -> Session:
        return Daqp().open(shape)

    def solve(self, qp: QP) -> Solution:
        found = Daqp().solve(qp)
        self.asked.append(1)
        share = self.share if len(self.asked) > self.good else 0.0
        moved = share * max(1.0, float(np.linalg.norm(found.x))) / np.sqrt(max(qp.n, 1))
        return replace(found, x=found.x + moved)


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


@given(distances(), st.floats(0.0, 0.9))
def test_a_solver_near_the_shortest_point_is_given_its_digits(problem: Any, part: float):
    qp, centre, root = problem
    exact, found = (nearest(qp, centre, root, solver) for solver in (None, Beside(part * CLOSE)))
    assert found.status is Status.SOLVED
    np.testing.assert_array_equal(found.x, exact.x)


@given(distances(), st.floats(2.1, 1e3), st.floats(-4.0, 4.0))
def test_a_solver_beside_the_shortest_point_has_failed_and_no_digits_are_given(problem: Any, part: float, unit: float):
    """Without equations, the point is between 1 and √n sizes of the problem away, so that 2 % of that are too much."""
    qp, centre, root = problem
    C, far = np.vstack([qp.C, 1.0 / root.sum(axis=1)]), 10.0**unit
    at = C @ centre
    cl = np.append(np.full(len(qp.C), -np.inf), at[-1] + far)
    found = nearest(QP(qp.H, qp.g, C=C, cl=cl, cu=np.full(len(C), np.inf)), centre, root, Beside(part * CLOSE))
    assert found.status is Status.FAILED
    assert np.isnan(found.x).all() and np.isnan(found.z).all()


def test_a_solver_that_fails_at_any_slope_has_no_largest_scale():
    """x₁ + ε x₂ = 2 s, ε = 1e-4: the first slopes are not steep enough, and what a solver finds there is no answer."""
    qp = QP(np.eye(2), np.zeros(2), A=[[1.0, 1e-4]], b=[2.0], ub=[0.5, 1.0])

    def status(solver: Solver) -> Status:
        return nearest_at_largest_scale(qp, np.array([2.0]), np.zeros(2), np.eye(2), size=2.0, solver=solver)[0].status

    healthy = Beside()
    assert status(healthy) is Status.SOLVED
    assert len(healthy.asked) >= 3
    for good in range(len(healthy.asked)):
        assert status(Beside(10.0, good)) is Status.FAILED
