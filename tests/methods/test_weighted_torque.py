"""The weighted torque as a specification: exact numbers, every solver, the mathematics of the optimum, limits."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

from tests.methods.torque_problems import CALM, again, problems
from tests.seeds import generator
from wbc.errors import NoClosedForm
from wbc.methods import WeightedTorque
from wbc.methods.weighted_torque import CLOSED_FORMS, FORMS
from wbc.models import PlanarPR
from wbc.qp import solve
from wbc.qp.solvers import usable
from wbc.testing import check_method

#: Solvers that end at rounding, as far as they are installed.
EXACT = [name for name in ("pdas", "daqp", "quadprog") if name in usable()]
ROBOT = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1)
#: Two joints, one task row: the planar PR robot at rest, q = (0, π/2), pushed by the environment with (−1, 1) N.
M, J = ROBOT.M([0, np.pi / 2]), ROBOT.J([0, np.pi / 2])[:1]
PUSH = ROBOT.J([0, np.pi / 2]).T @ [-1.0, 1.0]


def exercise() -> WeightedTorque:
    return WeightedTorque(M, [0, 0], J, [9.0], tau_0=[-1, 2], tau_external=PUSH)


def assert_same(one: WeightedTorque, tau: np.ndarray, other: np.ndarray, tolerance: float = 1e-8) -> None:
    size = 1.0 + np.abs(tau).max() + np.abs(one.tau_0).max() + np.abs(one.n).max() + np.abs(one.tau_external).max()
    np.testing.assert_allclose(tau, other, rtol=0, atol=tolerance * size)


# ---- numbers
def test_the_torque_of_the_exercise_is_exact():
    """In rationals: M = [[2, −1/4], [−1/4, 13/80]], J = (1, −1/2), ÿ = 9, so λ = 115/11 and τ = (104/11, −71/22)."""
    a, b, c = Fraction(2), Fraction(-1, 4), Fraction(13, 80)
    det = a * c - b * b
    inverse = ((c / det, -b / det), (-b / det, a / det))
    row = (Fraction(1), Fraction(-1, 2))
    A = [row[0] * inverse[0][j] + row[1] * inverse[1][j] for j in range(2)]
    tau_0 = (Fraction(-1), Fraction(2))
    known = (tau_0[0] - 1, tau_0[1] + Fraction(1, 2))
    compliance = A[0] * row[0] + A[1] * row[1]
    multiplier = (9 - A[0] * known[0] - A[1] * known[1]) / compliance
    tau = [tau_0[i] + row[i] * multiplier for i in range(2)]
    assert (det, multiplier, tau) == (Fraction(21, 80), Fraction(115, 11), [Fraction(104, 11), Fraction(-71, 22)])
    answers = [exercise().closed_form(form) for form in CLOSED_FORMS]
    answers += [exercise().solve(solver, form) for solver in ("pdas", "daqp") for form in FORMS]
    for answer in answers:
        np.testing.assert_allclose(answer.tau, [104 / 11, -71 / 22], rtol=0, atol=1e-12)
        np.testing.assert_allclose(answer.a, [29 / 11, -140 / 11], rtol=0, atol=1e-12)
        np.testing.assert_allclose(answer.multipliers, [115 / 11], rtol=0, atol=1e-12)
        assert answer.cost == pytest.approx(13225 / 154, rel=1e-14)
        assert (answer.scale, answer.feasible) == (1.0, True)


def test_weights_by_name_are_powers_of_the_inertia():
    for name, power in (("identity", 0), ("inverse_inertia", -1), ("inverse_inertia_squared", -2)):
        W = WeightedTorque(M, [0, 0], J, [9.0], weight=name).W
        np.testing.assert_allclose(W, np.linalg.matrix_power(M, power), rtol=1e-12, atol=1e-12)


# ---- every solver
@given(problems())
def test_closed_form_and_qp_agree_on_every_solver(task: WeightedTorque):
    """Property 45, of any rank, with equalities, with damping, also where the task is out of reach."""
    check_method(task)


@given(problems(limited=True))
def test_all_solvers_agree_within_torque_limits(task: WeightedTorque):
    check_method(task)


@given(problems(limited=True, damped=False), st.sampled_from(EXACT))
def test_all_sets_of_unknowns_have_the_same_optimum(task: WeightedTorque, solver: str):
    """Property 45, with torque limits."""
    one, *others = (task.solve(solver, form) for form in FORMS)
    for other in others:
        assert max(task.difference(other, one).values()) <= 1e-8


@given(problems(**CALM, limited=True, damped=True))
def test_all_sets_of_unknowns_have_the_same_optimum_with_damping(task: WeightedTorque):
    one, *others = (task.solve(form=form) for form in FORMS)
    for other in others:
        assert other.tau.shape == one.tau.shape
        assert max(task.difference(other, one).values()) <= 1e-8


@given(problems())
def test_the_three_closed_forms_say_the_same(task: WeightedTorque):
    """Property 45, of any rank and with damping."""
    one, *others = (task.closed_form(form) for form in CLOSED_FORMS)
    for other in others:
        assert max(task.difference(other, one).values()) <= 1e-9


@given(problems(**CALM), st.sampled_from(FORMS))
def test_the_qp_as_it_is_written_has_the_closed_form_as_its_optimum(task: WeightedTorque, form: str):
    """Property 45, without the units in which methods solve their QPs."""
    answer = solve(task.qp(form))
    x = task.closed_form()
    values = {"torque": x.tau, "acceleration": x.a, "joint": np.concatenate([x.a, x.tau])}[form]
    H, g = task.qp(form).H, task.qp(form).g
    best = np.concatenate([values, np.zeros(len(g) - len(values))])
    if task.damping:
        best[len(values) :] = (task.task_acceleration - task.drift - task.J @ x.a) / task.damping
    assert answer.status.ok
    gap = answer.x - best
    assert gap @ H @ gap <= 1e-10 * (np.abs(best) @ np.abs(H) @ np.abs(best) + np.abs(g) @ np.abs(best) + 1e-3)


@pytest.mark.parametrize("decade", [-1, -3, -5])
@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_certified_near_singularities(form: str, decade: int):
    """Two rows of J that are nearly parallel: the answer is exact to rounding, and its multipliers are large."""
    rng = generator("forms near singularities")
    for _ in range(20):
        row = rng.normal(size=2)
        rows = np.array([row, 2.0 * row + 10.0**decade * rng.normal(size=2)])
        task = WeightedTorque(M, [0, 0], rows, rows @ rng.normal(size=2), tau_0=rng.normal(size=2))
        assert solve(task.qp(form)).status.ok


# ---- what the optimum is: feasible (43) and in the range of the task (44), which only one torque is
@given(problems(**CALM, damped=False), st.sampled_from(FORMS))
def test_forward_dynamics_give_the_commanded_acceleration(task: WeightedTorque, form: str):
    """Property 43, for any tau_0, external torque and bias: M a + n = τ + τ_ext solved for a."""
    for answer in (task.closed_form(), task.solve(form=form)):
        a = np.linalg.solve(task.M, answer.tau + task.tau_external - task.n)
        size = np.abs(task.J) @ np.abs(a) + np.abs(task.drift)
        np.testing.assert_allclose(
            task.J @ a + task.drift, task.task_acceleration, rtol=0, atol=1e-7 * (1 + size.max())
        )
        np.testing.assert_allclose(
            task.E @ a, task.e, rtol=0, atol=1e-7 * (1 + np.abs(task.E) @ np.abs(a)).max(initial=1)
        )


@given(problems(**CALM, damped=False))
def test_the_torque_beside_tau_0_lies_in_the_range_of_the_task(task: WeightedTorque):
    """Property 44: W (τ − τ₀) = (J M⁻¹)ᵀ λ; for W = M⁻¹, τ − τ₀ = Jᵀ λ."""
    for answer in (task.closed_form(), task.solve()):
        rows = np.vstack([task.J, task.E]) @ np.linalg.inv(task.M)
        force = task.W @ (answer.tau - task.tau_0)
        np.testing.assert_allclose(force, rows.T @ answer.multipliers, rtol=0, atol=1e-7 * (np.abs(force).max() + 1e-9))


@given(problems(**CALM, damped=False))
def test_duplicated_rows_change_nothing(task: WeightedTorque):
    """Property 57: Λ does not exist, its pseudo-inverse does; on every set of unknowns."""
    twice = again(task, J=np.vstack([task.J, 2.0 * task.J[:1]]),
                  task_acceleration=np.append(task.task_acceleration, 2.0 * task.task_acceleration[0]),
                  drift=np.append(task.drift, 2.0 * task.drift[0]))  # fmt: skip
    tau = task.closed_form().tau
    for answer in (twice.closed_form(), *(twice.solve(form=form) for form in FORMS)):
        assert answer.feasible
        assert_same(task, answer.tau, tau, 1e-7)


# ---- limits
@given(problems(**CALM | {"consistent": None}, limited=True, damped=False))
def test_within_limits_the_optimum_meets_the_conditions_of_optimality(task: WeightedTorque):
    """Property 53: W (τ − τ₀) − Aᵀ λ pushes only at limits and only inwards."""
    answer = task.solve()
    if not answer.feasible:
        return
    push = (
        task.W @ (answer.tau - task.tau_0)
        - (np.vstack([task.J, task.E]) @ np.linalg.inv(task.M)).T @ answer.multipliers
    )
    size = np.abs(task.W @ answer.tau).max() + np.abs(task.W @ task.tau_0).max()
    room = 1e-7 * np.abs(answer.tau).max()
    assert (answer.tau <= task.tau_max + room).all() and (answer.tau >= task.tau_min - room).all()
    assert (push[answer.tau > task.tau_min + room] <= 1e-6 * size).all()
    assert (push[answer.tau < task.tau_max - room] >= -1e-6 * size).all()


@given(problems(**CALM, damped=False))
def test_limits_that_are_not_reached_change_nothing(task: WeightedTorque):
    """Property 53."""
    answer = task.closed_form()
    far = 2.0 * np.abs(answer.tau).max() + 1.0
    limited = again(task, tau_min=-far, tau_max=far)
    assert_same(task, limited.solve().tau, answer.tau)
    with pytest.raises(NoClosedForm, match="limits"):
        limited.closed_form()


@given(problems(**CALM | {"consistent": None}, limited=True, damped=False), st.sampled_from(["pdas", "osqp", "highs"]))
def test_the_scale_is_that_of_a_linear_program(task: WeightedTorque, solver: str):
    """Property 53: s_max by scipy's simplex on A τ − s ÿ = …, limits on τ, 0 ≤ s ≤ 1."""
    answer = task.solve(solver)
    inverse = np.linalg.inv(task.M)
    rows = np.vstack([task.J, task.E]) @ inverse
    known = np.concatenate([-task.drift, task.e]) + rows @ (task.n - task.tau_external)
    columns = np.column_stack([rows, -np.concatenate([task.task_acceleration, np.zeros(len(task.e))])])
    length = np.linalg.norm(columns, axis=1)
    # The simplex is given numbers near one, where it has a verdict: torques in units of the answer, or of the limits.
    torques = [*answer.tau] if answer.scale >= 0 else [*task.tau_min, *task.tau_max]
    size = max((abs(torque) for torque in torques if np.isfinite(torque)), default=1.0) or 1.0
    unit = np.append(np.full(len(task.n), size), 1.0)
    bounds = [*zip(task.tau_min / unit[:-1], task.tau_max / unit[:-1], strict=True), (0.0, 1.0)]
    found = linprog(
        -np.eye(len(unit))[-1], A_eq=columns * unit / (length[:, None] * unit[0]), b_eq=known / length / unit[0],
        bounds=bounds, method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )  # fmt: skip
    if np.isnan(answer.scale):
        assert found.status == 2
    else:
        assert found.status == 0
        share = np.abs(task.task_acceleration).max() / (np.abs(task.task_acceleration).max() + np.abs(known).max())
        assert abs(answer.scale - found.x[-1]) * share <= 1e-7
        assert answer.feasible == (answer.scale == 1.0)


@given(problems(**CALM, weights=["identity"], limited=True, damped=False, equalities=False))
def test_the_optimum_within_limits_is_that_of_bounded_least_squares(task: WeightedTorque):
    """Property 53: scipy's lsq_linear with the task at a weight that leaves 1e-10 of it."""
    answer = task.solve()
    if not answer.feasible:
        return
    A = task.J @ np.linalg.inv(task.M)
    b = task.task_acceleration - task.drift + A @ (task.n - task.tau_external)
    unit = np.abs(answer.tau).max() + np.abs(task.tau_0).max()
    condition = np.linalg.cond(A)
    if condition > 30:
        return
    heavy = 1e5 / np.linalg.norm(A, 2)
    found = lsq_linear(
        np.vstack([np.eye(len(task.n)), heavy * A]), np.concatenate([task.tau_0, heavy * b]) / unit,
        (task.tau_min / unit - 1e-12, task.tau_max / unit + 1e-12), method="bvls", tol=1e-14,
    )  # fmt: skip
    np.testing.assert_allclose(found.x * unit, answer.tau, rtol=0, atol=1e-5 * condition**2 * unit)


def test_a_task_out_of_reach_is_scaled_and_says_so():
    """τ ≤ 5 N allows 60 % of the acceleration: by hand, (5 − τ_rest) / (τ_full − τ_rest)."""
    task = WeightedTorque([[2.0]], [1.0], [[1.0]], [10.0 / 3.0], tau_min=-5.0, tau_max=5.0)
    for form in FORMS:
        answer = task.solve(form=form)
        assert not answer.feasible
        assert answer.scale == pytest.approx(0.6, abs=1e-10)
        np.testing.assert_allclose([answer.tau[0], answer.a[0]], [5.0, 2.0], atol=1e-9)


def test_equalities_and_drift_are_never_scaled():
    """Two joints of unit inertia: one is held by an equality, the other scaled."""
    held = {"tau_min": -1.0, "tau_max": 1.0, "equalities": ([[1.0, 0.0]], [0.5])}
    answer = WeightedTorque(np.eye(2), [0, 0], [[0.0, 1.0]], [4.0], drift=[1.0], **held).solve()
    np.testing.assert_allclose(answer.a, [0.5, 1.0], atol=1e-9)
    assert answer.scale == pytest.approx(0.5, abs=1e-10)
    none = WeightedTorque(np.eye(2), [0, 0], [[0.0, 1.0]], [4.0], drift=[9.0], **held | {"tau_max": 0.5}).solve()
    assert not none.feasible and np.isnan(none.scale) and np.isnan(none.tau).all()
    held["equalities"] = ([[1.0, 0.0]], [2.0])
    never = WeightedTorque(np.eye(2), [0, 0], [[0.0, 1.0]], [0.1], **held).solve()
    assert not never.feasible and np.isnan(never.scale)


def test_contradicting_rows_are_out_of_reach_in_closed_form_too():
    """Two equal rows that want 2 and 4: only s = 0 says the same twice."""
    task = WeightedTorque(np.eye(2), [0, 0], [[1.0, 0.0], [1.0, 0.0]], [2.0, 4.0], tau_0=[1.0, 3.0])
    for answer in (task.closed_form(), task.solve(), task.solve("daqp", "joint")):
        assert not answer.feasible
        assert answer.scale == pytest.approx(0.0, abs=1e-12)
        np.testing.assert_allclose(answer.tau, [0.0, 3.0], atol=1e-9)
    half = again(task, drift=[-1.0, 0.0])  # a₁ − 1 = 2 s and a₁ = 4 s
    assert half.closed_form().scale == pytest.approx(0.5) and half.solve().scale == pytest.approx(0.5)
    never = again(task, drift=[1.0, 0.0])  # a₁ + 1 = 2 s and a₁ = 4 s: s < 0
    assert np.isnan(never.closed_form().scale) and np.isnan(never.solve().scale)


@pytest.mark.parametrize("form", FORMS)
def test_equal_rows_with_opposite_accelerations_leave_the_scale_zero(form: str):
    for k in range(30):
        rng = generator("opposite", form, k)
        row, factor = rng.choice([-1.0, 0.0, 1.0, 2.0], 3), rng.normal(size=(3, 3))
        task = WeightedTorque(factor @ factor.T + np.eye(3), [1.0, 2.0, 3.0], [row, row], [-1.0, 1.0], tau_0=0.5)
        scales = [answer.scale for answer in (task.closed_form(), task.solve(form=form))]
        np.testing.assert_allclose(scales, 0.0, atol=1e-9)
