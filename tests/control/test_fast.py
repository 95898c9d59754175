"""Fast ticks are ticks: the same rows, bounds, answers and working sets as without compiled code, on any stack."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import (
    CenterOfMass,
    ContactForce,
    Damping,
    Frame,
    JointAccelerationLimits,
    JointPositionLimits,
    JointVelocity,
    JointVelocityLimits,
    Orientation,
    Point,
    Position,
    Posture,
    Sinusoid,
    Sole,
    TorqueLimits,
)  # fmt: skip
from tasks.motions import pose_motion, swing
from tests.stack.conftest import Saying
from wbc import AccelerationLevel, Controller, InverseDynamics, Stack, VelocityLevel
from wbc.models import Planar4P

ARM, HUMANOID, QUADRUPED = wbc.load("arm"), wbc.load("humanoid"), wbc.load("quadruped")
PATH = Sinusoid([0.4, 0.1, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9])
POSE = pose_motion(PATH, swing(np.eye(3), [1, 2, 3], angle=0.4, frequency=0.6))
SLOPE = pinocchio.exp3(np.array([0.3, -0.2, 0.1]))
LIMITS = [JointPositionLimits(), JointVelocityLimits(), JointAccelerationLimits(50.0)]


def reaching() -> Stack:
    return Stack(
        [
            Frame("tool", target=POSE, kp=200.0), Position("tool", target=[0.4, 0.2], axes="xz", weight=0.1),
            Orientation("tool", target=SLOPE, weight=[0.1, 0.2, 0.3]), Posture(ARM.q0, weight=1e-2),
            JointVelocity(np.zeros(ARM.nj), weight=1e-3), Damping(weight=1e-3),
        ],
        subject_to=LIMITS,
    )  # fmt: skip


def standing() -> Stack:
    soles = [f for f in HUMANOID.feet]
    sway = Sinusoid(HUMANOID.state().com, amplitude=0.02, frequency=0.5)
    return Stack(
        [CenterOfMass(target=sway, kp=100.0), Posture(HUMANOID.q0, kp=10.0, weight=1e-2)],
        subject_to=[TorqueLimits(), JointVelocityLimits()],
        contacts=[Sole(sole, half_size=(0.08, 0.04), friction=0.6, origin=(0.01, 0.0, -0.005)) for sole in soles],
    )


def on_points() -> Stack:
    feet = list(QUADRUPED.feet)
    contacts = [Point(feet[0], friction=0.7, radius=0.02), Point(feet[1], friction=0.7, axes=SLOPE)]
    contacts += [Point(foot, friction=0.7) for foot in feet[2:]]
    return Stack(
        [
            CenterOfMass(target=QUADRUPED.state().com, kp=100.0), Orientation(QUADRUPED.frame_names[0], kp=100.0),
            Posture(QUADRUPED.q0, weight=1e-3), ContactForce(feet[0], target=[0.0, 0.0, 20.0], weight=1e-4),
        ],
        subject_to=[TorqueLimits(), JointVelocityLimits()], contacts=contacts,
    )  # fmt: skip


def as_law() -> Stack:
    law = Position("tool", target=PATH, kp=50.0).exactly()
    return Stack([Posture(ARM.q0, weight=1.0)], subject_to=[law, *LIMITS, TorqueLimits()])


CASES: list[tuple[wbc.models.RobotModel, Callable[[], Stack], wbc.stack.formulation.Formulation]] = [
    (ARM, reaching, VelocityLevel()), (ARM, reaching, AccelerationLevel()), (ARM, reaching, InverseDynamics()),
    (HUMANOID, standing, InverseDynamics()), (QUADRUPED, on_points, InverseDynamics()),
    (ARM, as_law, InverseDynamics()),
]  # fmt: skip
NAMES = ["arm velocity", "arm acceleration", "arm torque", "humanoid", "quadruped", "law"]


def pull_of_constraints(controller):
    """What all constraints together push with, along each unknown of the standard form."""
    qp, (y, z, z_box) = controller._solver.standard_form(), controller._solver.multipliers()
    return qp.matrix.T @ np.concatenate([y, z]) + z_box


@pytest.mark.parametrize(("robot", "stack", "level"), CASES, ids=NAMES)
def test_a_closed_loop_is_the_same_to_1e_9_with_the_same_pushes(robot, stack, level):
    plain, fast = (Controller(robot, stack(), level=level, fast=fast) for fast in (False, True))
    q, v = np.array(robot.q0), np.zeros(robot.nv)
    rng = np.random.default_rng(1)
    for k in range(60):
        if k % 10 == 0:
            v = v + 0.3 * rng.normal(size=robot.nv)
        expected, command = plain.tick(1e-3 * k, q, v), fast.tick(1e-3 * k, q, v)
        assert command.status is expected.status is wbc.types.Status.SOLVED, (command, expected, plain.why, fast.why)
        for controller in (plain, fast):
            controller.plan.fill(controller.state)
            assert controller._solver.solve().ok
        a, b = plain.plan.problem, fast.plan.problem
        m, items = a.n_rows, a.first_row + a.n_rows
        np.testing.assert_allclose(b.G[:m], a.G[:m], rtol=0, atol=1e-9 * (1.0 + np.abs(a.G[:m]).max()))
        np.testing.assert_allclose(b.bounds[:, :items], a.bounds[:, :items], rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(b.centre, a.centre, rtol=0, atol=1e-9 * (1.0 + np.abs(a.centre).max()))
        np.testing.assert_allclose(b.x, a.x, rtol=0, atol=1e-9 * (1.0 + np.abs(a.x).max()))
        # A row that is just met may be held or not, and dependent rows share a push: the sum is the same.
        mine, other = pull_of_constraints(fast), pull_of_constraints(plain)
        np.testing.assert_allclose(mine, other, rtol=0, atol=1e-7 * (1.0 + np.abs(other).max()))
        assert command.certificate.ok
        q, v = expected.q, expected.v


@given(angle=st.floats(0.0, np.pi - 1e-6), axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3), near=st.booleans())
def test_rotation_errors_of_any_angle_are_pinocchios(angle, axis, near):
    from wbc.stack.compiled.geometry import log3, log6

    direction = np.array(axis) if np.linalg.norm(axis) > 1e-3 else np.array([1.0, 0.0, 0.0])
    direction /= np.linalg.norm(direction)
    R = pinocchio.exp3((np.pi - 1e-3 * angle if near else angle) * direction)
    w, e, p = np.zeros(3), np.zeros(6), np.array([0.3, -0.2, 0.1])
    log3(R, w)
    log6(R, p, np.zeros(3), e)
    assert np.linalg.norm(w) <= np.pi + 1e-12
    np.testing.assert_allclose(pinocchio.exp3(w), R, rtol=0, atol=1e-12)
    np.testing.assert_allclose(pinocchio.exp6(e).homogeneous, pinocchio.SE3(R, p).homogeneous, rtol=0, atol=1e-12)
    if not near:  # at π either way round is right
        np.testing.assert_allclose(w, pinocchio.log3(R), rtol=0, atol=1e-9)
        np.testing.assert_allclose(e, pinocchio.log6(pinocchio.SE3(R, p)).vector, rtol=0, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1e-4, 2e-3, 0.029, 0.031, 0.3])
def test_twists_of_small_angles_lose_no_digits(angle):
    from wbc.stack.compiled.geometry import log6

    pose, e = pinocchio.SE3(pinocchio.exp3(angle * np.array([0.6, 0.0, 0.8])), np.array([0.3, -0.2, 0.1])), np.zeros(6)
    log6(pose.rotation, pose.translation, np.zeros(3), e)
    np.testing.assert_allclose(pinocchio.exp6(e).homogeneous, pose.homogeneous, rtol=0, atol=2e-13)


@pytest.mark.parametrize("axis", [(4.0, 2.0, 3.0), (-1.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, -1.0, 1e-9)])
@pytest.mark.parametrize("short_of_pi", [0.0, 1e-16, 1e-12, 1e-9, 1e-3])
def test_half_a_turn_about_any_axis_is_read_from_its_rotation(axis, short_of_pi):
    from wbc.stack.compiled.geometry import log3

    R, w = pinocchio.exp3((np.pi - short_of_pi) * np.array(axis) / np.linalg.norm(axis)), np.zeros(3)
    log3(R, w)
    np.testing.assert_allclose(pinocchio.exp3(w), R, rtol=0, atol=1e-12)


def test_targets_weights_and_gains_that_are_assigned_are_read_at_the_next_tick():
    stacks = reaching(), reaching()
    plain, fast = (
        Controller(ARM, s, level=InverseDynamics(), fast=f) for s, f in zip(stacks, (False, True), strict=True)
    )
    q, v = np.array(ARM.q0), np.zeros(ARM.nv)
    for k in range(4):
        for tasks in (stack.tasks for stack in stacks):
            if k == 1:
                tasks[2].target, tasks[3].target = np.eye(3), 0.9 * ARM.q0
            if k == 2:
                tasks[0].weight, tasks[1].kp = 3.0, 7.0
            if k == 3:
                tasks[0].target = pinocchio.SE3(SLOPE, np.array([0.3, 0.0, 0.4]))  # no rates any more
        expected, command = plain.tick(1e-3 * k, q, v), fast.tick(1e-3 * k, q, v)
        np.testing.assert_allclose(command.tau, expected.tau, rtol=0, atol=1e-9 * (1.0 + np.abs(expected.tau).max()))


def test_a_task_of_ones_own_stays_python_and_is_called():
    called = []

    class Height(wbc.Task):
        def __init__(self):
            super().__init__(kp=100.0)
            self.dim, self.units = 1, "m"

        def fill(self, state, out):
            called.append(state.t)
            frame = state.frame("tool")
            out.J[:], out.e[:], out.drift[:] = frame.jacobian()[2:3], 0.6 - frame.position[2], frame.drift()[2:3]

    answers = []
    for fast in (False, True):
        stack = Stack([Height(), Posture(ARM.q0, weight=1e-2)], subject_to=LIMITS)
        controller = Controller(ARM, stack, level=AccelerationLevel(), fast=fast)
        called.clear()
        answers.append(controller.tick(0.5, ARM.q0, np.zeros(ARM.nv)).a)
        assert called == [0.5]
    np.testing.assert_allclose(answers[1], answers[0], rtol=0, atol=1e-9)


def test_limits_replaced_by_a_component_hold_in_fast_ticks():
    stack, saying = reaching(), Saying()
    stack = Stack(stack.levels, subject_to=stack.subject_to, components=[saying])
    controller = Controller(ARM, stack, level=AccelerationLevel(), fast=True)
    q, v = np.array(ARM.q0), np.zeros(ARM.nv)
    controller.tick(0.0, q, v)
    saying.now = wbc.Overrides(velocity=(-0.01, 0.01))
    assert np.abs(controller.tick(1e-3, q, v).v[ARM.nb :]).max() <= 0.01 + 1e-9


def test_forces_that_components_know_of_are_in_fast_ticks():
    class Load(wbc.Component):
        def before(self, state, last, plan):
            return wbc.Overrides(bias=np.arange(1.0, 1.0 + len(plan.extra_bias)))

    still, answers = np.zeros(ARM.nv), []
    for fast in (False, True):
        stack = Stack([Posture(ARM.q0)], subject_to=[TorqueLimits()], components=[Load()])
        answers.append(Controller(ARM, stack, level=InverseDynamics(), fast=fast).tick(0.0, ARM.q0, still).tau)
    np.testing.assert_allclose(answers[1], answers[0], rtol=0, atol=1e-9)
    bare = Controller(ARM, Stack([Posture(ARM.q0)]), level=InverseDynamics()).tick(0.0, ARM.q0, still).tau
    np.testing.assert_allclose(answers[1] - bare, np.arange(1.0, 1.0 + ARM.nv), rtol=0, atol=1e-9)


def test_a_robot_without_pinocchios_memory_has_its_tasks_called():
    robot = Planar4P()
    stack = Stack([Position("end_effector", target=[0.5, 0.2], axes="xy"), Posture(robot.q0, weight=1e-2)])
    plain, fast = (Controller(robot, stack, level=InverseDynamics(), fast=f) for f in (False, True))
    q, v = np.array([0.1, -0.2, 0.3, 0.1]), np.array([0.3, 0.1, -0.2, 0.4])
    np.testing.assert_allclose(fast.tick(0.0, q, v).tau, plain.tick(0.0, q, v).tau, rtol=0, atol=1e-9)


def test_another_solver_gets_the_same_rows():
    stack = reaching()
    controller = Controller(ARM, stack, level=InverseDynamics(), solver="daqp", fast=True)
    assert controller.form == "standard"
    assert controller.tick(0.0, ARM.q0, np.zeros(ARM.nv)).status.ok
