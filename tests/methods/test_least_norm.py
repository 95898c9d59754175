"""The shortest point of a polyhedron: what solvers leave is taken away, and no solver is given another's answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.methods.least_norm import ACCURATE, OTHER_WORDS, Words, asked, least_norm, residual
from wbc.methods.polish import polished
from wbc.qp import QP
from wbc.qp.problem import Shape
from wbc.qp.solver import Answer, Session, Solver
from wbc.qp.solvers import by_name, usable
from wbc.types import Status

INF = np.inf


def shortest(rows: list[list[float]], low: list[float], high: list[float]) -> QP:
    """minimise ½ |x|² subject to low ≤ rows x ≤ high, rows made unit length."""
    C = np.array(rows)
    length = np.linalg.norm(C, axis=1)
    return QP(np.eye(C.shape[1]), np.zeros(C.shape[1]), C=C / length[:, None], cl=low / length, cu=high / length)


def wedge(slope: float) -> QP:
    """Two sides, slope x2 ± x1 ≥ 1, that meet at an acute angle: the answer is far out, (0, 1 / slope)."""
    return shortest([[1.0, slope], [-1.0, slope]], [1.0, 1.0], [INF, INF])


def corner() -> QP:
    """Eight rows through one point in the plane: which of them explain it is a choice."""
    angles = np.linspace(-1.2, 1.2, 8)
    rows = np.column_stack([np.cos(angles), np.sin(angles)])
    return QP(np.eye(2), np.zeros(2), C=rows, cl=rows @ [1.0, 0.1], cu=np.full(8, INF))


def point() -> QP:
    """One point, an empty set by rounding: x1 ≥ 1 and x1 ≤ 1 − 1e-12, x2 ≥ x1, x2 ≤ x1."""
    rows = [[1.0, 0.0], [1.0, 0.0], [1.0, -1.0], [-1.0, 1.0]]
    return shortest(rows, [1.0, -INF, 0.0, 0.0], [INF, 1.0 - 1e-12, INF, INF])


@pytest.mark.parametrize("solver", usable())
@pytest.mark.parametrize(
    ("qp", "x"),
    [(wedge(0.1), [0.0, 10.0]), (wedge(0.01), [0.0, 100.0]), (corner(), [1.0, 0.1]), (point(), [1.0, 1.0])],
    ids=["wedge", "acute wedge", "corner", "point"],
)
def test_every_solver_gets_to_the_last_digit(qp: QP, x: list[float], solver: str):
    found = least_norm(qp, by_name(solver), feasible=True)
    assert found.status is Status.SOLVED and residual(found) <= ACCURATE
    np.testing.assert_allclose(found.x, x, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("solver", usable())
def test_what_has_no_point_is_infeasible(solver: str):
    apart = shortest([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], [1.0, -INF, 1.0], [INF, 1.0, INF])
    assert least_norm(apart, by_name(solver)).status is Status.INFEASIBLE


@final
@dataclass(frozen=True)
class Guess(Solver):
    """Says the same whatever it is asked."""

    name = "guess"
    says: tuple[float, ...]
    status: Status

    def open(self, shape: Shape) -> Session:
        return Guessing(self, shape)


class Guessing(Session):
    def _solve(self, qp: QP) -> Answer:
        assert isinstance(self.solver, Guess)
        return Answer(self.solver.status, np.array(self.solver.says), np.zeros(0), np.zeros(qp.shape.n_in), np.zeros(2))


@pytest.mark.parametrize("status", [Status.SOLVED, Status.MAX_ITERATIONS])
def test_a_solver_that_is_far_off_is_not_given_the_answer(status: Status):
    """The rows that push would be found from anywhere; that would be an answer of another solver."""
    found = least_norm(wedge(0.1), Guess((0.3, 2.0), status))
    assert found.status is not Status.SOLVED and residual(found) > ACCURATE


@pytest.mark.parametrize("words", OTHER_WORDS)
def test_other_words_ask_the_same(words: Words):
    """From anywhere, and the multipliers come back in the words of the first question too."""
    for start in (np.full(3, np.nan), np.zeros(3), np.array([0.5, -0.2, 1.0])):
        qp = shortest([[1.0, 1.0, 0.0], [1.0, -2.0, 0.5], [0.0, 1.0, 1.0]], [2.0, -INF, 0.0], [INF, 0.25, 9.0])
        here, there = by_name("daqp").solve(qp), asked(qp, by_name("daqp"), start, words)
        np.testing.assert_allclose(there.x, here.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(there.z, here.z, rtol=0, atol=1e-9)
        assert there.certificate.within(ACCURATE)


@given(st.integers(2, 8), st.integers(0, 2**32 - 1))
def test_where_many_rows_meet_those_that_explain_the_point_are_found(n: int, seed: int):
    """Forty rows through one point, and multipliers that are spread over all of them."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(40, n))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    z = -rng.uniform(size=40)
    x = -rows.T @ z / np.linalg.norm(rows.T @ z)
    exact = polished(QP(np.eye(n), np.zeros(n), C=rows, cl=rows @ x), x + 1e-8 * rng.normal(size=n), z)
    assert exact is not None
    np.testing.assert_allclose(exact[0], x, rtol=0, atol=1e-12)


def test_a_polished_answer_is_exact_or_none():
    qp = corner()
    exact = polished(qp, np.array([1.0, 0.1]) + 1e-6, np.zeros(8))
    assert exact is not None
    x, _, z = exact
    np.testing.assert_allclose(x, [1.0, 0.1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(x + z @ qp.C, 0.0, atol=1e-14)
    assert (z <= 0.0).all()
    assert polished(qp, np.full(2, np.nan), np.zeros(8)) is None
    contradiction = shortest([[1.0, 0.0], [1.0, 0.0]], [1.0, -INF], [INF, 0.0])
    assert polished(contradiction, np.array([0.5, 0.0]), np.array([-1.0, 1.0])) is None
