"""Criteria have exact gradients; the task is the projected gradient method inside a QP, with every limit active."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import (
    Clearance,
    Criterion,
    JointPositionLimits,
    JointVelocityLimits,
    Manipulability,
    MidRange,
    Position,
    ProjectedGradient,
)
from tests.tasks.rows_of import moment as at
from tests.tasks.running import obeyed
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.testing import robots
from wbc.types import Vec

ARM, QUADRUPED, HUMANOID = robots()
FRAMES = {ARM.name: "tool", QUADRUPED.name: "front_left_foot", HUMANOID.name: "left_hand"}


def criteria(robot: RobotModel) -> list[Criterion]:
    frame = FRAMES[robot.name]
    found: list[Criterion] = [
        MidRange(), Manipulability(frame), Manipulability(frame, rows=["z", "rx", "y"]),
        Clearance(frame, point=[0.3, 0.1, 0.2], reach=5.0), Clearance(frame, plane=([0.0, 1.0, 2.0], -0.5), reach=5.0),
    ]  # fmt: skip
    for criterion in found:
        criterion.prepare(robot)
    return found


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
@given(seed=st.integers(0, 9999))
def test_gradients_are_analytic_and_equal_central_differences(robot: RobotModel, seed: int):
    q, step = robot.random_configuration(np.random.default_rng(seed)), 1e-5
    for criterion in criteria(robot):
        value, gradient = criterion.value(at(robot, q)), criterion.gradient(at(robot, q))
        assert gradient.shape == (robot.nj,)
        for joint, axis in enumerate(np.eye(robot.nv)[robot.nb :]):
            ahead, behind = (criterion.value(at(robot, robot.integrate(q, s * axis))) for s in (step, -step))
            found = (ahead - behind) / (2 * step)
            assert abs(found - gradient[joint]) <= 1e-6 * (1 + abs(value) + abs(gradient[joint])), criterion


@given(seed=st.integers(0, 9999))
def test_manipulability_is_the_root_of_the_determinant(seed: int):
    state = at(ARM, ARM.random_configuration(np.random.default_rng(seed)))
    J = state.frame("tool").jacobian()
    for rows, picked in ((["x", "y", "z"], J[:3]), (["x", "y", "z", "rx", "ry", "rz"], J), (["z"], J[2:3])):
        expected = np.sqrt(np.linalg.det(picked @ picked.T))
        assert Manipulability("tool", rows=rows).value(state) == pytest.approx(expected, rel=1e-7, abs=1e-12)


def test_at_a_singular_posture_the_gradient_leads_away():
    criterion = Manipulability("tool")
    q = np.array([0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0])  # the arm stretched out
    criterion.prepare(ARM)
    assert criterion.value(at(ARM, q)) < 1e-12
    gradient = criterion.gradient(at(ARM, q))
    assert np.isfinite(gradient).all() and np.linalg.norm(gradient) > 1e-3
    assert criterion.value(at(ARM, q + 1e-3 * gradient)) > 0.5e-3 * gradient @ gradient


def test_mid_range_is_highest_in_the_middle():
    criterion = MidRange()
    criterion.prepare(ARM)
    middle = 0.5 * (ARM.limits.q_min + ARM.limits.q_max)
    assert criterion.value(at(ARM, middle)) == 0.0
    assert not criterion.gradient(at(ARM, middle)).any()
    assert criterion.value(at(ARM, ARM.limits.q_max)) == pytest.approx(-1 / 8)


def test_an_obstacle_out_of_reach_is_not_felt_and_one_in_reach_repels():
    state = at(ARM, ARM.q0)
    tool = np.array(state.frame("tool").position)
    for near, far in (
        [Clearance("tool", point=tool - [0, 0, d], reach=0.2) for d in (0.1, 0.3)],
        [Clearance("tool", plane=([0, 0, 2], tool[2] - d), reach=0.2) for d in (0.1, 0.3)],
    ):
        assert near.distance(state) == pytest.approx(0.1) and far.distance(state) == pytest.approx(0.3)
        assert far.value(state) == 0.0 and not far.gradient(state).any()
        assert near.value(state) == pytest.approx(-0.005)
        motion = state.frame("tool").jacobian()[:3] @ near.gradient(state)
        assert motion[2] > 0.0
    on_it = Clearance("tool", point=tool)
    assert not on_it.gradient(state).any()


# ---- the task
def solved(task: ProjectedGradient, velocity: Vec, q: Vec, *limits: Any) -> tuple[Any, Any]:
    """The tool at ``velocity`` [m/s] as a constraint, the criterion below it; the command and the state."""
    state = at(ARM, q)
    here = np.array(state.frame("tool").position)
    along = Position("tool", target=lambda t: (here + t * velocity, velocity, np.zeros(3)), rate=0.0).exactly()
    stack = wbc.Stack([task], subject_to=[along, *limits])
    controller = wbc.Controller(ARM, stack, level=wbc.VelocityLevel(regularisation=1e-12), solver="daqp")
    command = controller.tick(0.0, q, np.zeros(7))
    assert command.status.ok
    return command, state


@given(seed=st.integers(0, 9999), gain=st.floats(0.1, 5.0))
def test_without_active_limits_it_is_the_closed_form(seed: int, gain: float):
    """Property 13."""
    rng = np.random.default_rng(seed)
    velocity, q = 0.1 * rng.normal(size=3), ARM.random_configuration(rng)
    criterion = Manipulability("tool")
    criterion.prepare(ARM)
    command, state = solved(ProjectedGradient(criterion, gain=gain), velocity, q)
    J = state.frame("tool").jacobian()[:3]
    J_pinv = np.linalg.pinv(J)
    expected = J_pinv @ velocity + gain * (np.eye(7) - J_pinv @ J) @ criterion.gradient(state)
    np.testing.assert_allclose(command.v, expected, atol=1e-7 * (1 + np.abs(expected).max()))


@given(seed=st.integers(0, 9999))
def test_bounds_hold_and_the_task_with_them(seed: int):
    rng = np.random.default_rng(seed)
    q = ARM.q0 + 0.2 * rng.normal(size=7)
    velocity = 0.02 * rng.normal(size=3)
    slow, task = JointVelocityLimits(0.3), ProjectedGradient(MidRange(), gain=500.0)
    free, _ = solved(task, velocity, q)
    command, state = solved(task, velocity, q, slow, JointPositionLimits())
    assert (np.abs(command.v) <= 0.3 + 1e-8).all()
    assert np.isclose(np.abs(command.v), 0.3).any() == (np.abs(free.v) > 0.3).any()
    np.testing.assert_allclose(state.frame("tool").jacobian()[:3] @ command.v, velocity, atol=1e-8)


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()])
def test_the_criterion_rises_while_the_tool_stays(level: Any):
    criterion = Manipulability("tool")
    q = np.array([0.0, 0.3, 0.5, 0.5, 0.0, 1.8, 0.0])
    here = np.array(at(ARM, q).frame("tool").position)
    stack = wbc.Stack(
        [ProjectedGradient(criterion, gain=20.0)],
        subject_to=[Position("tool", target=here, kp=400).exactly(), JointVelocityLimits(), JointPositionLimits()],
    )
    way = [q, *(q for q, _ in obeyed(wbc.Controller(ARM, stack, level=level, dt=5e-3), 200, q))]
    values = [criterion.value(at(ARM, q)) for q in way]
    assert values[-1] > 1.05 * values[0]
    assert (np.diff(values) > -1e-5).all()
    assert np.linalg.norm(at(ARM, way[-1]).frame("tool").position - here) < 5e-3


def test_ranges_that_are_none_are_refused():
    limits, endless = ARM.limits, np.full(7, np.inf)
    with pytest.raises(InvalidInput, match="no joint of arm has a range"):
        MidRange().prepare(ARM.replace(limits=replace(limits, q_max=endless)))
    with pytest.raises(InvalidInput, match="must not be empty"):
        MidRange().prepare(ARM.replace(limits=replace(limits, q_max=limits.q_min)))
