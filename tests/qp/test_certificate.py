"""The certificate accepts optima and nothing else."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.qp.zoo import SOLVABLE, random_qp
from wbc.qp import QP, Certificate, certificate, solve
from wbc.qp.certificate import rounded_once
from wbc.types import Vec

inf = np.inf
Point = tuple[Vec, Vec, Vec, Vec]


def problem() -> QP:
    """Every kind of row, all of them pushing: an equality, both sides of rows, both sides of bounds."""
    return QP(
        np.diag([1.0, 2.0, 3.0, 4.0, 1.0]), [-1.0, -2.0, 3.0, 0.0, 0.0],
        A=[[0, 0, 0, 1, 1]], b=[1.0],
        C=[[1, 0, 0, 0, 0], [0, 1, 0, 0, 0]], cl=[2.0, -4.0], cu=[5.0, 0.5],
        lb=[-inf, -inf, -0.5, -inf, -inf], ub=[inf, inf, inf, 0.1, inf],
    )  # fmt: skip


def optimum() -> Point:
    """H x + g + Aᵀy + Cᵀz + z_box = 0 by hand."""
    x = np.array([2.0, 0.5, -0.5, 0.1, 0.9])
    return x, np.array([-0.9]), np.array([-1.0, 1.0]), np.array([0.0, 0.0, -1.5, 0.5, 0.0])


def changed(part: int, index: int, value: float) -> Point:
    point = optimum()
    point[part][index] = value
    return point


def test_an_optimum_is_certified():
    proof = certificate(problem(), *optimum())
    assert proof.ok and proof.within(1e-14)
    assert str(proof).startswith("certified: primal 0.0e+00")


@pytest.mark.parametrize(
    ("part", "index", "value"),
    [(p, i, -v) for p in (1, 2, 3) for i, v in enumerate(optimum()[p]) if v]
    + [(p, i, 0.0) for p in (1, 2, 3) for i, v in enumerate(optimum()[p]) if v]
    + [(3, i, s) for i in (0, 1, 4) for s in (-1e-3, 1e-3)]
    + [(0, i, v + s) for i, v in enumerate(optimum()[0]) for s in (-1e-3, 1e-3)],
)
def test_no_change_of_an_optimum_is_certified(part: int, index: int, value: float):
    proof = certificate(problem(), *changed(part, index, value))
    assert not proof.ok
    assert str(proof).startswith("not certified")


@pytest.mark.parametrize(("value", "violation"), [(1.9, 0.1), (5.25, 0.25), (2.5, 0.0)])
def test_primal_is_the_worst_violation_in_the_unit_of_its_row(value: float, violation: float):
    proof = certificate(problem(), *changed(0, 0, value))
    assert proof.primal == pytest.approx(violation, abs=1e-15)


def test_the_worst_violation_may_be_a_variable_s():
    qp = QP(np.eye(2), [0, 0], C=[[1, 0]], cu=[9], ub=[1, 1], rows=[("row", "", ""), ("x", "", "m"), ("y", "", "m")])
    proof = certificate(qp, np.array([0.0, 3.0]), np.zeros(0), np.zeros(1), np.zeros(2))
    assert proof.primal == 2.0


def test_dual_is_the_largest_entry_of_the_gradient():
    x, y, z, z_box = optimum()
    assert certificate(problem(), x, y, z, z_box + np.eye(5)[2] / 4).dual == 0.25


@pytest.mark.parametrize(("sign", "side"), [(1.0, "ub"), (-1.0, "lb")])
def test_a_multiplier_without_a_side_to_push_on_is_a_dual_residual(sign: float, side: str):
    opposite = {"ub": "lb", "lb": "ub"}[side]
    qp = QP([[1.0]], [-sign], **{opposite: [0.0]})
    proof = certificate(qp, np.zeros(1), np.zeros(0), np.zeros(0), np.array([sign]))
    assert proof.dual == 1.0 and proof.gap == 0.0
    assert not proof.ok


def test_a_multiplier_without_a_side_hides_no_gap():
    qp = QP(np.eye(2), [-1.0, -1.0], ub=[np.inf, 3.0])
    proof = certificate(qp, np.zeros(2), np.zeros(0), np.zeros(0), np.ones(2))
    assert (proof.dual, proof.gap) == (1.0, 3.0)


def test_the_wrong_side_of_a_two_sided_row_is_a_gap():
    qp = QP([[1.0]], [-1.0], C=[[1.0]], cl=[-3.0], cu=[2.0])
    proof = certificate(qp, np.array([2.0]), np.zeros(0), np.array([-1.0]), np.zeros(1))
    assert (proof.primal, proof.dual, proof.gap) == (0.0, 0.0, 5.0)


def test_pushing_on_a_row_that_is_not_reached_is_a_gap():
    qp = QP([[1.0]], [-1.0], ub=[2.0])
    proof = certificate(qp, np.array([0.5]), np.zeros(0), np.zeros(0), np.array([0.5]))
    assert (proof.primal, proof.dual, proof.gap) == (0.0, 0.0, 0.75)


def test_multipliers_of_equalities_have_any_sign():
    for b in (-1.0, 1.0):
        qp = QP([[1.0]], [0.0], A=[[1.0]], b=[b])
        assert certificate(qp, np.array([b]), np.array([-b]), np.zeros(0), np.zeros(1)).within(1e-15)


@pytest.mark.parametrize("bad", [np.nan, inf, -inf, 1e200])
@pytest.mark.parametrize("part", range(4))
def test_what_is_not_finite_has_infinite_residuals(bad: float, part: int):
    proof = certificate(problem(), *changed(part, 0, bad))
    assert (proof.primal, proof.dual, proof.gap) == (inf, inf, inf)
    assert not proof.within(1e300)


def test_dual_and_gap_are_relative_to_the_data_and_primal_is_not():
    proof = Certificate(primal=1e-7, dual=1e-5, gap=1e-4, scale_dual=100.0, scale_gap=1000.0)
    assert proof.ok
    assert not Certificate(primal=1e-5, dual=0.0, gap=0.0, scale_dual=100.0, scale_gap=1000.0).ok
    assert not Certificate(primal=0.0, dual=2e-4, gap=0.0, scale_dual=100.0).ok
    assert not Certificate(primal=0.0, dual=0.0, gap=2e-3, scale_gap=1000.0).ok
    assert not Certificate(np.nan, np.nan, np.nan).ok
    assert not Certificate(primal=0.0, dual=0.0, gap=0.0, distance=2e-4).ok
    assert not Certificate(primal=0.0, dual=0.0, gap=0.0, slope=2e-6).ok
    assert not Certificate.none().ok


@pytest.mark.parametrize("case", [c for c in SOLVABLE if None not in (c.x, c.y, c.z, c.z_box)], ids=str)
def test_answers_worked_out_by_hand_are_certified(case):
    point = [np.array(values, dtype=float) for values in (case.x, case.y, case.z, case.z_box)]
    assert certificate(case.make(), *point).within(1e-12)


@given(
    seed=st.integers(0, 10_000), part=st.integers(0, 3), index=st.integers(0, 100), step=st.sampled_from([-0.01, 0.01])
)
def test_no_step_away_from_the_optimum_of_a_random_problem_is_certified(seed: int, part: int, index: int, step: float):
    qp = random_qp(seed, 5, 1, 4)
    answer = solve(qp)
    point = [answer.x.copy(), answer.y.copy(), answer.z.copy(), answer.z_box.copy()]
    assert certificate(qp, *point).within(1e-8)
    point[part][index % len(point[part])] += step
    assert not certificate(qp, *point).ok


@given(st.floats(0.0, 18.0), st.floats(-14.0, 1.0), st.sampled_from([1.0, 1e-6, 1e6]))
def test_pushes_that_cancel_hide_no_slope_that_matters(size: float, slope: float, unit: float):
    """Two pushes of 10^size on a variable without curvature, whose slope they leave: 1e-6 of the cost at most."""
    left = 10.0**slope
    qp = QP(unit * np.diag([0.0, 1.0]), unit * np.array([left, -1.0]), A=[[1.0, 0.0], [1.0, 0.0]], b=[0.0, 0.0])
    push = unit * 10.0**size * np.array([1.0, -1.0])
    found = certificate(qp, np.array([0.0, 1.0]), push, np.zeros(0), np.zeros(2))
    assert not found.ok or left <= 1e-5


@given(st.floats(0.0, 8.0), st.integers(0, 10_000))
def test_pushes_that_cancel_are_certified_where_rounding_is_all_they_leave(size: float, seed: int):
    """A gradient of zero along variables without curvature, as the sum of pushes of 10^size that are not exact."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(3, 2))
    push = 10.0**size * np.linalg.svd(rows.T)[2][-1]
    qp = QP(np.diag([0.0, 0.0, 1.0]), [0.0, 0.0, -1.0], A=np.column_stack([rows, np.zeros(3)]), b=np.zeros(3))
    assert certificate(qp, np.array([0.0, 0.0, 1.0]), push, np.zeros(0), np.zeros(3)).ok


@pytest.mark.parametrize("beside", [False, True], ids=["alone", "beside a variable that is held"])
def test_an_x_so_large_that_its_rounding_hides_the_slope_is_not_certified(beside: bool):
    """Along (1, -1) the cost falls for ever, and at 10^16 (1, -1) rounding of H x is larger than the slope."""
    n = 3 if beside else 2
    H, g, x, A = np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros((n - 2, n))
    H[:2, :2], g[:2], x[:2] = 1.0, (0.1, -0.1), (1e16, -1e16)
    g[2:], A[:, 2:] = 5.0, 1.0
    qp = QP(H, g, A=A, b=np.zeros(n - 2))
    assert not certificate(qp, x, np.full(n - 2, -5.0), np.zeros(0), np.zeros(n)).ok
    near = certificate(qp, np.zeros(n), np.full(n - 2, -5.0), np.zeros(0), np.zeros(n))
    assert not near.ok and near.slope == pytest.approx(1.0)


@given(st.integers(0, 10_000), st.integers(1, 12), st.floats(0.0, 40.0))
def test_a_sum_is_rounded_once_whatever_cancels(seed: int, n: int, decades: float):
    rng = np.random.default_rng(seed)
    rows, factors = (
        rng.standard_normal(shape) * 10.0 ** rng.uniform(-decades, decades, shape) for shape in ((3, n), n)
    )
    rows[rng.random(rows.shape) < 0.2] = 0.0
    exact = [sum(Fraction(a) * Fraction(x) for a, x in zip(row, factors, strict=True)) for row in rows.tolist()]
    near = np.array([-float(total) for total in exact])  # all but the last digits cancel
    for terms in ((), (near,)):
        for row, total in enumerate(exact):
            beside = Fraction(float(near[row])) if terms else Fraction(0)
            assert rounded_once(rows, factors, *terms)[row] == float(total + beside)


def test_a_certificate_says_in_words_what_it_lacks():
    qp = QP([[1.0]], [0.0], lb=[0.5])
    missed = certificate(qp, np.array([0.2]), np.zeros(0), np.zeros(0), np.array([-0.2]))
    assert "a bound is missed by 0.3 of its unit" in missed.fault()
