"""One task object, three levels: what they have in common, and where they tend to one another."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given

import wbc
from tasks import CenterOfMass, Damping, Frame, JointVelocityLimits, Position, Posture, Sinusoid, TorqueLimits
from wbc.models.model import RobotModel, RobotState
from wbc.testing import robots
from wbc.testing.strategies import states
from wbc.types import Vec

ROBOTS = robots()
ARM = ROBOTS[0]
RATE, DT, TICKS = 2.0, 1e-3, 500


def full_rank(robot: RobotModel, kd: float | None) -> Any:
    """A task whose Jacobian has full rank along the whole motion: a hand or the centre of mass goes round a curve."""
    gains = {"kp": RATE * (10.0 if kd is None else kd), "kd": 10.0 if kd is None else kd}
    state = robot.state()
    start = state.com if robot.nb else state.frame(robot.frame_names[-1]).position
    curve = Sinusoid(start + np.array([0.03, -0.02, -0.04]), amplitude=[0.02, 0.03, 0.02], frequency=[0.5, 0.7, 0.9])
    return CenterOfMass(target=curve, **gains) if robot.nb else Position(robot.frame_names[-1], target=curve, **gains)


def errors(robot: RobotModel, level: Any, kd: float | None) -> Vec:
    """Error of the task along the motion that the level decides, (TICKS, 3)."""
    task = full_rank(robot, kd)
    stack = wbc.Stack([task, Damping(kd=kd or 1.0, weight=1e-9)])
    controller = wbc.Controller(robot, stack, level=level, dt=DT)
    q, v, found = robot.q0, np.zeros(robot.nv), []
    for tick in range(TICKS):
        command = controller.tick(tick * DT, q, v)
        assert command.status.ok
        found.append(controller.plan.errors()[task.name])
        q, v = command.q, command.v
    return np.array(found)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_with_high_gains_accelerations_do_what_velocities_do(robot: RobotModel):
    """At kp / kd = rate fixed the difference of the errors is O(1/kd): it halves when kd doubles."""
    first_order = errors(robot, wbc.VelocityLevel(), None)
    gaps = [float(np.abs(errors(robot, wbc.AccelerationLevel(), kd) - first_order).max()) for kd in (40.0, 80.0, 160.0)]
    ratios = np.array(gaps[1:]) / gaps[:-1]
    assert ((ratios > 0.4) & (ratios < 0.6)).all(), (gaps, ratios)
    assert gaps[-1] < 2.0 * RATE / 160.0 * np.abs(first_order).max()


@given(states(ARM))
def test_torques_without_limits_to_meet_decide_the_accelerations_that_accelerations_decide(state: RobotState):
    tool = ARM.frame_names[-1]
    stack = wbc.Stack(
        [Frame(tool, target=np.eye(4), kp=25, weight=2.0), Posture(ARM.q0, kp=10, weight=1e-2)],
        subject_to=[JointVelocityLimits(), TorqueLimits(1e9)],
    )
    without = wbc.Stack(stack.levels, subject_to=[JointVelocityLimits()])
    torque = wbc.Controller(ARM, stack, level=wbc.InverseDynamics()).tick(0.0, state.q, state.v)
    acceleration = wbc.Controller(ARM, without, level=wbc.AccelerationLevel()).tick(0.0, state.q, state.v)
    assert torque.status.ok and acceleration.status.ok
    np.testing.assert_allclose(torque.a, acceleration.a, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(torque.tau, state.M @ torque.a + state.h, rtol=1e-9, atol=1e-9)
