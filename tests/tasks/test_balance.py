"""Momentum, zero moment point, capture point and internal forces: against the forces that make them."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import (
    CapturePoint,
    CenterOfMass,
    CenterOfPressure,
    CentroidalMomentum,
    InternalForce,
    Orientation,
    Posture,
    TorqueLimits,
    ZeroMomentPoint,
    feet,
)
from tests.stack.conftest import moving, standing
from tests.tasks.rows_of import linear_rows, moment
from tests.tasks.running import obeyed
from wbc.models.model import RobotState
from wbc.testing import robots
from wbc.testing.strategies import states
from wbc.types import Vec

_, QUADRUPED, HUMANOID = robots()
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


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel()], ids=lambda level: level.name)
def test_a_robot_in_flight_takes_the_momentum_it_is_asked_for(level: Any):
    target = np.array([3.0, -2.0, 1.0, 0.5, 0.4, -0.3])
    task = CentroidalMomentum(target=target, kd=20.0)
    controller = wbc.Controller(HUMANOID, wbc.Stack([task, Posture(HUMANOID.q0, weight=1e-8)]), level=level, dt=0.01)
    *_, (q, v) = obeyed(controller, 100)
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


# ---- contacts press against one another, and nothing moves for it
POINTS = feet(QUADRUPED)


def tick(robot: Any, q: Vec, v: Vec, *tasks: Any, contacts: Any = None) -> Any:
    state = robot.state()
    upright = robot.frame_names[0]
    stack = wbc.Stack(
        [
            CenterOfMass(target=state.com), Orientation(upright, target=np.eye(3)), Posture(robot.q0, weight=1e-3),
            *tasks,
        ],
        contacts=contacts or feet(robot), subject_to=[TorqueLimits()],
    )  # fmt: skip
    return wbc.Controller(robot, stack, level=wbc.InverseDynamics()).tick(0.0, q, v)


@given(states(QUADRUPED), st.lists(st.floats(-50, 50), min_size=3, max_size=3).map(np.array))
def test_a_force_that_is_the_same_everywhere_is_no_internal_force(state: Any, force: Vec) -> None:
    out = linear_rows(InternalForce(POINTS), state, 12)
    np.testing.assert_allclose(out.A @ np.tile(force, 4), 0.0, atol=1e-9)


@given(states(QUADRUPED), st.floats(-50, 50), st.sampled_from(list(combinations(range(4), 2))))
def test_a_bar_between_two_contacts_is_felt_as_what_it_presses_with(state: Any, press: float, pair: Any) -> None:
    first, second = pair
    p, q = (POINTS[i].anchor(state).position for i in pair)
    way = (q - p) / np.linalg.norm(q - p)
    out = linear_rows(InternalForce([POINTS[first], POINTS[second]]), state, 6)
    np.testing.assert_allclose(out.A @ np.concatenate([-press * way, press * way]), [press], atol=1e-9)


@given(st.integers(0, 5), st.floats(-6.0, 6.0))
def test_feet_press_as_hard_as_is_wished_and_nothing_moves_for_it(seed: int, press: float) -> None:
    q, v = moving(QUADRUPED, seed)
    task = InternalForce([POINTS[0], POINTS[3]], target=press, weight=1e3, name="squeeze")
    with_it, without = tick(QUADRUPED, q, v, task), tick(QUADRUPED, q, v)
    forces = np.concatenate([with_it.f[POINTS[0].name], with_it.f[POINTS[3].name]])
    got = (linear_rows(task, moment(QUADRUPED, q, v), 6).A @ forces).item()
    if with_it.solution.certificate.ok and not np.any(np.abs(with_it.solution.z) > 1e-6):  # no cone holds it back
        assert got == pytest.approx(press, abs=1e-2)
        np.testing.assert_allclose(with_it.a, without.a, atol=1e-3)


def test_the_squeeze_is_reached_where_friction_allows_it() -> None:
    rest = np.zeros(QUADRUPED.nv)
    task = InternalForce([POINTS[0], POINTS[3]], target=5.0, weight=1e3)
    command = tick(QUADRUPED, QUADRUPED.q0, rest, task)
    forces = np.concatenate([command.f[POINTS[0].name], command.f[POINTS[3].name]])
    assert (linear_rows(task, QUADRUPED.state(), 6).A @ forces).item() == pytest.approx(5.0, abs=1e-2)


# ---- mirrors
def mirrored(v: Vec) -> Vec:
    """A velocity or torque vector of our humanoid seen in the mirror y -> −y: left is right.

    The axes of its limbs are mirror images already; yaw in the middle turns round.
    """
    names = HUMANOID.joint_names
    result = np.concatenate([v[:6] * [1, -1, 1, -1, 1, -1] if len(v) == HUMANOID.nv else v[:0], np.zeros(len(names))])
    joints, first = v[-len(names) :], len(result) - len(names)
    for i, name in enumerate(names):
        other = name.replace("left", "*").replace("right", "left").replace("*", "right")
        result[first + i] = joints[names.index(other)] * (-1.0 if other == name and "yaw" in name else 1.0)
    return result


WRENCH = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


@given(st.integers(0, 2**32 - 1))
def test_what_is_done_in_the_mirror_is_the_mirror_of_what_is_done(seed: int) -> None:
    rng = np.random.default_rng(seed)
    step, v = 0.03 * rng.normal(size=(2, HUMANOID.nv))
    q, q_mirrored = (HUMANOID.integrate(HUMANOID.q0, x) for x in (step, mirrored(step)))
    one, other = tick(HUMANOID, q, v), tick(HUMANOID, q_mirrored, mirrored(v))
    assert one.status.ok and other.status.ok
    np.testing.assert_allclose(other.tau, mirrored(one.tau), atol=1e-5)
    np.testing.assert_allclose(other.f["left_sole"], WRENCH * one.f["right_sole"], atol=1e-4)


@given(st.integers(0, 2**32 - 1))
def test_a_symmetric_stance_gives_symmetric_forces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    step, v = ((x + mirrored(x)) / 2 for x in 0.03 * rng.normal(size=(2, HUMANOID.nv)))
    command = tick(HUMANOID, HUMANOID.integrate(HUMANOID.q0, step), v)
    assert command.status.ok
    np.testing.assert_allclose(command.f["left_sole"], WRENCH * command.f["right_sole"], atol=1e-5)
    np.testing.assert_allclose(command.tau, mirrored(command.tau), atol=1e-6)
