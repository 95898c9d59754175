"""Sparse QPs: the answer is that of the same problem in dense form, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

import wbc
from wbc.qp.sparse import solve_sparse


@pytest.mark.parametrize("seed", range(10))
def test_the_answer_is_the_one_of_the_dense_problem(seed: int):
    rng = np.random.default_rng(seed)
    n, m = 8, 12
    root, A, inside = rng.normal(size=(n, n)), rng.normal(size=(m, n)), rng.normal(size=n)
    H, g = root @ root.T + np.eye(n), 5.0 * rng.normal(size=n)
    low, high = A @ inside - rng.uniform(0.0, 1.0, m), A @ inside + rng.uniform(0.0, 1.0, m)
    low[:2] = high[:2] = (A @ inside)[:2]  # equalities, and rows with one side
    low[2:5], high[5:8] = -np.inf, np.inf
    x = solve_sparse(sparse.csc_array(H), g, sparse.csc_array(A), low, high)
    dense = wbc.solve(wbc.QP(H, g, A=A[:2], b=low[:2], C=A[2:], cl=low[2:], cu=high[2:]))
    assert x is not None and dense.status is wbc.Status.SOLVED
    np.testing.assert_allclose(x, dense.x, atol=1e-5)


def test_rows_that_contradict_each_other_have_no_answer():
    rows = sparse.csc_array(np.array([[1.0], [1.0]]))
    low, high = np.array([1.0, -np.inf]), np.array([np.inf, 0.0])
    assert solve_sparse(sparse.eye_array(1), np.zeros(1), rows, low, high) is None
