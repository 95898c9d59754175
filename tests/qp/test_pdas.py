"""Guess and verify: how often the first guess is right, what repairs it, and who is asked when it is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.qp.zoo import random_qp, sequence
from tests.seeds import generator
from wbc.qp import QP, Shape, solve
from wbc.qp.solvers.pdas import Pdas
from wbc.types import Status

BOX = QP(np.eye(4), [-3.0, -2.0, 0.0, 3.0], C=[[1, 1, 1, 1]], cl=[-1], cu=[1], lb=[-1] * 4, ub=[1] * 4)


def test_the_second_time_the_first_guess_is_right():
    session = Pdas().open(BOX.shape)
    session.solve(BOX)
    before = session.counts.first
    for _ in range(5):
        assert session.solve(BOX).iterations == 1
    assert session.counts.first == before + 5


def test_without_active_rows_the_first_guess_is_right_at_once():
    qp = QP(np.eye(3), [-1.0, 0.0, 1.0], A=[[1, 1, 1]], b=[0.3], lb=[-9] * 3, ub=[9] * 3)
    session = Pdas().open(qp.shape)
    assert session.solve(qp).status is Status.SOLVED
    assert (session.counts.first, session.counts.repaired, session.counts.fallback) == (1, 0, 0)


def test_a_row_that_becomes_active_is_repaired_and_leaves_again():
    loose, tight = (QP(np.eye(2), [-1.0, -1.0], C=[[1, 1]], cu=[cu]) for cu in (5.0, 1.0))
    session = Pdas().open(loose.shape)
    answers = [session.solve(qp) for qp in (loose, tight, tight, loose, loose)]
    np.testing.assert_allclose([a.z[0] for a in answers], [0, 0.5, 0.5, 0, 0], atol=1e-12)
    assert [a.iterations for a in answers] == [1, 2, 1, 2, 1]
    assert (session.counts.first, session.counts.repaired, session.counts.fallback) == (3, 2, 0)


@pytest.mark.parametrize("by", [1e-7, 1e-3, 1e3])
def test_a_row_is_repaired_however_little_it_is_wrong(by: float):
    session = Pdas().open(Shape(2, 0, 1))
    for cu in (2.0 + by, 2.0 - by, 2.0 + by):  # the minimum without the row is at 2
        assert session.solve(QP(np.eye(2), [-1.0, -1.0], C=[[1, 1]], cu=[cu])).certificate.within(1e-8)
    assert (session.counts.first, session.counts.repaired) == (1, 2)


def test_a_slowly_changing_sequence_is_mostly_guessed_right():
    problems = sequence(300, rate=0.002)
    session = Pdas().open(problems[0].shape)
    for qp in problems:
        assert session.solve(qp).status is Status.SOLVED
    assert session.counts.total == 300
    assert session.counts.first >= 270


def test_an_active_set_that_never_settles_is_left_to_the_finite_method():
    session = Pdas().open(random_qp(0, 12, 2, 20).shape)
    for seed in range(40):
        assert session.solve(random_qp(seed, 12, 2, 20)).status is Status.SOLVED
    assert session.counts.fallback > 30
    for _ in range(3):  # it settles
        session.solve(random_qp(0, 12, 2, 20))
    right = session.counts.first
    session.solve(random_qp(0, 12, 2, 20))
    assert session.counts.first == right + 1


def test_after_a_reset_it_starts_from_no_active_row():
    session = Pdas().open(BOX.shape)
    first = session.solve(BOX).iterations
    session.solve(BOX)
    session.reset()
    assert session.solve(BOX).iterations == first


@given(seed=st.integers(0, 10_000), n=st.integers(1, 10), n_eq=st.integers(0, 3), n_in=st.integers(0, 15))
def test_random_problems_are_solved_to_a_hundred_millionth(seed: int, n: int, n_eq: int, n_in: int):
    qp = random_qp(seed, n, min(n_eq, n - 1), n_in, tight=0.2)
    session = Pdas().open(qp.shape)
    for _ in range(2):
        answer = session.solve(qp)
        assert answer.status is Status.SOLVED and answer.certificate.within(1e-8)


@given(seed=st.integers(0, 10_000), copies=st.integers(2, 4))
def test_equalities_may_be_given_more_than_once(seed: int, copies: int):
    once = random_qp(seed, 6, 2, 4)
    scale = np.random.default_rng(seed).uniform(0.5, 2.0, (copies, 1))
    A = np.concatenate([s * once.A for s in scale])
    b = np.concatenate([s * once.b for s in scale])
    often = QP(once.H, once.g, A=A, b=b, C=once.C, cl=once.cl, cu=once.cu, lb=once.lb, ub=once.ub)
    session = Pdas().open(often.shape)
    for _ in range(2):
        answer = session.solve(often)
        assert answer.status is Status.SOLVED
        np.testing.assert_allclose(answer.x, solve(once).x, atol=1e-7)
        np.testing.assert_allclose(A.T @ answer.y, once.A.T @ solve(once).y, atol=1e-6)


def test_an_active_row_may_be_given_more_than_once():
    qp = QP(np.eye(2), [-1.0, -2.0], C=[[1, 1]] * 4, cu=[1] * 4)
    session = Pdas().open(qp.shape)
    for _ in range(3):
        answer = session.solve(qp)
        assert answer.status is Status.SOLVED
        assert answer.z.min() >= 0.0 and answer.z.sum() == pytest.approx(1.0)


def test_pinned_variables_are_at_their_bounds_to_the_last_bit():
    qp = QP(np.eye(3) + 0.1, [-3.0, 3.0, 0.1], A=[[1, 1, 1]], b=[0.2], lb=[-0.7] * 3, ub=[0.7] * 3)
    session = Pdas().open(qp.shape)
    session.solve(qp)
    answer = session.solve(qp)
    assert answer.iterations == 1
    assert answer.x[0] == 0.7 and answer.x[1] == -0.7


def test_pins_can_make_a_flat_cost_curved():
    qp = QP(np.diag([1.0, 0.0]), [-1.0, -1.0], ub=[9.0, 2.0])
    session = Pdas().open(qp.shape)
    for _ in range(3):
        np.testing.assert_allclose(session.solve(qp).x, [1.0, 2.0])
    assert session.counts.first == 2


def test_an_equality_of_pinned_variables_does_not_cost_the_guess():
    qp = QP(np.eye(2), [-3.0, -3.0], A=[[1, 1], [1, 0]], b=[2, 1], ub=[1, 1])
    session = Pdas().open(qp.shape)
    for _ in range(3):
        answer = session.solve(qp)
        assert answer.certificate.within(1e-8) and np.abs(answer.y).max() < 10.0
    assert session.counts.first >= 1


def test_rows_that_are_small_in_their_units_are_not_lost():
    H, C = np.diag([1e8, 0.0, 0.0]), [[1e-4, 1e-4, 0.0], [0.0, 1e-5, 1e-5]]
    qp = QP(H, [-1e8, 1.0, 0.0], C=C, cl=[-1e-4, 0.0], cu=[1e-4, 1e-5], lb=[-5] * 3, ub=[5] * 3)
    assert solve(qp).certificate.within(1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_guesses_are_refined_where_the_cost_is_nearly_flat(seed: int):
    """A cost of 1e-8 in half of the directions, and equalities through them, as for the base of a robot."""
    rng = np.random.default_rng(seed)
    J, A, point = rng.standard_normal((20, 40)), 100.0 * rng.standard_normal((12, 40)), rng.standard_normal(40)
    C = rng.standard_normal((10, 40))
    qp = QP(
        J.T @ J + 1e-8 * np.eye(40), J.T @ rng.standard_normal(20),
        A=A, b=A @ point, C=C, cl=C @ point - 0.1, cu=C @ point + 0.1,
    )  # fmt: skip
    session = Pdas().open(qp.shape)
    for _ in range(3):
        proof = session.solve(qp).certificate
        assert proof.ok and proof.residual <= 1e-8
    assert session.counts.first >= 1


def test_a_row_with_one_value_may_push_either_way():
    """The multiplier of a fixed row and of a fixed variable changes its sign from one problem to the next."""
    session = Pdas().open(Shape(2, 0, 1))
    for g in (-3.0, 3.0, -3.0):
        qp = QP(np.eye(2), [g, g], C=[[1, 0]], cl=[0.5], cu=[0.5], lb=[-9, 0.25], ub=[9, 0.25])
        np.testing.assert_allclose(session.solve(qp).x, [0.5, 0.25])
    assert session.counts.first == 3


@pytest.mark.parametrize("rows", [[[1, 1], [1, 1], [2, 2]], [[0, 0], [1, 1]], [[1, 1], [0, 0], [0, 0]]])
def test_dependent_equalities_do_not_cost_the_guess(rows: list[list[float]]):
    A = np.array(rows, dtype=float)
    qp = QP(np.eye(2), [-1.0, 0.5], A=A, b=A @ [0.5, 0.5])
    session = Pdas().open(qp.shape)
    answer = session.solve(qp)
    assert answer.certificate.within(1e-8) and session.counts.first == 1
    assert np.abs(answer.y).max() < 10.0


def test_after_a_problem_without_an_answer_it_starts_from_no_active_row():
    bad = QP(BOX.H, BOX.g, C=BOX.C, cl=[5], cu=[6], lb=BOX.lb, ub=BOX.ub)
    session = Pdas().open(BOX.shape)
    first = session.solve(BOX)
    assert session.solve(bad).status is Status.INFEASIBLE
    again = session.solve(BOX)
    assert again.iterations == first.iterations and (again.x == first.x).all()


@given(flat=st.floats(-10.0, -7.0).map(lambda power: 10.0**power), away=st.floats(0.5, 100.0), held=st.floats(1.0, 1e3))
def test_a_row_that_pulls_is_let_go_however_flat_the_cost_is_along_it(flat: float, away: float, held: float):
    """The certificate accepts a multiplier of flat · away: a guess that keeps the row is ``away`` from the minimum."""
    session = Pdas().open(Shape(2, 0, 0))
    for target in (-1.0, away, -1.0, away):
        qp = QP(np.diag([1.0, flat]), [-1.0 - held, -flat * target], lb=[-np.inf, 0.0], ub=[1.0, np.inf])
        np.testing.assert_allclose(session.solve(qp).x, [1.0, max(target, 0.0)], rtol=1e-5, atol=1e-9)


def test_rows_that_are_nearly_parallel_are_met_to_the_tolerance_from_either_side():
    """Oracle: as many rows as unknowns decide x; H, g and multipliers are made for it. A first step leaves rows within
    their bounds as often as beyond them, by 1e-7 where they are 1e5 times longer than what tells them apart."""
    rng = generator("nearly parallel")
    for _ in range(200):
        n = int(rng.integers(2, 5))
        C = np.hstack([10.0 ** rng.uniform(2, 6) * rng.normal(size=(n, 1)), rng.normal(size=(n, n - 1))])
        x, z, room = rng.normal(size=n), rng.normal(size=n), rng.uniform(0.1, 3.0, size=n)
        lower, upper = np.where(z > 0.0, C @ x - room, C @ x), np.where(z < 0.0, C @ x + room, C @ x)
        found = Pdas().at(1e-8).solve(QP(np.eye(n), -x - C.T @ z, C=C, cl=lower, cu=upper))
        assert found.status.ok, found
        np.testing.assert_allclose(C @ found.x, C @ x, rtol=0, atol=1e-8)


@pytest.mark.parametrize("unit", 10.0 ** np.arange(-4, 5))
def test_rounding_of_a_singular_cost_is_no_slope(unit: float):
    """H = RᵀR of small integers is singular, and g is nothing along what it leaves. (3, −1, 0, 1, 1) is an optimum."""
    R = np.array([[1.0, 2.0, 1.0, -2.0, -1.0], [0.0, 0.0, 1.0, -2.0, -1.0]])
    C = [[-10, 10, -10, 0, -20], [-0.1, 0, 0.1, 0.1, 0.1], [1, 2, 1, -2, 0], [2e-3, -1e-3, 1e-3, 0, 1e-3]]
    free = np.inf
    qp = QP(
        unit * R.T @ R, unit * np.array([0.0, 0.0, 3.0, -6.0, -3.0]), C=C, cl=[-free, -free, -9, 6e-3],
        cu=[-60, free, -1, free], lb=[-free, -free, 0, -free, 1], ub=[free, free, free, 1, free],
    )  # fmt: skip
    found = Pdas().solve(qp)
    assert found.status is Status.SOLVED
    np.testing.assert_allclose(R @ found.x, R @ [3.0, -1.0, 0.0, 1.0, 1.0], rtol=0, atol=1e-4)
