"""What every solver keeps to, whoever wrote it."""

from __future__ import annotations

import pickle
import subprocess
import sys

import numpy as np
import pytest

from tests.qp.zoo import INFEASIBLE, SOLVABLE, UNBOUNDED, Case, random_qp, sequence
from wbc.errors import InvalidInput
from wbc.qp import QP, Solution, Solver
from wbc.qp.solvers import by_name, usable
from wbc.qp.solvers.kept import KeptSession
from wbc.types import Status

#: They end at a vertex of the active set, exact to rounding; the others come as near as their tolerance lets them.
ACTIVE_SET = {"pdas", "daqp", "quadprog"}


@pytest.fixture(params=usable())
def solver(request: pytest.FixtureRequest) -> Solver:
    return by_name(request.param)


def bits(qp: QP) -> bytes:
    return b"".join(a.tobytes() for a in (qp.H, qp.g, qp.matrix, qp.lower, qp.upper, qp.lb, qp.ub))


def everything(answer: Solution) -> np.ndarray:
    return np.concatenate([answer.x, answer.y, answer.z, answer.z_box])


@pytest.mark.parametrize("case", SOLVABLE, ids=str)
def test_known_answers_and_the_signs_of_multipliers(solver: Solver, case: Case):
    answer = solver.solve(case.make())
    if not (case.strictly_convex or solver.semidefinite):
        assert answer.status is Status.FAILED
        return
    assert answer.status is Status.SOLVED
    assert answer.certificate.within(solver.tolerance)
    precision = 1e-7 if solver.name in ACTIVE_SET else 1e-4
    for got, known in ((answer.x, case.x), (answer.y, case.y), (answer.z, case.z), (answer.z_box, case.z_box)):
        if known is not None:
            np.testing.assert_allclose(got, known, rtol=0, atol=precision * max(1.0, *np.abs(known), 0.0))


@pytest.mark.parametrize("case", INFEASIBLE, ids=str)
def test_what_cannot_be_met_is_infeasible(solver: Solver, case: Case):
    """Property 73."""
    answer = solver.solve(case.make())
    assert answer.status is Status.INFEASIBLE
    assert np.isnan(everything(answer)).all()


@pytest.mark.parametrize("case", UNBOUNDED, ids=str)
def test_what_has_no_minimum_is_unbounded(solver: Solver, case: Case):
    answer = solver.solve(case.make())
    assert answer.status is Status.UNBOUNDED
    assert np.isnan(everything(answer)).all()


@pytest.mark.parametrize("seed", range(20))
def test_without_a_cost_any_point_is_an_optimum_on_which_nothing_pushes(solver: Solver, seed: int):
    if not solver.semidefinite:
        pytest.skip(f"{solver.name} needs a cost")
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    A, C, inside = rng.normal(size=(rng.integers(0, n + 1), n)), rng.normal(size=(3, n)), rng.normal(size=n)
    qp = QP(np.zeros((n, n)), np.zeros(n), A=A, b=A @ inside, C=C, cu=C @ inside + rng.random(3), lb=inside - 1.0)
    answer = solver.solve(qp)
    assert answer.status is Status.SOLVED and answer.certificate.within(solver.tolerance)
    np.testing.assert_allclose(np.concatenate([answer.y, answer.z, answer.z_box]), 0.0)


def test_solvers_print_nothing():
    script = """
from tests.qp.zoo import random_qp
from wbc.qp import solve
from wbc.qp.solvers import usable
for name in usable():
    solve(random_qp(0, 4, 1, 3), name)
"""
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    assert done.stdout == done.stderr == ""


def test_warm_answers_are_cold_answers(solver: Solver):
    session, solved = solver.open(sequence(1)[0].shape), 0
    for qp in sequence(25):
        warm, cold = session.solve(qp), solver.solve(qp)
        assert warm.status is cold.status
        if warm.status.ok:
            solved += 1
            np.testing.assert_allclose(warm.x, cold.x, atol=1e-5)
    # A back end that is not for control may fail now and then, as long as it is seen to.
    assert solved >= (20 if solver.offline else 25)


def test_a_workspace_is_kept_while_problems_are_alike(solver: Solver):
    first, *others = sequence(10)
    session = solver.open(first.shape)
    if isinstance(session, KeptSession):
        session.solve(first)
        kept = session._workspace
        assert kept is not None
        for qp in others:
            session.solve(qp)
            assert session._workspace is kept


def test_two_fresh_sessions_give_the_same_bits(solver: Solver):
    runs = []
    for _ in range(2):
        session = solver.open(sequence(1)[0].shape)
        runs.append(np.concatenate([everything(session.solve(qp)) for qp in sequence(12)]))
    if solver.repeatable:
        assert runs[0].tobytes() == runs[1].tobytes()
    else:
        np.testing.assert_allclose(runs[0], runs[1], atol=1e-6)


def test_a_session_survives_what_has_no_answer(solver: Solver):
    good = sequence(2)
    bad = QP(
        good[0].H, good[0].g, A=good[0].A, b=good[0].b, C=good[0].C, cl=np.full(8, 50.0), lb=good[0].lb, ub=good[0].ub
    )
    session = solver.open(good[0].shape)
    assert [session.solve(qp).status for qp in (good[0], bad, good[1])] == [
        Status.SOLVED, Status.INFEASIBLE, Status.SOLVED,
    ]  # fmt: skip


def test_a_session_that_forgot_answers_like_a_new_one(solver: Solver):
    """To the bit, if the solver repeats its own: also which entries were ever other than zero is forgotten."""
    full = sequence(3)
    sparse = full[0].copy()
    sparse.H[:], sparse.matrix[:, ::2] = np.diag(sparse.H.diagonal()), 0.0
    session = solver.open(sparse.shape)
    for qp in full:
        session.solve(qp)
    session.reset()
    again, new = session.solve(sparse), solver.solve(sparse)
    np.testing.assert_allclose(again.x, new.x, atol=1e-5)
    if solver.repeatable:
        np.testing.assert_array_equal(everything(again), everything(new))


def test_sides_may_come_and_go_in_one_session(solver: Solver):
    free = QP(np.eye(2), [-3.0, -3.0], C=[[1.0, 1.0]])
    above = QP(np.eye(2), [-3.0, -3.0], C=[[1.0, 1.0]], cu=[2.0], ub=[0.5, np.inf])
    equal = QP(np.eye(2), [-3.0, -3.0], C=[[1.0, 1.0]], cl=[2.0], cu=[2.0], lb=[0.25, -np.inf], ub=[0.25, np.inf])
    session = solver.open(free.shape)
    for qp, x in ((free, (3, 3)), (above, (0.5, 1.5)), (equal, (0.25, 1.75)), (above, (0.5, 1.5)), (free, (3, 3))):
        answer = session.solve(qp)
        assert answer.status is Status.SOLVED
        np.testing.assert_allclose(answer.x, x, atol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_bounds_at_zero_may_come_and_go_in_one_session(solver: Solver, seed: int):
    """An answer at a bound of 0 that is then taken away is stationary still, with a multiplier of nothing."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    J, g = rng.standard_normal((n, n)), rng.standard_normal(n)
    H = J.T @ J + 0.1 * np.eye(n)
    session = solver.open(QP(H, g).shape)
    for _ in range(8):
        answer = session.solve(QP(H, g, lb=rng.choice([0.0, -1.0, -np.inf], n)))
        assert answer.status is Status.SOLVED, answer.reason


def test_zeros_may_become_numbers_in_one_session(solver: Solver):
    diagonal = QP(np.eye(2), [-1.0, -2.0], C=[[1.0, 0.0]], cu=[0.5])
    full = QP([[2.0, 1.0], [1.0, 2.0]], [-3.0, -3.0], C=[[1.0, 1.0]], cu=[1.0])
    session = solver.open(diagonal.shape)
    for qp, x in ((diagonal, (0.5, 2)), (full, (0.5, 0.5)), (diagonal, (0.5, 2))):
        np.testing.assert_allclose(session.solve(qp).x, x, atol=1e-5)


def test_the_problem_is_not_touched(solver: Solver):
    for qp in (random_qp(3, 6, 2, 5), SOLVABLE[-2].make()):
        before = bits(qp)
        session = solver.open(qp.shape)
        session.solve(qp)
        session.solve(qp)
        assert bits(qp) == before


def test_an_answer_is_its_own(solver: Solver):
    problems = sequence(2)
    session = solver.open(problems[0].shape)
    first = session.solve(problems[0])
    kept = everything(first).copy()
    session.solve(problems[1])
    np.testing.assert_array_equal(everything(first), kept)


def test_settings_are_printed_compared_and_hashed(solver: Solver):
    assert solver == by_name(solver.name) and hash(solver) == hash(by_name(solver.name))
    assert type(solver).__name__ in repr(solver)
    assert pickle.loads(pickle.dumps(solver)) == solver


def test_times_and_names_are_told(solver: Solver):
    answer = solver.solve(random_qp(1, 4, 1, 3))
    assert answer.solver == solver.name
    assert 0.0 <= answer.build_time < 10.0 and 0.0 < answer.solve_time < 10.0


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_a_solver_asked_for_an_accuracy_is_judged_by_that(solver: Solver, tolerance: float):
    asked = solver.at(tolerance)
    assert asked.tolerance == tolerance and asked.name == solver.name and type(asked) is type(solver)
    assert solver.tolerance == 1e-6, "the solver itself stays as it is"
    for seed in range(5):
        answer = asked.solve(random_qp(seed, 12, 3, 8))
        assert (answer.status is Status.SOLVED) == answer.certificate.within(tolerance)
        if solver.name != "highs":  # its tolerances have hardly any effect
            assert answer.certificate.within(100.0 * tolerance), answer.certificate


def test_a_solver_asked_for_an_accuracy_survives_pickling(solver: Solver):
    again = pickle.loads(pickle.dumps(solver.at(1e-4)))
    assert again.tolerance == 1e-4 and again == solver.at(1e-4)


def test_an_accuracy_is_positive(solver: Solver):
    with pytest.raises(InvalidInput, match="tolerance"):
        solver.at(0.0)
