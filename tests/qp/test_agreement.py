"""Solvers that share no method give one answer, and their certificates say so."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.qp.zoo import random_qp
from wbc.qp import QP
from wbc.qp.solvers import by_name, usable
from wbc.types import Status

EXACT = [name for name in ("pdas", "daqp", "proxqp", "piqp", "clarabel", "quadprog") if name in usable()]
CORE = [*EXACT, "osqp"]


@given(
    seed=st.integers(0, 100_000), n=st.integers(1, 8), n_eq=st.integers(0, 3), n_in=st.integers(0, 12),
    tight=st.sampled_from([0.05, 0.5, 5.0]),
)  # fmt: skip
def test_all_solvers_for_control_agree(seed: int, n: int, n_eq: int, n_in: int, tight: float):
    qp = random_qp(seed, n, min(n_eq, n - 1), n_in, tight=tight)
    answers = {name: by_name(name).solve(qp) for name in CORE}
    for name, answer in answers.items():
        assert answer.status is Status.SOLVED, f"{name}: {answer.status}, {answer.certificate}"
        # The certificate bounds the distance: ½ λ_min ‖x − x*‖² ≤ gap + ...; 1e-9 gives some 1e-4 at worst.
        np.testing.assert_allclose(answer.x, answers["pdas"].x, atol=2e-4, err_msg=name)
        assert abs(qp.cost(answer.x) - qp.cost(answers["pdas"].x)) <= 1e-6 * (1 + abs(qp.cost(answer.x))), name


@given(seed=st.integers(0, 100_000), n=st.integers(2, 6))
def test_exact_solvers_see_that_rows_contradict(seed: int, n: int):
    qp = random_qp(seed, n, 1, 3, tight=5.0)
    C = np.concatenate([qp.C, qp.A])  # the equality again, as a row that asks for more
    bad = QP(qp.H, qp.g, A=qp.A, b=qp.b, C=C, cl=np.append(qp.cl, qp.b + 1.0), cu=np.append(qp.cu, np.inf))
    for name in EXACT:
        assert by_name(name).solve(bad).status is Status.INFEASIBLE, name
