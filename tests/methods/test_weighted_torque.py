"""The weighted torque as a specification: exact numbers, every solver, what makes an optimum, limits, damping."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

from tests.methods.torque_problems import CALM, again, problems
from tests.seeds import generator
from wbc.checks import LARGEST
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


def assert_met(task: WeightedTorque, tau: np.ndarray) -> None:
    """Task and equalities, by the acceleration that forward dynamics give."""
    a = np.linalg.solve(task.M, tau + task.tau_external - task.n)
    for rows, drift, right in ((task.J, task.drift, task.task_acceleration), (task.E, 0.0 * task.e, task.e)):
        size = (1.0 + np.abs(rows) @ np.abs(a) + np.abs(drift)).max(initial=1.0)
        np.testing.assert_allclose(rows @ a + drift, right, rtol=0, atol=1e-7 * size)


# ---- what the optimum is: feasible (43) and in the range of the task (44), which only one torque is
@given(problems(**CALM, damped=False), st.sampled_from(FORMS))
def test_forward_dynamics_give_the_commanded_acceleration(task: WeightedTorque, form: str):
    """Property 43, for any tau_0, external torque and bias: M a + n = τ + τ_ext solved for a."""
    for answer in (task.closed_form(), task.solve(form=form)):
        assert_met(task, answer.tau)


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
    """Property 53: W (τ − τ₀) − Aᵀ λ pushes only at limits and only inwards; with the task met, no torque is better."""
    answer = task.solve()
    if not answer.feasible:
        return
    assert_met(task, answer.tau)
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


# ---- damping at singularities
@given(problems(**CALM, damped=False, equalities=False))
def test_damping_leaves_an_error_of_its_square_and_ends_at_tau_0(task: WeightedTorque):
    """Property 54: ‖A τ − b‖ = O(d²), d → 0 is the undamped answer, d → ∞ gives τ₀."""
    A = task.J @ np.linalg.inv(task.M)
    b = task.task_acceleration - task.drift + A @ (task.n - task.tau_external)
    scale = np.sqrt(np.linalg.eigvalsh(A @ np.linalg.inv(task.W) @ A.T)[0])

    def error(d: float) -> float:
        return float(np.linalg.norm(A @ again(task, damping=d * scale).closed_form().tau - b))

    whole = float(np.linalg.norm(A @ task.tau_0 - b))
    for d in (0.3, 0.1):
        assert error(d) <= d**2 * whole * (1 + 1e-6)
    assert error(0.01) <= 1.1e-2 * error(0.1) + 1e-8 * whole
    assert_same(task, again(task, damping=1e-4 * scale).closed_form().tau, task.closed_form().tau, 1e-5)
    most = 1e8 * np.sqrt(np.linalg.norm(A @ np.linalg.inv(task.W) @ A.T, 2))
    far = again(task, damping=min(most, LARGEST))  # no argument may be larger
    assert_same(task, far.closed_form().tau, task.tau_0, 1e-6)
    assert_same(task, far.solve().tau, task.tau_0, 1e-6)


def test_damped_torques_are_continuous_through_singularities():
    """Property 54: two rows that become parallel; without damping the torque grows without bound."""

    def torque(angle: float, damping: float) -> np.ndarray:
        rows = [[1.0, 0.0], [np.cos(angle), np.sin(angle)]]
        return WeightedTorque(np.eye(2), [0, 0], rows, [1.0, -1.0], damping=damping).closed_form().tau

    angles = np.linspace(-0.01, 0.01, 201)
    damped = np.array([torque(angle, 0.1) for angle in angles])
    assert np.abs(np.diff(damped, axis=0)).max() < 0.05
    assert np.abs(torque(1e-6, 0.0)).max() > 1e5


@pytest.mark.parametrize("form", CLOSED_FORMS)
@pytest.mark.parametrize("damping", [1e-2, 1e-4, 1e-6])
def test_more_rows_than_joints_are_least_squares_in_every_closed_form(form: str, damping: float):
    """Oracle: numpy's least squares of [1; A / d]. The rows contradict each other, and d decides nothing."""
    rng = generator("more rows than joints", form, damping)
    for rows in range(4, 9):
        n = 3
        task = WeightedTorque(
            np.eye(n), rng.normal(size=n), rng.normal(size=(rows, n)), rng.normal(size=rows), weight="identity",
            tau_0=rng.normal(size=n), damping=damping,
        )  # fmt: skip
        stacked = np.vstack([np.eye(n), task.J / damping])
        right = np.append(task.tau_0, (task.task_acceleration + task.J @ task.n) / damping)
        np.testing.assert_allclose(task.closed_form(form).tau, np.linalg.lstsq(stacked, right)[0], rtol=0, atol=1e-7)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("solver", EXACT)
def test_limits_hold_where_damping_gives_up_most_of_the_task(solver: str, form: str):
    """Oracle: bounded least squares. The task is missed by up to 1e4 times more than the torques are long."""
    rng = generator("damped far", form)
    for _ in range(40):
        n = int(rng.integers(2, 6))
        m, damping, size = int(rng.integers(1, n + 1)), 10.0 ** rng.uniform(-2, 0), 10.0 ** rng.uniform(2, 5)
        task = WeightedTorque(
            1e-3 * np.eye(n), np.zeros(n), rng.normal(size=(m, n)), size * rng.normal(size=m), weight="identity",
            tau_0=rng.normal(size=n), damping=damping, tau_min=-1.0, tau_max=1.0,
        )  # fmt: skip
        tau = task.solve(solver, form).tau
        assert np.abs(tau).max() <= 1.0 + 1e-7
        stacked = np.vstack([np.eye(n), 1e3 * task.J / damping])
        right = np.append(task.tau_0, task.task_acceleration / damping)
        found = lsq_linear(stacked, right, (-1.0, 1.0), method="bvls", tol=1e-15)
        np.testing.assert_allclose(tau, found.x, rtol=0, atol=1e-6)


# ---- what is refused


@pytest.mark.parametrize("form", FORMS)
def test_a_contradiction_is_seen_beside_accelerations_of_small_inertias(form: str):
    """Five rows want five accelerations of four joints; torques move a joint of 1e-6 kg m² at 1e6 rad/s²."""
    rng = generator("small inertias", form)
    for _ in range(10):
        (turn, _), (J, _) = np.linalg.qr(rng.normal(size=(4, 4))), np.linalg.qr(rng.normal(size=(4, 4)))
        M, E = (turn * [1e-6, 1e-4, 1e-3, 3e-3]) @ turn.T, rng.normal(size=(1, 4))
        held = (E, E @ np.linalg.solve(J, -np.ones(4)) + 1.0)  # a = J⁻¹ (s − 1) gives E a = e for no scale s
        known = {"drift": np.ones(4), "tau_0": rng.normal(size=4), "tau_external": rng.normal(size=4)}
        answer = WeightedTorque(
            0.5 * (M + M.T), rng.normal(size=4), J, np.zeros(4), weight="identity", equalities=held, **known
        ).solve(form=form)
        assert not answer.feasible and np.isnan(answer.scale)
