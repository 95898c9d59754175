"""Momentum, zero moment point, centre of pressure and capture point: against the forces that make them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given

import wbc
from tasks import (
    AngularMomentum,
    CapturePoint,
    CenterOfPressure,
    CentroidalMomentum,
    LinearMomentum,
    Posture,
    ZeroMomentPoint,
    feet,
)
from tests.stack.conftest import moving, standing
from tests.tasks.rows_of import linear_rows, moment, rows
from wbc.models.model import RobotState
from wbc.testing import robots
from wbc.testing.strategies import states
from wbc.types import Vec

ARM, _, HUMANOID = robots()
WEIGHT = HUMANOID.mass * 9.81


def stand(*extra: Any, seed: int = 1) -> tuple[Any, RobotState]:
    """What a standing humanoid decides with some tasks more, and the state it is in."""
    stack = standing(HUMANOID, extra=extra)
    q, v = moving(HUMANOID, seed)
    command = wbc.Controller(HUMANOID, stack, level=wbc.InverseDynamics()).tick(0.0, q, v)
    assert command.status.ok
    return command, moment(HUMANOID, q, v)


def contact_wrench(command: Any, state: RobotState, about: Vec) -> Vec:
    """Force and moment (6,) of all soles about a point, world axes."""
    total = np.zeros(6)
    for contact in feet(HUMANOID):
        anchor = contact.anchor(state)
        force, torque = (anchor.rotation @ part for part in np.split(command.f[contact.frame], 2))
        total += np.concatenate([force, torque + np.cross(anchor.position - about, force)])
    return total


@pytest.mark.parametrize("seed", range(3))
def test_momentum_changes_by_the_forces_on_the_robot(seed: int):
    command, state = stand(seed=seed)
    change = state.centroidal_map @ command.a + state.centroidal_drift
    weight = np.concatenate([HUMANOID.mass * HUMANOID.gravity, np.zeros(3)])
    np.testing.assert_allclose(change, contact_wrench(command, state, state.com) + weight, atol=1e-5)


@given(states(HUMANOID))
def test_the_whole_momentum_is_both_halves(state: RobotState):
    whole = rows(CentroidalMomentum(), state)
    parts = [rows(LinearMomentum(), state), rows(AngularMomentum(), state)]
    for array in ("J", "drift", "e"):
        np.testing.assert_allclose(
            getattr(whole, array), np.concatenate([getattr(part, array) for part in parts]), atol=1e-10
        )


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel()], ids=lambda level: level.name)
def test_a_robot_in_flight_takes_the_momentum_it_is_asked_for(level: Any):
    target = np.array([3.0, -2.0, 1.0, 0.5, 0.4, -0.3])
    task = CentroidalMomentum(target=target, kd=20.0)
    controller = wbc.Controller(HUMANOID, wbc.Stack([task, Posture(HUMANOID.q0, weight=1e-8)]), level=level, dt=0.01)
    q, v = HUMANOID.q0, np.zeros(HUMANOID.nv)
    for tick in range(100):
        command = controller.tick(0.01 * tick, q, v)
        q, v = command.q, command.v
    np.testing.assert_allclose(moment(HUMANOID, q, v).centroidal_map @ v, target, atol=0.05)


@pytest.mark.parametrize("target", [[0.0, 0.0], [0.03, -0.02]])
def test_the_zero_moment_point_is_where_the_contact_forces_act(target: list[float]):
    task = ZeroMomentPoint(target=target, ground=0.0)
    command, state = stand(task)
    point = np.array([*target, 0.0])
    wrench = contact_wrench(command, state, point)
    out = linear_rows(task, state, HUMANOID.nv)
    missed = out.A @ command.a - out.b
    np.testing.assert_allclose(missed, np.array([-wrench[4], wrench[3]]) / WEIGHT, atol=1e-7)


def test_a_heavy_zero_moment_point_is_met():
    task = ZeroMomentPoint(target=[0.01, 0.02], weight=1e6)
    command, state = stand(task)
    wrench = contact_wrench(command, state, np.zeros(3))
    np.testing.assert_allclose(np.array([-wrench[4], wrench[3]]) / wrench[2], [0.01, 0.02], atol=1e-4)


def test_each_foot_has_its_own_centre_of_pressure():
    wanted = {"left_sole": [0.03, 0.01], "right_sole": [-0.02, 0.0]}
    command, _ = stand(*(CenterOfPressure(foot, target=point, weight=1e3) for foot, point in wanted.items()))
    for foot, point in wanted.items():
        f = command.f[foot]
        np.testing.assert_allclose([-f[4] / f[2], f[3] / f[2]], point, atol=1e-4)


@given(states(HUMANOID))
def test_the_capture_point_converges_at_its_rate(state: RobotState):
    task = CapturePoint(target=[0.1, -0.05], height=0.8, rate=4.0)
    out = linear_rows(task, state, HUMANOID.nv)
    a = np.linalg.lstsq(out.A, out.b, rcond=None)[0]
    omega = np.sqrt(9.81 / 0.8)
    J, velocity = state.com_jacobian[:2], (state.com_jacobian @ state.v)[:2]
    acceleration = J @ a + state.com_drift[:2]
    point, rate = state.com[:2] + velocity / omega, velocity + acceleration / omega
    np.testing.assert_allclose(rate, 4.0 * (np.array([0.1, -0.05]) - point), atol=1e-8)
