"""The weighted torque as a specification: exact numbers, every solver, the mathematics of the optimum, limits."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import linprog, lsq_linear

from tests.methods.problems import drawn
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
#: One of everything at moderate condition: independent rows, no limits.
calm = problems(**CALM, equalities=False, damped=False)
gauss = problems(**CALM, equalities=False, damped=False, weights=["inverse_inertia"])


def exercise(acceleration: float = 9.0) -> WeightedTorque:
    return WeightedTorque(M, [0, 0], J, [acceleration], tau_0=[-1, 2], tau_external=PUSH)


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


def test_the_torque_printed_for_the_exercise_belongs_to_the_opposite_acceleration():
    """The source prints (−2, 2.5): that is the optimum for r̈ = −9, and gives the task −9 instead of 9."""
    answer = exercise(-9.0).closed_form()
    np.testing.assert_allclose(answer.tau, [-2.0, 2.5], rtol=0, atol=1e-12)
    np.testing.assert_allclose(answer.multipliers, [-1.0], rtol=0, atol=1e-12)
    assert (J @ np.linalg.solve(M, np.array([-2.0, 2.5]) + PUSH))[0] == pytest.approx(-9.0)


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


def test_the_examples_have_active_limits_infeasible_tasks_and_dependent_rows():
    """At least 30 % with an active limit, 5 % infeasible, 5 % of deficient rank."""
    seen: Counter[str] = Counter()

    @settings(max_examples=drawn(150), database=None)
    @given(problems(limited=True))
    def look(task: WeightedTorque) -> None:
        answer = task.solve()
        distance = np.minimum(answer.tau - task.tau_min, task.tau_max - answer.tau)
        seen["examples"] += 1
        seen["active"] += bool((distance <= 1e-9 * np.abs(answer.tau).max()).any())
        seen["infeasible"] += not answer.feasible
        seen["deficient"] += bool(np.linalg.matrix_rank(task.J) < len(task.J))

    look()
    share = {name: count / seen["examples"] for name, count in seen.items()}
    assert share["active"] >= 0.3
    assert share["infeasible"] >= 0.05
    assert share["deficient"] >= 0.05


# ---- what the optimum is
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


@given(gauss)
def test_with_the_inverse_inertia_the_multipliers_are_forces_at_the_task(task: WeightedTorque):
    """Property 44."""
    answer = task.closed_form()
    assert_same(task, answer.tau - task.tau_0, task.J.T @ answer.multipliers)


@given(calm, st.integers(0, 2**32 - 1))
def test_motion_in_the_null_space_costs_and_does_not_move_the_task(task: WeightedTorque, seed: int):
    """Property 46."""
    answer = task.closed_form()
    A = task.J @ np.linalg.inv(task.M)
    z = np.random.default_rng(seed).normal(size=len(task.n)) * np.abs(answer.tau).max()
    null = z - np.linalg.pinv(A) @ (A @ z)
    other = answer.tau + null
    np.testing.assert_allclose(A @ other, A @ answer.tau, rtol=0, atol=1e-9 * (np.abs(A) @ np.abs(other)).max())
    cost = 0.5 * (other - task.tau_0) @ task.W @ (other - task.tau_0)
    assert cost >= answer.cost * (1 - 1e-9)


@given(gauss, st.integers(0, 2**32 - 1))
def test_the_inverse_inertia_does_not_depend_on_coordinates(task: WeightedTorque, seed: int):
    """Property 47: q = T z, torques transform with Tᵀ."""
    n = len(task.n)
    T = np.diag(10.0 ** np.random.default_rng(seed).uniform(-1, 1, n)) + 0.1 * np.triu(np.ones((n, n)), 1)
    changes = {"M": T.T @ task.M @ T, "n": T.T @ task.n, "J": task.J @ T, "tau_0": T.T @ task.tau_0,
               "tau_external": T.T @ task.tau_external, "equalities": None, "weight": "inverse_inertia"}  # fmt: skip
    other = again(task, **changes)
    assert_same(other, T.T @ task.closed_form().tau, other.closed_form().tau, 1e-7)


@pytest.mark.parametrize("weight", ["identity", "inverse_inertia_squared"])
def test_other_weights_depend_on_units(weight: str):
    """Property 47, the other side: millimetres instead of metres on the prismatic joint give another motion."""
    T = np.diag([1e-3, 1.0])
    metres = WeightedTorque(M, [0, 0], J, [9.0], tau_0=[-1, 2], weight=weight)
    other = WeightedTorque(T.T @ M @ T, [0, 0], J @ T, [9.0], tau_0=T @ [-1.0, 2.0], weight=weight)
    assert np.abs(T.T @ metres.closed_form().tau - other.closed_form().tau).max() > 1e-6
    gauss = WeightedTorque(M, [0, 0], J, [9.0], tau_0=[-1, 2])
    same = WeightedTorque(T.T @ M @ T, [0, 0], J @ T, [9.0], tau_0=T @ [-1.0, 2.0])
    np.testing.assert_allclose(T.T @ gauss.closed_form().tau, same.closed_form().tau, rtol=1e-9)


@given(gauss)
def test_the_null_space_projector_and_the_dynamically_consistent_inverse(task: WeightedTorque):
    """Property 48, the matrices read off the answers: A Nᵀ = 0, Nᵀ Nᵀ = Nᵀ, J J̄ = I, M⁻¹ Nᵀ = N M⁻¹."""
    n, m = len(task.n), len(task.J)
    still = again(task, n=np.zeros(n), tau_external=0.0, drift=0.0, task_acceleration=np.zeros(m), tau_0=0.0,
                  weight="inverse_inertia")  # fmt: skip
    NT = np.column_stack([again(still, tau_0=e, weight="inverse_inertia").closed_form().tau for e in np.eye(n)])
    bar = [again(still, task_acceleration=e, weight="inverse_inertia").closed_form().a for e in np.eye(m)]
    inverse = np.linalg.inv(task.M)
    A = task.J @ inverse
    np.testing.assert_allclose(A @ NT, 0.0, rtol=0, atol=1e-8 * np.abs(A).max())
    np.testing.assert_allclose(NT @ NT, NT, rtol=0, atol=1e-7)
    np.testing.assert_allclose(task.J @ np.column_stack(bar), np.eye(m), rtol=0, atol=1e-6)
    np.testing.assert_allclose(inverse @ NT, NT.T @ inverse, rtol=0, atol=1e-7 * np.abs(inverse).max())


@given(gauss, st.integers(0, 2**32 - 1))
def test_preferred_torques_in_the_range_of_the_task_have_no_influence(task: WeightedTorque, seed: int):
    """Property 49: τ(τ₀ + Jᵀ z) = τ(τ₀) for W = M⁻¹."""
    z = np.random.default_rng(seed).normal(size=len(task.J)) * np.abs(task.tau_0).max() / np.abs(task.J).max()
    other = again(task, tau_0=task.tau_0 + task.J.T @ z, weight="inverse_inertia")
    assert_same(task, task.closed_form().tau, other.closed_form().tau)


@given(calm, st.floats(-2, 3))
def test_the_torque_is_affine_in_task_bias_preferred_and_external_torque(task: WeightedTorque, share: float):
    """Property 50."""
    names = ("task_acceleration", "drift", "n", "tau_0", "tau_external")
    ends = {name: 1.0 - 2.0 * getattr(task, name) for name in names}
    between = {name: (1 - share) * getattr(task, name) + share * ends[name] for name in names}
    start, end = task.closed_form().tau, again(task, **ends).closed_form().tau
    middle = again(task, **between).closed_form().tau
    size = np.abs([start, end, middle]).max()
    np.testing.assert_allclose(middle, (1 - share) * start + share * end, rtol=0, atol=1e-7 * size)


@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_without_redundancy_the_torque_is_the_computed_torque(n: int, seed: int):
    """Property 50: for m = n, whatever W and τ₀."""
    rng = np.random.default_rng(seed)
    root, J, bias, wanted = rng.normal(size=(n, n)), rng.normal(size=(n, n)) + 3 * np.eye(n), *rng.normal(size=(2, n))
    inertia = root @ root.T + np.eye(n)
    expected = inertia @ np.linalg.solve(J, wanted) + bias
    for weight in ("inverse_inertia", "identity", "inverse_inertia_squared"):
        task = WeightedTorque(inertia, bias, J, wanted, tau_0=rng.normal(size=n), weight=weight)
        np.testing.assert_allclose(task.closed_form().tau, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())


@given(calm, st.integers(0, 2**32 - 1))
def test_a_measured_force_does_not_move_the_task(task: WeightedTorque, seed: int):
    """Property 51, and where there is no redundancy the torque changes by exactly Jᵀ dF."""
    push = np.random.default_rng(seed).normal(size=len(task.n)) * np.abs(task.tau_external).max()
    other = again(task, tau_external=task.tau_external + push)
    before, after = task.closed_form(), other.closed_form()
    size = (np.abs(task.J) @ np.abs(np.linalg.inv(task.M)) @ (np.abs(after.tau) + np.abs(push) + np.abs(task.n))).max()
    np.testing.assert_allclose(task.J @ after.a, task.J @ before.a, rtol=0, atol=1e-8 * size)
    if len(task.J) == len(task.n):
        assert_same(other, before.tau - push, after.tau, 1e-7)


def test_the_task_error_decays_at_its_gains():
    """Property 52: ë + K_D ė + K_P e = 0 along a simulated motion, pushed by a force, in the horizontal plane."""
    kp, kd, push, dt = 25.0, 6.0, np.array([-1.0, 1.0]), 2e-3
    robot = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1, gravity=0.0)

    def error(t: float, x: np.ndarray) -> np.ndarray:
        q, v = x[:2], x[2:]
        position = q[0] + 0.5 * np.cos(q[1])
        return np.array([1 - np.cos(3 * t) - position, 3 * np.sin(3 * t) - (robot.J(q)[0] @ v)])

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        q, v = x[:2], x[2:]
        e, ed = error(t, x)
        J, external = robot.J(q)[:1], robot.J(q).T @ push
        task = WeightedTorque(
            robot.M(q), robot.c(q, v), J, [9 * np.cos(3 * t) + kd * ed + kp * e], drift=robot.Jdot_v(q, v)[:1],
            tau_0=-0.5 * v, tau_external=external,
        )  # fmt: skip
        tau = task.closed_form().tau
        return np.concatenate([v, np.linalg.solve(robot.M(q), tau + external - robot.c(q, v))])

    x = np.array([0.3, np.pi / 2, 0.1, -0.2])
    start = error(0.0, x)
    for k in range(500):
        t = k * dt
        if k % 100 == 0:
            expected = expm(np.array([[0.0, 1.0], [-kp, -kd]]) * t) @ start
            np.testing.assert_allclose(error(t, x), expected, rtol=0, atol=1e-7)
        k1 = rate(t, x)
        k2 = rate(t + dt / 2, x + dt / 2 * k1)
        k3 = rate(t + dt / 2, x + dt / 2 * k2)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + dt, x + dt * k3))


def test_damping_by_the_preferred_torque_takes_energy_from_the_null_space_only():
    """Property 55: the task rests, nothing pulls; τ₀ = −D v, and T falls while the task stays where it is."""
    robot = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1, gravity=0.0)

    def rate(x: np.ndarray, damping: float) -> np.ndarray:
        q, v = x[:2], x[2:]
        task = WeightedTorque(robot.M(q), robot.c(q, v), robot.J(q)[:1], [0.0], drift=robot.Jdot_v(q, v)[:1],
                              tau_0=-damping * v)  # fmt: skip
        return np.concatenate([v, np.linalg.solve(robot.M(q), task.closed_form().tau - robot.c(q, v))])

    q = np.array([0.0, 1.0])
    v = np.array([0.5 * np.sin(1.0), 1.0])  # J v = 0
    energies = {}
    for damping in (0.0, 0.3):
        x, dt, found = np.concatenate([q, v]), 5e-3, []
        for _ in range(200):
            found.append(0.5 * x[2:] @ robot.M(x[:2]) @ x[2:])
            k1 = rate(x, damping)
            k2 = rate(x + dt / 2 * k1, damping)
            k3 = rate(x + dt / 2 * k2, damping)
            x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + dt * k3, damping))
        assert abs(x[0] + 0.5 * np.cos(x[1]) - 0.5 * np.cos(1.0)) <= 1e-8
        energies[damping] = np.array(found)
    assert (np.diff(energies[0.3]) < 0.0).all()
    assert energies[0.3][-1] < 0.3 * energies[0.3][0]
    assert energies[0.0][-1] > 0.9 * energies[0.0][0]


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


@given(problems(**CALM, limited=True, damped=False))
def test_wider_limits_never_cost_more_and_never_scale_down(task: WeightedTorque):
    """Property 53: objective and scale are monotone in the limits."""
    before = task.solve()
    wider = np.abs(task.tau_min).max(initial=0.0, where=np.isfinite(task.tau_min)) * 0.2 + 0.1
    after = again(task, tau_min=task.tau_min - wider, tau_max=task.tau_max + wider).solve()
    if np.isnan(before.scale):
        return
    assert after.scale >= before.scale - 1e-9
    if before.feasible:
        assert after.cost <= before.cost * (1 + 1e-7) + 1e-9 * (task.tau_0 @ task.W @ task.tau_0)


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
