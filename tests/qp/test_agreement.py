"""Solvers that share no method give one answer, and their certificates say so."""

from __future__ import annotations

import numpy as np
import pytest
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
    """Property 71."""
    qp = random_qp(seed, n, min(n_eq, n - 1), n_in, tight=tight)
    answers = {name: by_name(name).solve(qp) for name in CORE}
    for name, answer in answers.items():
        assert answer.status is Status.SOLVED, f"{name}: {answer.status}, {answer.certificate}"
        # The certificate bounds the distance: ½ λ_min ‖x − x*‖² ≤ gap + ...; 1e-9 gives some 1e-4 at worst.
        np.testing.assert_allclose(answer.x, answers["pdas"].x, atol=2e-4, err_msg=name)
        assert abs(qp.cost(answer.x) - qp.cost(answers["pdas"].x)) <= 1e-6 * (1 + abs(qp.cost(answer.x))), name


@pytest.mark.parametrize(("seed", "tight"), [(1, 0.05), (7, 0.05), (522, 0.05), (7, 0.5), (296, 5.0)])
def test_a_corner_at_which_adapted_steps_come_to_a_halt_is_reached_all_the_same(seed: int, tight: float):
    qp = random_qp(seed, 3, 2, 3, tight=tight)
    for name in CORE:
        assert by_name(name).solve(qp).status is Status.SOLVED, name


@given(seed=st.integers(0, 100_000), n=st.integers(2, 6))
def test_exact_solvers_see_that_rows_contradict(seed: int, n: int):
    qp = random_qp(seed, n, 1, 3, tight=5.0)
    C = np.concatenate([qp.C, qp.A])  # the equality again, as a row that asks for more
    bad = QP(qp.H, qp.g, A=qp.A, b=qp.b, C=C, cl=np.append(qp.cl, qp.b + 1.0), cu=np.append(qp.cu, np.inf))
    for name in EXACT:
        assert by_name(name).solve(bad).status is Status.INFEASIBLE, name


@given(st.integers(0, 2**32 - 1), st.sampled_from(["pdas", "daqp"]), st.floats(1e-3, 1e3))
def test_units_names_and_idle_rows_do_not_move_the_minimum(seed: int, name: str, k: float):
    """Property 72."""
    rng = np.random.default_rng(seed)
    qp, solver = random_qp(seed, 6, 2, 4, tight=0.5), by_name(name)
    x = solver.solve(qp).x
    n = qp.n
    order = rng.permutation(n)
    turned = {"A": qp.A[:, order], "b": qp.b, "C": qp.C[:, order], "cl": qp.cl, "cu": qp.cu}
    bounds = {"lb": qp.lb[order], "ub": qp.ub[order]}
    permuted = QP(qp.H[np.ix_(order, order)], qp.g[order], **turned, **bounds)
    np.testing.assert_allclose(solver.solve(permuted).x, x[order], atol=1e-7)
    rows = {"A": k * qp.A, "b": k * qp.b, "C": k * qp.C, "cl": k * qp.cl, "cu": k * qp.cu, "lb": qp.lb, "ub": qp.ub}
    np.testing.assert_allclose(solver.solve(QP(k * qp.H, k * qp.g, **rows)).x, x, atol=1e-6)
    far = rng.normal(size=n)
    idle = QP(
        qp.H, qp.g, A=qp.A, b=qp.b, C=np.vstack([qp.C, far]), cl=np.append(qp.cl, -np.inf),
        cu=np.append(qp.cu, far @ x + 1.0), lb=qp.lb, ub=qp.ub,
    )  # fmt: skip
    np.testing.assert_allclose(solver.solve(idle).x, x, atol=1e-8)
