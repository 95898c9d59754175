"""Scaling: one quantity of a problem grows while the others stay. ``wbc report scaling`` measures and draws it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from wbc.models.model import RobotModel
from wbc.report.scaling.axis import Axis, Problem
from wbc.stack.formulation import InverseDynamics, VelocityLevel
from wbc.stack.stack import Stack

from ..limits.joint_velocity import JointVelocityLimits
from ..limits.torque import TorqueLimits
from ..point import Point
from ..position import Position
from ..posture import Posture
from .chains import EFFORT, chain, many_legs

#: A chain on which tasks are counted; one on which torque limits are; legs that may stand.
TASKS_ON, LIMITS_ON, LEGS = 40, 60, 8


def _ahead(robot: RobotModel, frame: str) -> Position:
    """Keep the frame's place a little off from where it is."""
    return Position(frame, target=robot.state().frame(frame).position + 0.05, kp=100)


def _chain_torques(joints: int) -> Problem:
    robot = chain(joints)
    stack = Stack(
        [_ahead(robot, f"link{joints}"), Posture(robot.q0, kp=25, weight=1e-3)],
        subject_to=[TorqueLimits(), JointVelocityLimits()],
    )
    return Problem(robot, stack, InverseDynamics())


def _chain_velocities(joints: int) -> Problem:
    robot = chain(joints)
    stack = Stack(
        [_ahead(robot, f"link{joints}"), Posture(robot.q0, kp=25, weight=1e-3)], subject_to=[JointVelocityLimits()]
    )
    return Problem(robot, stack, VelocityLevel())


def _tasks(count: int) -> Problem:
    robot = chain(TASKS_ON)
    frames = [f"link{round(i)}" for i in np.linspace(TASKS_ON, 4, count)]
    stack = Stack(
        [*(_ahead(robot, frame) for frame in frames), Posture(robot.q0, kp=25, weight=1e-3)],
        subject_to=[TorqueLimits(), JointVelocityLimits()],
    )
    return Problem(robot, stack, InverseDynamics())


def _contacts(count: int) -> Problem:
    robot = many_legs(LEGS)
    stack = Stack(
        [_ahead(robot, "body"), Posture(robot.q0, kp=25, weight=1e-2)],
        contacts=[Point(f"foot{i}", friction=0.7, friction_model="outer") for i in range(count)],
        subject_to=[TorqueLimits(), JointVelocityLimits()],
    )
    return Problem(robot, stack, InverseDynamics())


def _active(count: int) -> Problem:
    """The last joints of a chain, which carry least, may push with a hundredth of what their posture asks for."""
    robot = chain(LIMITS_ON)
    weak = np.full(robot.nj, EFFORT)
    weak[robot.nj - count :] = 1e-3
    stack = Stack(
        [_ahead(robot, f"link{LIMITS_ON // 3}"), Posture(robot.q0 + 0.5, kp=100, weight=1e-3)],
        subject_to=[TorqueLimits(weak)],
    )
    return Problem(robot, stack, InverseDynamics())


AXES: Mapping[str, Axis] = {
    axis.name: axis
    for axis in (
        Axis("joints", "joints of a chain, inverse dynamics", (7, 14, 28, 56, 80, 112), _chain_torques),
        Axis(
            "joints, velocity level", "joints of a chain, velocity level", (7, 14, 28, 56, 80, 112), _chain_velocities
        ),
        Axis("tasks", f"tasks of three rows on {TASKS_ON} joints", (1, 2, 5, 10, 20, 30), _tasks),
        Axis("contacts", f"point contacts of a body on {LEGS} legs", (0, 1, 2, 3, 4, 6, 8), _contacts),
        Axis("active rows", f"torque limits that hold, on {LIMITS_ON} joints", (0, 5, 10, 20, 30, 40), _active),
    )
}
