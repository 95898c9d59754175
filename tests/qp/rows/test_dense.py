"""Steps of a dense QP by the core: one where the cost is curved, a few where it is flat, and none into the endless."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from tests.families import qps
from tests.qp.zoo import random_qp
from tests.seeds import generator
from wbc.qp import QP, Session, Shape, Solver, solve
from wbc.qp.rows.dense import DenseSteps
from wbc.qp.solver import Answer
from wbc.types import Status, Vec


def steps(qp: QP) -> DenseSteps:
    found = DenseSteps(qp.shape)
    found.read(qp)
    return found


@given(seed=st.integers(0, 10_000), n=st.integers(1, 12), n_in=st.integers(0, 15))
def test_where_the_cost_is_curved_one_step_from_anywhere_is_the_optimum(seed: int, n: int, n_in: int):
    qp = random_qp(seed, n, n // 3, n_in)
    made = steps(qp)
    first = made.step(qp, np.zeros(n))
    assert not made.has_flat and first.certificate(qp).within(1e-8)
    far = made.step(qp, 100.0 * np.random.default_rng(seed).standard_normal(n))
    np.testing.assert_allclose(far.x, first.x, atol=1e-8)
    np.testing.assert_allclose(made.step(qp, first.x).x, first.x, atol=1e-12)


@pytest.mark.parametrize("slope", [1.0, 1e-12, 1e12])
def test_a_flat_cost_takes_no_more_steps_than_its_length_needs(slope: float):
    """The first step goes 1e5 units far, the next one 1e6, however steep the slope is."""
    for far, needed in ((1e4, 1), (3e5, 2), (3e6, 3)):
        qp = QP([[0.0]], [slope], lb=[-far])
        made, x = steps(qp), np.zeros(1)
        taken = 0
        while x[0] > -far:
            x = made.step(qp, x).x
            taken += 1
        assert taken == needed
        assert made.step(qp, x).certificate(qp).ok
        assert solve(qp).x[0] == -far


def held_by_rows(rng: np.random.Generator, steep: float, rank: int | None = None) -> tuple[QP, Vec]:
    """A QP and its one optimum, held along what H leaves flat by as many rows, with multipliers of size ``steep``."""
    n = int(rng.integers(2, 7))
    rank = int(rng.integers(1, n)) if rank is None else rank
    axes, C, x = np.linalg.qr(rng.standard_normal((n, n)))[0], rng.standard_normal((2 * n, n)), rng.standard_normal(n)
    J, holds = axes[:rank] * rng.uniform(0.5, 2.0, (rank, 1)), n - rank
    C[:holds] = axes[rank:] + rng.uniform(-0.5, 0.5, (holds, rank)) @ J
    H, cu = J.T @ J, C @ x + np.append(np.zeros(holds), rng.exponential(1.0, n + rank))
    return QP(H, -H @ x - steep * (rng.uniform(0.5, 2.0, holds) @ C[:holds]), C=C, cu=cu, lb=x - 9.0), x


@pytest.mark.parametrize("unit", [10.0**k for k in range(-12, 13, 3)])
@pytest.mark.parametrize("steep", [1e-10, 1e-5, 1.0, 1e2])
def test_the_unit_of_a_cost_with_a_flat_part_moves_no_answer(unit: float, steep: float):
    rng = generator("unit of a flat cost", unit, steep)
    for _ in range(10):
        qp, x = held_by_rows(rng, steep)
        answer = solve(QP(unit * qp.H, unit * qp.g, C=qp.C, cu=qp.cu, lb=qp.lb))
        assert answer.status is Status.SOLVED
        np.testing.assert_allclose(answer.x, x, atol=1e-5)


@pytest.mark.parametrize("unit", [10.0**k for k in range(-12, 13, 3)])
def test_the_unit_of_the_cost_of_a_linear_program_moves_no_answer(unit: float):
    rng = generator("unit of a linear program", unit)
    for _ in range(10):
        qp, x = held_by_rows(rng, 1.0, rank=0)
        known = linprog(qp.g, A_ub=qp.C, b_ub=qp.cu, bounds=list(zip(qp.lb, qp.ub, strict=True)), method="highs")
        answer = solve(QP(qp.H, unit * qp.g, C=qp.C, cu=qp.cu, lb=qp.lb))
        assert answer.status is Status.SOLVED
        np.testing.assert_allclose(answer.x, known.x, atol=1e-6)
        np.testing.assert_allclose(answer.x, x, atol=1e-6)


@pytest.mark.parametrize("unit", [10.0**k for k in range(-12, 13, 3)])
def test_a_bound_far_beyond_the_first_step_is_reached(unit: float):
    for far in (1e9, 1e11, 1e12):
        answer = solve(QP(np.zeros((2, 2)), [unit, -unit], lb=[-far, -1.0], ub=[far, 3.0]))
        assert answer.status is Status.SOLVED
        assert answer.x.tolist() == [-far, 3.0]


@given(seed=st.integers(0, 10_000), n=st.integers(2, 8), rank=st.integers(0, 7))
def test_a_flat_direction_without_slope_is_left_where_it_is(seed: int, n: int, rank: int):
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((min(rank, n - 1), n))
    qp, at = QP(J.T @ J, J.T @ rng.standard_normal(len(J))), rng.standard_normal(n)
    made = steps(qp)
    x = made.step(qp, at).x
    assert made.has_flat
    np.testing.assert_allclose(J @ x, J @ made.step(qp, x).x, atol=1e-9)
    assert np.abs(x).max() <= 1e3 * (1.0 + np.abs(at).max()) * (1.0 + np.linalg.norm(np.linalg.pinv(J)))


@pytest.mark.parametrize(("family", "seed", "index"), [(qps.unbounded, 202648, 9), (qps.scaled_variables, 7, 501)])
def test_nobody_goes_so_far_that_rounding_hides_that_there_is_no_end(family: qps.Draw, seed: int, index: int):
    """Once 1e13 away, where the slope was rounding of H x."""
    assert solve(QP(**qps.problem(family, seed, index))).status is Status.UNBOUNDED


@pytest.mark.parametrize("curvature", [10.0**-k for k in (*range(2, 34, 2), 150, 300)])
@pytest.mark.parametrize("row", [[0.0, 1.0], [1.0, 1.0]])
def test_the_answer_does_not_depend_on_how_flat_a_bounded_direction_is(curvature: float, row: list[float]):
    qp = QP(np.diag([1.0, curvature]), [1.0, 1.0], C=[row], cl=[-1.0], cu=[1.0], lb=[-1.0, -9.0])
    answer = solve(qp)
    known = [-1.0, -1.0] if row[0] == 0.0 else [-curvature / (1.0 + curvature), -1.0 / (1.0 + curvature)]
    assert answer.status is Status.SOLVED
    np.testing.assert_allclose(answer.x, known, atol=1e-6)


@given(seed=st.integers(0, 10_000), power=st.integers(-5, 5))
def test_neither_the_unit_of_a_row_nor_that_of_the_cost_moves_the_answer(seed: int, power: int):
    qp, k = random_qp(seed, 6, 1, 4), 10.0**power
    other = QP(qp.H / k, qp.g / k, A=k * qp.A, b=k * qp.b, C=k * qp.C, cl=k * qp.cl, cu=k * qp.cu, lb=qp.lb, ub=qp.ub)
    one, two = solve(qp), solve(other)
    np.testing.assert_allclose(two.x, one.x, atol=1e-7)
    np.testing.assert_allclose(k * k * two.z, one.z, atol=1e-6 * (1.0 + np.abs(one.z).max(initial=0.0)))
    np.testing.assert_allclose(k * two.z_box, one.z_box, atol=1e-6 * (1.0 + np.abs(one.z_box).max()))


@pytest.mark.parametrize(("off", "finer"), [(1e-3, True), (5e-3, True), (0.1, False), (10.0, False)])
def test_an_answer_is_refined_from_what_it_names_where_it_is_near(off: float, finer: bool):
    qp = random_qp(3, 6, 1, 4)
    best = solve(qp)

    class Coarse(Solver):
        name = "coarse"

        def open(self, shape: Shape) -> Session:
            return CoarseSession(self, shape)

    class CoarseSession(Session):
        def _solve(self, qp: QP) -> Answer:
            return Answer(Status.MAX_ITERATIONS, best.x + off, best.y, best.z, best.z_box, 7)

    answer = Coarse().solve(qp)
    assert answer.iterations == 7
    assert answer.status is (Status.SOLVED if finer else Status.MAX_ITERATIONS)
    np.testing.assert_allclose(answer.x, best.x if finer else best.x + off, atol=1e-9)
