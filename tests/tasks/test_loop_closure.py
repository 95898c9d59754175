"""A closed loop: the joint that the tree has not, its reaction, and the same mechanism in its own coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks import LoopClosure, Posture, Torque, feet
from tests.stack.conftest import moving, standing
from tests.tasks.mechanisms import four_bar
from tests.tasks.rows_of import moment
from wbc.models.model import RobotModel
from wbc.stack.component import Schedule
from wbc.stack.task_rows import TaskRows
from wbc.testing import robots
from wbc.types import Mat, Vec

HUMANOID = robots()[2]


@pytest.fixture(scope="module")
def linkage(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return four_bar(tmp_path_factory.mktemp("linkage"))


def closing(**more: Any) -> LoopClosure:
    return LoopClosure("rod_end", to="rocker_end", rows=["x", "z"], target=[0, 0, 0], **more)


def loop_rows(robot: RobotModel, q: Vec, v: Vec) -> TaskRows:
    """How far the loop is open, its Jacobian and its drift."""
    loop = closing()
    return loop.rows(moment(robot, q, v), loop.target)


def closed(robot: RobotModel, crank: float) -> Vec:
    """The configuration at a crank angle: where the circles of rod and rocker meet, above the ground."""
    crank_end, pivot = 0.2 * np.array([np.cos(crank), -np.sin(crank)]), np.array([0.4, 0.0])
    apart = pivot - crank_end
    length = float(np.linalg.norm(apart))
    along = (0.45**2 - 0.3**2 + length**2) / (2.0 * length)
    up = np.array([-apart[1], apart[0]]) / length * np.sqrt(0.45**2 - along**2)
    end = crank_end + along * apart / length + up
    rod, rocker = (np.arctan2(-d[1], d[0]) for d in (end - crank_end, end - pivot))
    angles = {"crank_joint": crank, "rod_joint": rod - crank, "rocker_joint": rocker}
    q = np.array([angles[name] for name in robot.joint_names])
    assert np.abs(loop_rows(robot, q, np.zeros(3)).e).max() < 1e-12
    return q


def eliminated(robot: RobotModel, q: Vec, crank_speed: float) -> tuple[Mat, Vec, Vec]:
    """v = G s and a = G ṡ + γ for the crank's speed s: the coordinates of the mechanism, by hand."""
    crank, others = robot.joint("crank_joint"), [robot.joint("rod_joint"), robot.joint("rocker_joint")]
    J = loop_rows(robot, q, np.zeros(3)).J
    G = np.zeros(3)
    G[crank] = 1.0
    G[others] = np.linalg.solve(J[:, others], -J[:, crank])
    v = G * crank_speed
    gamma = np.zeros(3)
    gamma[others] = np.linalg.solve(J[:, others], -loop_rows(robot, q, v).drift)
    return G, v, gamma


@pytest.mark.parametrize("crank", [-0.6, 0.2, 1.0])
@pytest.mark.parametrize("speed", [0.0, 2.0])
def test_the_motor_torque_is_that_of_the_mechanism_in_its_own_coordinate(linkage: Any, crank: float, speed: float):
    q = closed(linkage, crank)
    G, v, gamma = eliminated(linkage, q, speed)
    state, motor = moment(linkage, q, v), linkage.joint("crank_joint")
    stack = wbc.Stack(
        [Posture(q, kp=0.0, kd=3.0, weight=1e6 * np.eye(3)[motor])],
        contacts=[closing()],
        subject_to=[Torque(0.0, joints=["rod_joint", "rocker_joint"], name="no motors").exactly()],
    )
    command = wbc.Controller(linkage, stack, level=wbc.InverseDynamics()).tick(0.0, q, v)
    assert command.status.ok
    a = G * (-3.0 * speed) + gamma
    np.testing.assert_allclose(command.a, a, atol=1e-6)
    assert command.tau[motor] == pytest.approx(G @ (state.M @ a + state.h), abs=1e-5)
    # The reaction is what is missing in every joint: M a + h = tau + J' f.
    out = loop_rows(linkage, q, v)
    force = command.f["rod_end"]
    np.testing.assert_allclose(state.M @ command.a + state.h, command.tau + out.J.T @ force, atol=1e-6)
    assert np.abs(np.delete(command.tau, motor)).max() < 1e-6


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()])
def test_a_loop_that_has_opened_closes_again(linkage: RobotModel, level: Any):
    q = closed(linkage, 0.3)
    q[linkage.joint("rocker_joint")] += 0.05
    controller = wbc.Controller(
        linkage, wbc.Stack([Posture(q, weight=1e-3)], contacts=[closing()]), level=level, dt=2e-3
    )
    v, opened = np.zeros(3), [np.abs(loop_rows(linkage, q, np.zeros(3)).e).max()]
    for tick in range(500):
        command = controller.tick(2e-3 * tick, q, v)
        q, v = command.q, command.v
        opened.append(np.abs(loop_rows(linkage, q, np.zeros(3)).e).max())
    # Critically damped with kp = 100, or e^(-5 t) at the velocity level: within one second to 1 %.
    assert opened[0] > 0.01 and opened[-1] < 0.01 * opened[0] and max(opened) < 1.01 * opened[0]


def test_a_bar_in_two_hands_pulls_both_alike_and_nothing_else():
    bar = LoopClosure("left_hand", to="right_hand", rows=["x", "y", "z", "rx", "ry", "rz"], name="bar")
    stack = standing(HUMANOID)
    carrying = wbc.Stack(stack.levels, contacts=[*stack.contacts, bar], subject_to=[*stack.subject_to])
    q, v = moving(HUMANOID, seed=1)
    controller = wbc.Controller(HUMANOID, carrying, level=wbc.InverseDynamics())
    command = controller.tick(0.0, q, v)
    assert command.status.ok and command.f["bar"].shape == (6,)
    state = moment(HUMANOID, q, v)
    weight = (
        sum(state.frame(c.frame).rotation @ command.f[c.frame][:3] for c in stack.contacts)
        + HUMANOID.mass * HUMANOID.gravity
    )
    # Newton: the bar is inside the robot and accelerates none of its mass as a whole.
    np.testing.assert_allclose(weight, HUMANOID.mass * (state.com_jacobian @ command.a + state.com_drift), atol=1e-5)


def test_a_schedule_that_lets_feet_go_keeps_loops_closed():
    class Standing(Schedule):
        def contact_sets(self) -> list[list[str]]:
            return [["left_sole"]]

        def contacts(self, state: Any, last: object) -> list[str]:
            return ["left_sole"]

    bar = LoopClosure("left_hand", to="right_hand", name="bar")
    stack = wbc.Stack([Posture(HUMANOID.q0)], contacts=[*feet(HUMANOID), bar], components=[Standing()])
    v = 0.1 * np.sin(np.arange(HUMANOID.nv))
    command = wbc.Controller(HUMANOID, stack, level=wbc.InverseDynamics()).tick(0.0, HUMANOID.q0, v)
    rows = bar.rows(moment(HUMANOID, HUMANOID.q0, v))
    np.testing.assert_allclose(rows.J @ command.a + rows.drift, -bar.kd * rows.J @ v, atol=1e-6)
    assert not command.f["right_sole"].any() and command.f["bar"].shape == (3,)
