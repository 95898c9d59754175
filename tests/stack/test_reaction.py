"""What a mechanism forbids, its own forces forbid: the motors give what they would in coordinates of the mechanism."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given

import tasks as T
import wbc
from tests.tasks.mechanisms import omni_cart
from tests.tasks.rows_of import moment, rows
from wbc.models.model import RobotState
from wbc.testing import check_contact, moments, robots
from wbc.testing.strategies import states

ARM, _, HUMANOID = robots()
GEAR = T.JointCoupling("elbow", to={"shoulder_pitch": -1.5})
LEVELS = [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()]
each_level = pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)


@given(states(ARM))
def test_a_gear_with_one_motor_costs_what_it_does_in_its_own_coordinates(state: RobotState):
    """Virtual work: with v = G s the motors that are left give tau' = G' (M a + h)."""
    elbow, pitch = ARM.joint("elbow"), ARM.joint("shoulder_pitch")
    q, v = state.q.copy(), state.v.copy()
    q[elbow], v[elbow] = -1.5 * q[pitch], -1.5 * v[pitch]
    stack = wbc.Stack(
        [T.Posture(ARM.q0, kp=10)],
        contacts=[GEAR.with_reaction(name="gear")],
        subject_to=[T.Torque(0.0, joints=["elbow"], name="no motor").exactly()],
    )
    command = wbc.Controller(ARM, stack, level=wbc.InverseDynamics()).tick(0.0, q, v)
    here = moment(ARM, q, v)
    needed = here.M @ command.a + here.h
    G = np.delete(np.eye(7), elbow, axis=1)
    G[elbow, pitch] = -1.5
    assert abs(command.tau[elbow]) < 1e-7
    np.testing.assert_allclose(np.delete(command.tau, elbow), G.T @ needed, atol=1e-6)
    assert command.f["gear"][0] == pytest.approx(needed[elbow], abs=1e-6)


@given(states(ARM))
def test_a_brake_carries_what_the_motor_would_have_to(state: RobotState):
    joints = [ARM.joint_names[1]]
    tasks: list[Any] = [T.Posture(ARM.q0, kp=10)]
    braked = wbc.Stack(
        tasks,
        contacts=[T.FrozenJoints(joints).with_reaction(name="brake")],
        subject_to=[T.Torque(0.0, joints=joints, name="released").exactly()],
    )
    held = wbc.Stack(tasks, subject_to=[T.FrozenJoints(joints).exactly()])
    with_brake, with_motor = (
        wbc.Controller(ARM, stack, level=wbc.InverseDynamics()).tick(0.0, state.q, state.v) for stack in (braked, held)
    )
    np.testing.assert_allclose(with_brake.a, with_motor.a, atol=1e-5)
    assert with_brake.f["brake"][0] == pytest.approx(with_motor.tau[1], abs=1e-4)


def test_gains_of_what_a_force_holds_may_be_assigned_between_ticks():
    """At rest and off the coupling, its acceleration is kp e."""
    gear = T.JointCoupling("elbow", to={"shoulder_pitch": -1.5}, kp=100.0)
    stack = wbc.Stack([T.Posture(ARM.q0)], contacts=[gear.with_reaction(name="gear")])
    controller = wbc.Controller(ARM, stack, level=wbc.AccelerationLevel())
    elbow, pitch, found = ARM.joint("elbow"), ARM.joint("shoulder_pitch"), []
    for k, kp in enumerate((100.0, 25.0)):
        gear.kp = kp
        a = controller.tick(1e-3 * k, ARM.q0, np.zeros(ARM.nv)).a
        found.append(a[elbow] + 1.5 * a[pitch])
    assert abs(found[0]) > 1.0
    assert found[1] == pytest.approx(found[0] / 4.0)


def test_wheels_carry_a_cart_and_drive_it(tmp_path: Any):
    """Four mecanum wheels: G' (M a + h) = G' S' tau along the three ways the cart can go; the ground carries it."""
    robot = omni_cart(tmp_path)
    rollers = {name: (1.0 if name in ("front_left", "rear_right") else -1.0) * np.pi / 4 for name in robot.joint_names}
    wheels = [
        T.OmniWheel(f"{name}_wheel", radius=0.1, roller=roller, ground=0.0).with_reaction()
        for name, roller in rollers.items()
    ]
    q = np.array(robot.q0)
    q[:7] = [0.0, 0.0, 0.1, 0.0, 0.0, np.sin(0.3), np.cos(0.3)]
    stack = wbc.Stack([T.JointVelocity([2.0, 1.0, 1.0, 2.0], kd=5.0), T.Damping(weight=1e-6)], contacts=wheels)
    command = wbc.Controller(robot, stack, level=wbc.InverseDynamics()).tick(0.0, q, np.zeros(robot.nv))
    assert command.status.ok
    state = moment(robot, q)
    J = np.vstack([rows(wheel.task, state).J for wheel in wheels])
    G = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, tol=1e-8) :].T
    assert G.shape[1] == 3
    needed = state.M @ command.a + state.h
    np.testing.assert_allclose(G.T @ needed, G[6:].T @ command.tau, atol=1e-5)
    assert np.abs(command.tau).max() > 1e-2
    heights = [command.f[wheel.name][1] for wheel in wheels]
    assert sum(heights) == pytest.approx(robot.mass * 9.81, abs=1e-4)


@each_level
def test_a_reaction_is_kept_at_every_level_and_follows_a_target(level: Any):
    tool = ARM.frame_names[-1]
    start = moment(ARM, moments(ARM, count=1, seed=3)[0][1])
    rail = T.Position(
        tool, axes="z", target=T.Sinusoid(start.frame(tool).position[2:], amplitude=0.03, frequency=0.5, ramp=1.0)
    )
    stack = wbc.Stack([T.Damping(weight=1e-2)], contacts=[rail.with_reaction(name="rail")])
    controller = wbc.Controller(ARM, stack, level=level, dt=1e-3)
    q, v = start.q.copy(), np.zeros(7)
    for tick in range(800):
        command = controller.tick(1e-3 * tick, q, v)
        q, v = command.q, command.v
    end = moment(ARM, q, t=0.8)
    assert abs(rows(rail, end).e[0]) < 1e-4
    assert abs(end.frame(tool).position[2] - start.frame(tool).position[2]) > 0.01


def test_rows_and_forces_carry_the_names_and_units_of_the_task():
    stack = wbc.Stack([T.Posture(ARM.q0)], contacts=[GEAR.with_reaction(name="gear")])
    names = [str(row) for row in wbc.Controller(ARM, stack, level=wbc.InverseDynamics()).plan.problem.rows]
    assert any("contact[gear]" in name for name in names) and any("force[gear]" in name for name in names)
    reaction = GEAR.with_reaction()
    reaction.prepare(ARM)
    assert reaction.force_labels() == [("elbow", "N m")] and reaction.motion_units() == ["rad"]
    check_contact(reaction, ARM)


def test_mimic_joints_are_gears_with_the_numbers_of_the_file(tmp_path: Any):
    joint = (
        '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/>{more}</joint>'
    )
    link = (
        '<link name="{}"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    text = "".join(link.format(name) for name in ("palm", "finger", "thumb"))
    text += joint.format(name="grip", parent="palm", child="finger", more="")
    mimic = '<mimic joint="grip" multiplier="-0.5" offset="0.1"/>'
    text += joint.format(name="oppose", parent="palm", child="thumb", more=mimic)
    (tmp_path / "hand.urdf").write_text(f'<robot name="hand">{text}</robot>')
    with pytest.warns(UserWarning, match="'oppose' mimics 'grip'"):
        robot = wbc.load(str(tmp_path / "hand.urdf"))
    (gear,) = T.mimic_joints(robot, kp=25.0)
    assert gear.name == "JointCoupling[oppose]" and gear.ratios == {"grip": -0.5} and gear.offset == 0.1
    stack = wbc.Stack([T.Posture([0.3, 0.0])], subject_to=[gear.exactly()])
    v = wbc.Controller(robot, stack, level=wbc.VelocityLevel()).tick(0.0, np.array([0.2, 0.0]), np.zeros(2)).v
    assert v[1] == pytest.approx(-0.5 * v[0], abs=1e-6)  # 0.1 - 0.5 · 0.2 = 0: it is where it should be
