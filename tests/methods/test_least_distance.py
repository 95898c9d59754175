"""Least distances as a specification: whatever the units, the answer is optimal for the problem as it was given."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.reliability.faults import Saboteur, Script
from wbc.errors import SolverFailed
from wbc.methods.least_distance import Nearest, nearest
from wbc.qp import QP, certificate
from wbc.qp.problem import Shape
from wbc.qp.solver import Answer, Session, Solver
from wbc.qp.solvers import usable
from wbc.qp.solvers.daqp_ import Daqp
from wbc.testing.strategies import spd

SOLVERS = st.sampled_from(usable())


@final
class BesideSession(Session):
    """DAQP; x is moved by ``share`` of its length, 1 at least."""

    def _solve(self, qp: QP) -> Answer:
        found = Daqp().open(self.shape)._solve(qp)
        moved = self.solver.share * max(1.0, float(np.linalg.norm(found.x)))  # type: ignore[attr-defined]
        return replace(found, x=found.x + moved / np.sqrt(qp.n))


@final
@dataclass(frozen=True)
class Beside(Solver):
    """A solver with such sessions."""

    name: ClassVar[str] = "beside"
    share: float = 0.0

    def open(self, shape: Shape) -> Session:
        return BesideSession(self, shape)


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


def _answer(qp: QP, centre: np.ndarray, root: np.ndarray, solver: Solver | str | None = "pdas", **more: Any) -> Nearest:
    found = nearest(qp, centre, root, solver, **more)
    assert found is not None
    return found


@given(distances(), SOLVERS)
def test_answer_and_multipliers_are_certified_in_the_units_of_the_problem(problem: Any, solver: str):
    qp, centre, root = problem
    found = nearest(qp, centre, root, solver)
    assert found is not None
    proof = certificate(qp, found.x, found.y, found.z, found.z_box)
    forces = np.abs(qp.H @ found.x).max() + np.abs(qp.g).max()
    assert proof.primal <= 1e-8 * (1.0 + np.abs(found.x).max())
    assert proof.dual <= 1e-6 * forces
    assert proof.gap <= 1e-7 * (1.0 + forces * np.abs(found.x).max())


@given(distances(), SOLVERS)
def test_rows_that_contradict_are_infeasible_on_every_solver(problem: Any, solver: str):
    qp, centre, root = problem
    row = qp.A[:1] if len(qp.A) and qp.A[0].any() else np.eye(1, qp.n)
    value = float(row[0] @ _answer(qp, centre, root).x)
    far = abs(value) + 1.0
    bad = QP(qp.H, qp.g, A=np.vstack([qp.A, row, row]), b=np.append(qp.b, [value, value + far]), C=qp.C, cl=qp.cl,
             cu=qp.cu, lb=qp.lb, ub=qp.ub)  # fmt: skip
    assert nearest(bad, centre, root, solver) is None


@pytest.mark.parametrize("solver", usable())
@pytest.mark.parametrize("gap", [1.0, 1e-3, 1e-6])
def test_limits_that_leave_no_point_are_infeasible_and_those_that_leave_one_are_not(solver: str, gap: float):
    """x₁ + x₂ + x₃ = 3 (1 + gap), x ≤ 1: a plane is between them; without the gap, x = (1, 1, 1) alone is inside."""

    def found(gap: float) -> Any:
        qp = QP(np.eye(3), np.zeros(3), A=np.ones((1, 3)), b=[3.0 * (1.0 + gap)], ub=[1.0, 1.0, 1.0])
        return nearest(qp, np.zeros(3), np.diag([1.0, 10.0, 0.1]), solver)

    assert found(gap) is None
    np.testing.assert_allclose(found(0.0).x, 1.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("solver", usable())
def test_a_bound_that_equations_put_a_variable_on_leaves_the_others_their_inside(solver: str):
    """x₁ = 1 with x₁ ≤ 1 allows no x₁ < 1, which methods of the interior begin with; x₂ is free up to 0.5."""
    qp = QP(np.eye(2), [0.0, -2.0], A=[[1.0, 0.0]], b=[1.0], ub=[1.0, 0.5])
    np.testing.assert_allclose(_answer(qp, np.array([0.0, 2.0]), np.eye(2), solver).x, [1.0, 0.5], rtol=0, atol=1e-8)


def scaled(rows: Any, ub: list[float]) -> QP:
    """rows x = s rows · 1 b: the last unknown is s in [0, 1]."""
    n = len(ub)
    return QP(np.eye(n + 1), np.zeros(n + 1), A=rows, b=[0.0], lb=[*[-np.inf] * n, 0.0], ub=[*ub, 1.0])


@pytest.mark.parametrize("solver", [None, *usable()])
@pytest.mark.parametrize("lever", [1.0, 1e-2, 1e-4, 3e-6])
def test_the_scale_is_the_largest_however_dear_its_last_part_is(solver: str | None, lever: float):
    """x₁ + ε x₂ = 2 s with x₁ ≤ ½, x₂ ≤ 1: s = (½ + ε) / 2, and the last part of it costs 1/ε."""
    lever = min(lever, 0.9)
    qp, root = scaled([[1.0, lever, -2.0]], [0.5, 1.0]), np.diag([1.0, 1.0, 0.5])
    found = _answer(qp, np.zeros(3), root, solver, along=np.array([0.0, 0.0, 1.0]))
    reached = 1e-12 if solver is None else 1e-6
    assert found.x[2] == pytest.approx((0.5 + lever) / 2, abs=reached)
    np.testing.assert_allclose(found.x[:2], [0.5, 1.0], atol=1e3 * reached)


def test_at_the_largest_scale_the_distance_is_the_least():
    """Three unknowns, one of them free beside the task: it stays at its centre."""
    qp = scaled([[1.0, 1.0, 0.0, -4.0]], [1.0, 1.0, np.inf])
    centre, along = np.array([0.0, 0.0, 7.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(_answer(qp, centre, np.eye(4), along=along).x, [1.0, 1.0, 7.0, 0.5], atol=1e-9)


def test_a_solver_that_calls_everything_infeasible_has_failed_where_there_is_a_point():
    qp = QP(np.eye(2), np.zeros(2), A=np.ones((1, 2)), b=[1.0], ub=[0.3, 1.0])
    with pytest.raises(SolverFailed):
        nearest(qp, np.zeros(2), np.eye(2), Saboteur(Script("infeasible")))


@given(distances(), st.floats(0.0, 1e-3))
def test_the_certified_answer_of_a_solver_is_the_point_of_the_finite_method(problem: Any, part: float):
    qp, centre, root = problem
    exact, found = (_answer(qp, centre, root, solver) for solver in (None, Beside(part)))
    away = np.linalg.solve(root, found.x - exact.x)
    size = np.linalg.norm(np.linalg.solve(root, np.column_stack([exact.x - centre, exact.x])))
    assert np.linalg.norm(away) <= 1e-7 * (1.0 + size)


@given(distances(), st.floats(1.0, 1e3), st.floats(-4.0, 4.0))
def test_a_solver_beside_the_shortest_point_has_failed_and_no_digits_are_given(problem: Any, part: float, unit: float):
    qp, centre, root = problem
    C, far = np.vstack([qp.C, 1.0 / root.sum(axis=1)]), 10.0**unit
    at = C @ centre
    cl = np.append(np.full(len(qp.C), -np.inf), at[-1] + far)
    with pytest.raises(SolverFailed):
        nearest(QP(qp.H, qp.g, C=C, cl=cl, cu=np.full(len(C), np.inf)), centre, root, Beside(part))
