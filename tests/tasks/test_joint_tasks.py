"""Tasks on joints: gears against eliminated coordinates, locks, energy, smoothness, singular postures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given

import tasks as T
import wbc
from tests.tasks.rows_of import finite, moment, rows
from tests.tasks.running import obeyed
from wbc.models.model import RobotState
from wbc.testing import check_task, moments, robots
from wbc.testing.strategies import states

ROBOTS = robots()
ARM, _, HUMANOID = ROBOTS
TOOL = ARM.frame_names[-1]
LEVELS = [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()]
each_level = pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)


@pytest.mark.parametrize("level", LEVELS[:2], ids=lambda level: level.name)
@given(state=states(ARM))
def test_geared_joints_do_what_the_robot_without_them_would(level: Any, state: RobotState):
    """v = G s + v_0 on the coordinates that are left, s by least squares: the gear as a constraint gives the same."""
    joint, other, ratio = 2, 0, -1.5
    gear = T.JointCoupling(ARM.joint_names[joint], to={ARM.joint_names[other]: ratio})
    tasks = [T.Frame(TOOL, target=np.eye(4), weight=2.0), T.Posture(ARM.q0, weight=0.1)]
    stack = wbc.Stack(tasks, subject_to=[gear.exactly()])
    command = wbc.Controller(ARM, stack, level=level).tick(0.0, state.q, state.v)
    found = command.v if level.order == 1 else command.a

    def wanted(task: Any) -> tuple[np.ndarray, np.ndarray]:
        out = rows(task, state)
        J = np.eye(7) if task.on_joints else out.J
        if level.order == 1:
            return J, out.rate_ref + 5.0 * out.e
        return J, out.acc_ref + 20.0 * (out.rate_ref - J @ state.v) + 100.0 * out.e - out.drift

    G = np.delete(np.eye(7), joint, axis=1)
    G[joint, other] = ratio
    particular = np.zeros(7)
    particular[joint] = wanted(gear)[1][0]
    weighted = [(np.sqrt(w) * J, np.sqrt(w) * y) for w, (J, y) in zip((2.0, 0.1), map(wanted, tasks), strict=True)]
    A, b = np.vstack([J for J, _ in weighted]), np.concatenate([y for _, y in weighted])
    s = np.linalg.lstsq(A @ G, b - A @ particular, rcond=None)[0]
    np.testing.assert_allclose(found, G @ s + particular, atol=1e-5 * (1.0 + np.abs(found).max()))


@each_level
def test_a_gear_that_slipped_comes_back_and_stays(level: Any):
    gear = T.JointCoupling("elbow", to={"shoulder_pitch": -2.0}, offset=0.1)
    stack = wbc.Stack([T.Posture(ARM.q0, kp=4.0, weight=1e-2)], subject_to=[gear.exactly()])
    *_, (q, _) = obeyed(wbc.Controller(ARM, stack, level=level, dt=5e-3), 300)
    assert abs(rows(gear, moment(ARM, q)).e[0]) < 1e-3 * abs(rows(gear, ARM.state()).e[0])


@each_level
def test_a_lock_is_a_joint_that_does_not_move_at_any_level(level: Any):
    names = list(ARM.joint_names[1:3])
    stack = wbc.Stack([T.Posture(ARM.q0 + 0.3)], subject_to=[T.FrozenJoints(names).exactly()])
    command = wbc.Controller(ARM, stack, level=level).tick(0.0, ARM.q0, np.zeros(7))
    assert np.abs(command.v[1:3]).max() < 1e-9 and np.abs(command.v[3:]).min() > 0.0


@given(states(HUMANOID))
def test_kinetic_energy_is_half_the_square_of_its_rows(state: RobotState):
    Jv = rows(T.KineticEnergy(), state).J @ state.v
    assert 0.5 * Jv @ Jv == pytest.approx(0.5 * state.v @ state.M @ state.v, rel=1e-9)


@given(states(ARM))
def test_kinetic_energy_alone_decays_at_twice_its_gain(state: RobotState):
    stack = wbc.Stack([T.KineticEnergy(kd=4.0)])
    a = wbc.Controller(ARM, stack, level=wbc.AccelerationLevel()).tick(0.0, state.q, state.v).a
    v = state.v
    energy = 0.5 * v @ state.M @ v
    assert v @ state.M @ a + v @ state.coriolis @ v == pytest.approx(-8.0 * energy, rel=1e-5)


def test_of_two_ways_to_a_velocity_the_light_one_is_taken():
    """min v' M v subject to J v = y is the inertia-weighted pseudo-inverse."""
    state = moment(ARM, *moments(ARM, count=1)[0][1:])
    task = T.Frame(TOOL, target=np.eye(4))
    out = rows(task, state)
    y = 5.0 * out.e
    stack = wbc.Stack([T.KineticEnergy()], subject_to=[task.exactly()])
    v = wbc.Controller(ARM, stack, level=LEVELS[0]).tick(0.0, state.q, state.v).v
    by_inertia = np.linalg.solve(state.M, out.J.T)
    np.testing.assert_allclose(v, by_inertia @ np.linalg.solve(out.J @ by_inertia, y), atol=1e-5)


def test_low_acceleration_goes_on_as_it_was():
    _, q, v = moments(ARM, count=1)[0]
    stack = wbc.Stack([T.LowAcceleration()])
    assert np.abs(wbc.Controller(ARM, stack, level=LEVELS[0]).tick(0.0, q, v).v - v).max() < 1e-6
    assert np.abs(wbc.Controller(ARM, stack, level=LEVELS[1]).tick(0.0, q, v).a).max() < 1e-9


@given(states(ARM))
def test_manipulability_is_that_of_the_criterion_but_for_its_smoothing(state: RobotState):
    value = 1.0 - rows(T.ManipulabilityTask(TOOL, target=1.0, smoothing=1e-6), state).e[0]
    criterion = T.Manipulability(TOOL)
    criterion.prepare(ARM)
    assert value == pytest.approx(criterion.value(state), abs=1e-6)


@pytest.mark.parametrize("smoothing", [1e-3, 1e-1])
def test_at_a_singular_posture_manipulability_is_smooth(smoothing: float):
    straight = np.zeros(7)  # the arm stretched out: it cannot reach further
    task = T.ManipulabilityTask(TOOL, target=0.1, rows=["x", "y", "z"], smoothing=smoothing)
    state = moment(ARM, straight, np.ones(7))
    J = state.frame(TOOL).jacobian()[:3]
    assert np.linalg.svd(J, compute_uv=False)[-1] < 1e-9
    assert finite(rows(task, state))
    if smoothing > 1e-2:
        check_task(task, ARM, [(0.0, straight, np.ones(7)), (0.1, straight + 1e-3, np.ones(7))])


def test_an_arm_bends_to_the_manipulability_it_is_asked_for():
    task = T.ManipulabilityTask(TOOL, target=0.1, kp=25.0)
    stack = wbc.Stack([task, T.Posture(ARM.q0, weight=1e-6)])
    for level in LEVELS[:2]:
        *_, (q, _) = obeyed(wbc.Controller(ARM, stack, level=level, dt=0.01), 300)
        assert abs(rows(task, moment(ARM, q)).e[0]) < 1e-3
