"""Impedance and admittance: the motion that a force makes is the one that was promised."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import Admittance, Frame, Impedance, JointAdmittance, MeasuredWrench
from tests.tasks.rows_of import linear_rows, moment, rows
from tests.tasks.running import obeyed
from wbc.models.model import RobotState
from wbc.testing import moments, robots
from wbc.testing.strategies import states

ARM = robots()[0]
TOOL = ARM.frame_names[-1]
PUSH = np.array([8.0, -5.0, 3.0, 0.4, 0.2, -0.3])
SPRING = np.array([500.0, 400.0, 300.0, 20.0, 20.0, 30.0])
DAMPER = np.array([50.0, 40.0, 30.0, 2.0, 2.0, 3.0])


@given(states(ARM))
def test_an_unmeasured_push_moves_an_impedance_with_the_robots_own_inertia(state: RobotState):
    """What really happens: M a + h = tau + J' F. The frame's own inertia is then (J M⁻¹ J')⁻¹.

    Along a direction in which the frame hardly moves, σ of J, the regularisation ε leaves σ² / (σ² + ε) of the task.
    """
    target = state.frame(TOOL).placement
    task = Impedance(TOOL, target=target, stiffness=SPRING, damping=DAMPER)
    level = wbc.InverseDynamics(regularisation=1e-12)
    controller = wbc.Controller(ARM, wbc.Stack([task]), level=level)
    tau = controller.tick(0.0, state.q, state.v).tau
    J = state.frame(TOOL).jacobian()
    compliance = J @ np.linalg.solve(state.M, J.T)
    a = np.linalg.solve(state.M, tau + J.T @ PUSH - state.h)
    drift, (U, sigma, _) = state.frame(TOOL).drift(), np.linalg.svd(J)
    acceleration = J @ a + drift
    task_alone = compliance @ (-DAMPER * (J @ state.v)) - drift  # e = 0 here
    left = U @ (level.regularisation / (sigma**2 + level.regularisation) * (U.T @ task_alone))
    promised = task_alone - left + drift + compliance @ PUSH
    np.testing.assert_allclose(acceleration, promised, atol=1e-4 * (1.0 + np.abs(promised).max()))


def test_at_a_singular_posture_an_impedance_is_still_defined():
    state = moment(ARM, np.zeros(7), np.ones(7))
    assert np.linalg.matrix_rank(state.frame(TOOL).jacobian(), tol=1e-9) < 6
    out = linear_rows(Impedance(TOOL, target=np.eye(4), stiffness=SPRING, damping=DAMPER), state, 7)
    J, drift = state.frame(TOOL).jacobian(), state.frame(TOOL).drift()
    reach = np.linalg.norm(J @ np.linalg.solve(state.M, J.T), 2)
    force = SPRING * rows(Frame(TOOL, target=np.eye(4)), state).e - DAMPER * (J @ state.v)
    assert np.linalg.norm(out.b + drift) <= reach * np.linalg.norm(force) * (1.0 + 1e-9)


def pushed(force: Any, M: Any, D: Any, K: Any, level: Any, ticks: int) -> Any:
    """How far M a + D v + K x = force has come after so many milliseconds; without its mass where velocities decide."""
    x, v = 0.0 * force, 0.0 * force
    for _ in range(ticks):
        v = (force - K * x) / D if level.order == 1 else v + 1e-3 * (force - D * v - K * x) / M
        x = x + 1e-3 * v
    return x


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()])
@pytest.mark.parametrize("stiffness", [200.0, 0.0])
def test_an_admittance_moves_as_the_mass_it_stands_for(level: Any, stiffness: float):
    state = moment(ARM, moments(ARM, count=1, seed=3)[0][1])
    M, D, F = 2.0, 40.0, np.array([4.0, -2.0, 3.0])
    task = Admittance(
        TOOL, target=state.frame(TOOL).placement, inertia=M, damping=D, stiffness=stiffness, wrench=F
    )  # fmt: skip
    # The sensor tells the dynamics of the same force, so that the torques it costs are known.
    sensor = [MeasuredWrench(TOOL, wrench=F)] if level.dynamics else []
    controller = wbc.Controller(ARM, wbc.Stack([task], components=sensor), level=level, dt=1e-3)
    *_, (q, _) = obeyed(controller, 200, state.q)
    x = pushed(F, M, D, stiffness, level, 200)
    moved = moment(ARM, q).frame(TOOL).position - state.frame(TOOL).position
    assert np.linalg.norm(x) > 5e-3
    np.testing.assert_allclose(moved, x, atol=0.02 * np.linalg.norm(x))


@given(states(ARM), st.integers(0, 2**32 - 1), st.sampled_from([0.1, 1.0, 10.0, 100.0]))
def test_an_admittance_has_its_equation_whatever_the_moment_and_the_turn(state: RobotState, seed: int, size: float):
    """M a = M a_target + K e + D ė + F, with e from Pinocchio's logarithm; moments that turn a spring beyond π too."""
    rng, here = np.random.default_rng(seed), state.frame(TOOL)
    turn = rng.normal(size=3)
    turn *= rng.uniform(0.0, 3.0) / np.linalg.norm(turn)
    target = np.eye(4)
    target[:3, :3], target[:3, 3] = pin.exp3(turn) @ here.rotation, here.position + rng.normal(size=3)
    M, D, K = rng.uniform(0.5, 5.0, 6), rng.uniform(1.0, 50.0, 6), rng.uniform(0.5, 50.0, 6)
    F = size * rng.normal(size=6)
    task = Admittance(TOOL, target=target, inertia=M, damping=D, stiffness=K, wrench=F)
    found = rows(task, state)
    e = np.concatenate([target[:3, 3] - here.position, pin.log3(target[:3, :3] @ here.rotation.T)])
    expected = K * e + F
    got = M * (task.kp * found.e + found.acc_ref)
    np.testing.assert_allclose(got, expected, atol=1e-7 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize("scale", [1.0, 1e-4], ids=["stiff", "soft"])
def test_a_held_force_moves_the_target_by_the_spring(scale: float):
    state = moment(ARM, moments(ARM, count=1)[0][1])
    here, spring, push = state.frame(TOOL).placement, scale * SPRING, scale * PUSH
    task = Admittance(TOOL, target=here, inertia=1.0, damping=10.0, stiffness=spring)
    assert np.abs(rows(task, state).e).max() < 1e-9
    task.wrench = push
    np.testing.assert_allclose(rows(task, state).e, push / spring, atol=1e-9)
    task.wrench = lambda t: 2.0 * push
    np.testing.assert_allclose(rows(task, state).e[:3], 2.0 * (push / spring)[:3], atol=1e-9)
    joints = JointAdmittance(state.q, inertia=1.0, damping=10.0, stiffness=scale * 50.0, torque=scale * 5.0)
    np.testing.assert_allclose(rows(joints, state).e, 0.1, atol=1e-9)


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel()], ids=lambda level: level.name)
def test_pushed_joints_move_as_the_inertias_they_stand_for(level: Any):
    M, D, K = 0.5, 10.0, np.array([60.0, 0.0, 60.0, 0.0, 60.0, 0.0, 60.0])
    torque = np.array([2.0, -1.0, 0.5, 1.0, 0.0, 0.5, -2.0])
    task = JointAdmittance(ARM.q0, inertia=M, damping=D, stiffness=K, torque=torque)
    controller = wbc.Controller(ARM, wbc.Stack([task]), level=level, dt=1e-3)
    *_, (q, _) = obeyed(controller, 300)
    x = pushed(torque, M, D, K, level, 300)
    np.testing.assert_allclose(q - ARM.q0, x, atol=0.01 * np.abs(x).max())
    task.torque = lambda t: 0.0 * torque
    task.torque = 0.0
    np.testing.assert_allclose(controller.tick(0.3, ARM.q0, np.zeros(7)).v, 0.0, atol=1e-9)
