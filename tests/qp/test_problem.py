"""A QP: what it refuses and in which words, its names, its files, its way to other libraries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.qp.zoo import SOLVABLE, random_qp
from wbc.errors import InvalidProblem
from wbc.qp import QP, Row, Shape, solve

I2 = np.eye(2)
ARRAYS = ("H", "g", "A", "b", "C", "cl", "cu", "lb", "ub")
seeds = st.integers(0, 10_000)


@given(seed=seeds, row=st.integers(0, 5), column=st.integers(0, 5), size=st.sampled_from([1e-6, 1e-3, 1.0, 1e6]))
def test_any_asymmetry_of_the_cost_is_found(seed: int, row: int, column: int, size: float):
    qp = random_qp(seed, 6, 1, 2)
    qp.check()
    qp.H[row, column] += size
    if row == column:
        qp.check()
    else:
        with pytest.raises(InvalidProblem, match="not symmetric"):
            qp.check()


def test_rounding_is_no_asymmetry():
    qp = random_qp(0, 30, 0, 0)
    qp.H[3, 4] *= 1 + 1e-14
    qp.H[:] *= 1e6
    qp.check()


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_a_cost_is_convex_up_to_a_billionth_of_its_size(scale: float):
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))
    for least, convex in ((-1e-10, True), (-1e-8, False)):
        H = (turn * [1.0, 0.5, 0.1, least]) @ turn.T
        H *= scale / np.abs(H).max()
        if convex:
            QP(0.5 * (H + H.T), np.zeros(4))
        else:
            with pytest.raises(InvalidProblem, match="not convex"):
                QP(0.5 * (H + H.T), np.zeros(4))


def test_both_sides_of_an_equality_are_one_number():
    qp = QP(I2, [0, 0], A=[[1, 1]], b=[1])
    qp.lower[0] = 0.5
    with pytest.raises(InvalidProblem, match=r"row A\[0\] is an equality"):
        qp.check()


def test_huge_numbers_are_numbers():
    QP([[1e150]], [1e150], ub=[1e200]).check()


def test_an_empty_problem_is_refused_until_everything_is_written():
    qp = QP.empty(Shape(2, 1, 1))
    with pytest.raises(InvalidProblem, match=r"H.*is nan"):
        qp.check()
    qp.H[:], qp.g[:], qp.matrix[:] = I2, 0, 1
    with pytest.raises(InvalidProblem, match=r"row A\[0\] is NaN"):
        qp.check()
    qp.lower[:], qp.upper[:] = [1, 0], [1, 2]
    qp.check()
    np.testing.assert_allclose(solve(qp).x, [0.5, 0.5])


def test_parts_are_views_of_one_block():
    qp = QP(I2, [0, 0], A=[[1, 2]], b=[3], C=[[4, 5], [6, 7]], cl=[-1, -2], cu=[1, 2])
    assert qp.shape == Shape(2, 1, 2) and qp.n == 2
    for part in (qp.A, qp.C):
        assert part.base is qp.matrix
    qp.C[0, 0] = 9
    qp.cu[1] = 8
    assert qp.matrix[1, 0] == 9 and qp.upper[2] == 8
    np.testing.assert_array_equal(qp.b, [3])
    np.testing.assert_array_equal(qp.cl, [-1, -2])


def test_arguments_are_copied():
    H, g = np.eye(2), np.zeros(2)
    qp = QP(H, g)
    H[0, 0] = g[0] = 5
    assert qp.H[0, 0] == 1 and qp.g[0] == 0


def test_names_are_completed():
    qp = QP(I2, [0, 0], A=[[1, 1]], b=[1], C=[[1, 0]], rows=[("sum", "", "m"), ("first", "x", "m")])
    assert [str(row) for row in qp.rows] == ["sum", "first: x", "x[0]", "x[1]"]
    assert qp.rows[1] == Row("first", "x", "m")


def test_the_cost_is_what_its_formula_says():
    assert QP([[2, 1], [1, 2]], [1, -1]).cost(np.array([1.0, 2.0])) == 0.5 * (2 + 2 + 2 + 8) + 1 - 2


@pytest.mark.parametrize("case", SOLVABLE, ids=str)
def test_a_saved_problem_has_the_same_bits(case: Any, tmp_path: Path):
    qp = case.make()
    qp.save(tmp_path / "qp.npz")
    again = QP.load(tmp_path / "qp.npz")
    for name in ARRAYS:
        assert getattr(again, name).tobytes() == getattr(qp, name).tobytes()
    assert again.rows == qp.rows and again.shape == qp.shape


def test_names_are_saved_too(tmp_path: Path):
    rows = [("été", "μ fz − fx", "N"), ("b", "", ""), ("c", "", "rad")]
    QP(I2, [0, 0], C=[[1, 1]], rows=rows).save(tmp_path / "qp.npz")
    assert QP.load(tmp_path / "qp.npz").rows == tuple(Row(*r) for r in rows)


def test_a_file_that_is_not_a_problem_is_refused(tmp_path: Path):
    (tmp_path / "text.npz").write_text("H = 1")
    np.savez(tmp_path / "other.npz", a=np.zeros(2))
    np.savez(tmp_path / "pickle.npz", H=np.array([{}], dtype=object))
    for name in ("text.npz", "other.npz", "pickle.npz", "missing.npz"):
        with pytest.raises(InvalidProblem, match=name):
            QP.load(tmp_path / name)


@given(seed=seeds)
def test_to_qpsolvers_and_back_is_the_same_problem(seed: int):
    qp = random_qp(seed, 4, 1, 5)
    again = QP.from_qpsolvers(qp.to_qpsolvers())
    assert again.shape.n_in == np.isfinite(qp.cl).sum() + np.isfinite(qp.cu).sum()
    np.testing.assert_allclose(solve(again).x, solve(qp).x, atol=1e-7)


@pytest.mark.parametrize("case", SOLVABLE, ids=str)
def test_every_kind_of_problem_goes_to_qpsolvers_and_back(case: Any):
    qp = case.make()
    again = QP.from_qpsolvers(qp.to_qpsolvers())
    np.testing.assert_array_equal(again.H, qp.H)
    np.testing.assert_array_equal(again.A, qp.A)
    np.testing.assert_array_equal(again.lb, qp.lb)
    np.testing.assert_array_equal(again.ub, qp.ub)
    rows = np.isfinite(qp.cl).sum() + np.isfinite(qp.cu).sum()
    assert again.shape == Shape(qp.n, qp.n_eq, rows)


def test_sparse_problems_of_qpsolvers_become_dense():
    import qpsolvers
    from scipy.sparse import csc_matrix

    problem = qpsolvers.Problem(csc_matrix(I2), np.zeros(2), A=csc_matrix([[1.0, 1.0]]), b=np.array([1.0]))
    np.testing.assert_allclose(solve(QP.from_qpsolvers(problem)).x, [0.5, 0.5])


def test_tasks_are_stored_with_the_problem(tmp_path: Path):
    tasks = [("hand", [[1.0, 1.0]], [3.0], "m/s"), ("posture", np.eye(2), [0.0, 1.0], "rad/s")]
    qp = QP([[2.0, 1.0], [1.0, 2.0]], [0.0, 0.0], tasks=tasks)
    qp.save(tmp_path / "qp.npz")
    for other in (QP.load(tmp_path / "qp.npz"), qp.copy()):
        assert [(t.name, t.unit) for t in other.tasks] == [("hand", "m/s"), ("posture", "rad/s")]
        for one, two in zip(qp.tasks, other.tasks, strict=True):
            np.testing.assert_array_equal(one.rows, two.rows)
            np.testing.assert_array_equal(one.target, two.target)
