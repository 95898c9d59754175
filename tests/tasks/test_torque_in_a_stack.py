"""A stack of a task that is a constraint and a preferred torque is the weighted torque method, on any robot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import JointVelocity, MeasuredWrench, Position, Torque, TorqueLimits
from tasks.scenarios.exact_plant import ExactPlant
from wbc.methods import WeightedTorque
from wbc.models import PlanarPR
from wbc.models.model import RobotModel
from wbc.sim.simulate import simulate
from wbc.types import Vec

ARM = wbc.load("arm")
PR = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1)
LEVEL = wbc.InverseDynamics(regularisation=1e-11)
CASES: dict[str, tuple[RobotModel, str, str]] = {
    "planar_pr": (PR, "end_effector", "x"), "arm": (ARM, "tool", "xyz"), "arm along z": (ARM, "tool", "z"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@given(seed=st.integers(0, 9999))
def test_it_is_the_closed_form_with_feedback_gravity_and_a_measured_force(case: str, seed: int):
    """Property 43: the task acceleration of the forward dynamics is the one commanded."""
    robot, frame, axes = CASES[case]
    rng = np.random.default_rng(seed)
    q, v = robot.q0 + 0.2 * rng.normal(size=robot.nq), 0.5 * rng.normal(size=robot.nv)
    target, rate, second = 0.5 * rng.normal(size=(3, len(axes)))
    tau_0, wrench = rng.normal(size=robot.nj), rng.normal(size=6)
    task = Position(frame, axes=axes, target=lambda t: (target, rate, second), kp=60.0, kd=13.0)
    stack = wbc.Stack(
        [Torque(tau_0, weight="inverse_inertia")],
        subject_to=[task.exactly()], components=[MeasuredWrench(frame, wrench=wrench)],
    )  # fmt: skip
    controller = wbc.Controller(robot, stack, level=LEVEL)
    command, state = controller.tick(0.0, q, v), controller.state
    rows = slice("xyz".index(axes[0]), "xyz".index(axes[-1]) + 1)
    J, drift, at = state.frame(frame).jacobian(), state.frame(frame).drift()[rows], state.frame(frame).position[rows]
    wanted = second + 13.0 * (rate - J[rows] @ v) + 60.0 * (target - at)
    method = WeightedTorque(
        state.M, state.h, J[rows], wanted, drift=drift, tau_0=tau_0, tau_external=J.T @ wrench
    )  # fmt: skip
    size = 1.0 + np.abs(command.tau).max()
    np.testing.assert_allclose(command.tau, method.closed_form().tau, atol=1e-5 * size)
    forward = np.linalg.solve(state.M, command.tau + J.T @ wrench - state.h)
    np.testing.assert_allclose(J[rows] @ forward + drift, wanted, atol=1e-6 * (1.0 + np.abs(wanted).max()))


def test_an_error_vanishes_at_the_rate_its_gains_give():
    """Property 52: ë + kd ė + kp e = 0, critically damped with kp = 100, kd = 20."""
    offset = 0.05
    task = Position("end_effector", axes="x", target=[offset], kp=100.0)
    stack = wbc.Stack([Torque(weight="inverse_inertia")], subject_to=[task.exactly(name="x")])
    plant = ExactPlant(PR, dt=5e-4)
    plant.reset([0.0, np.pi / 2])
    run = simulate(wbc.Controller(PR, stack, level=LEVEL, dt=5e-4), plant, duration=0.6)
    expected = offset * (1.0 + 10.0 * run["t"]) * np.exp(-10.0 * run["t"])
    np.testing.assert_allclose(run["error.x"][:, 0], expected, atol=2e-3 * offset)


def test_limits_that_are_active_hold_and_the_task_with_them():
    """Property 53."""
    q, v = np.array([0.0, 0.7]), np.array([0.2, -1.0])
    task = Position("end_effector", axes="x", target=[0.5], kp=100.0)
    stack = [Torque([3.0, 2.0], weight="inverse_inertia")]
    free = wbc.Controller(PR, wbc.Stack(stack, subject_to=[task.exactly()]), level=LEVEL).tick(0.0, q, v)
    bound = 0.9 * np.abs(free.tau)
    limits = TorqueLimits([1e3, bound[1]])
    cut = wbc.Controller(PR, wbc.Stack(stack, subject_to=[task.exactly(), limits]), level=LEVEL).tick(0.0, q, v)
    assert cut.status.ok and abs(cut.tau[1]) == pytest.approx(bound[1], abs=1e-8)
    state = PR.state()
    state.update(0.0, q, v)
    J = state.frame("end_effector").jacobian()[:1]
    np.testing.assert_allclose(J @ cut.a, J @ free.a, atol=1e-6)


def free_energy(robot: RobotModel, state: Any, tau: Vec, tau_0: Vec) -> float:
    """½ |a − a_0|²_M, a_0 what tau_0 alone gives: the cost by Gauss' principle."""
    selected = np.eye(robot.nv)[:, robot.nb :]
    off = np.linalg.solve(state.M, selected @ (tau - tau_0))
    return float(0.5 * off @ state.M @ off)


@pytest.mark.filterwarnings("ignore::wbc.models.plausible.NothingHoldsTheBase")
def test_on_a_floating_base_it_is_gauss_principle_too():
    robot = wbc.load("quadruped", base="floating")
    rng = np.random.default_rng(1)
    q, v = robot.integrate(robot.q0, 0.05 * rng.normal(size=robot.nv)), 0.1 * rng.normal(size=robot.nv)
    foot, tau_0 = next(iter(robot.feet)), rng.normal(size=robot.nj)
    state = robot.state()
    state.update(0.0, q, v)
    task = Position(foot, target=state.frame(foot).position + np.array([0.02, 0.0, 0.05]), kp=100.0)
    stack = wbc.Stack([Torque(tau_0, weight="inverse_inertia")], subject_to=[task.exactly()])
    command = wbc.Controller(robot, stack, level=LEVEL).tick(0.0, q, v)
    assert command.status.ok
    # Rows of the torque that the task leaves free: along them the cost must not fall.
    selected = np.eye(robot.nv)[:, robot.nb :]
    A = state.frame(foot).jacobian()[:3] @ np.linalg.solve(state.M, selected)
    free = np.linalg.svd(A)[2][3:]
    best = free_energy(robot, state, command.tau, tau_0)
    for direction in np.vstack([free, -free]):
        assert free_energy(robot, state, command.tau + 0.1 * direction, tau_0) > best
    # Without a task nothing is better than what was asked for.
    alone = wbc.Stack([Torque(tau_0, weight="inverse_inertia"), JointVelocity(np.zeros(12), weight=0.0)])
    np.testing.assert_allclose(wbc.Controller(robot, alone, level=LEVEL).tick(0.0, q, v).tau, tau_0, atol=1e-6)
