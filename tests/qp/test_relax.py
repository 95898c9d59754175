"""Relaxed QPs: the least slacks, and among these the least cost."""

from __future__ import annotations

import numpy as np
import pytest

from tests.seeds import generator
from wbc.qp import QP, solve
from wbc.qp.relax import relaxed


@pytest.mark.parametrize("share", [1.0, 1e-2, 1e-4])
def test_relaxed_equations_leave_what_least_squares_and_the_share_of_the_cost_leave(share: float) -> None:
    """Without their slacks s = A x − b, the optimum of ½ ‖A x − b‖² + share (½ xᵀHx + gᵀx) is a linear system's."""
    rng = generator("relaxed equations")
    for _ in range(20):
        n = int(rng.integers(1, 7))
        m = int(rng.integers(1, 2 * n + 1))
        root, A, b, g = rng.normal(size=(n, n)), rng.normal(size=(m, n)), rng.normal(size=m), rng.normal(size=n)
        H = root @ root.T + np.eye(n)
        found = solve(relaxed(QP(H, g, A=A, b=b), range(m), share=share))
        assert found.status.ok
        best = np.linalg.solve(A.T @ A + share * H, A.T @ b - share * g)
        assert found.x[:n] == pytest.approx(best, abs=1e-6 * (1.0 + float(np.abs(best).max())))
        assert found.x[n:] == pytest.approx(A @ best - b, abs=1e-6 * (1.0 + float(np.abs(best).max())))
