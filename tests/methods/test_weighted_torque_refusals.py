"""The weighted torque where there is no task to do as asked: damping at singularities, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from scipy.optimize import lsq_linear

from tests.methods.test_weighted_torque import CALM, EXACT, assert_same
from tests.methods.torque_problems import again, problems
from tests.seeds import generator
from wbc.checks import LARGEST
from wbc.methods import WeightedTorque
from wbc.methods.weighted_torque import CLOSED_FORMS, FORMS


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
