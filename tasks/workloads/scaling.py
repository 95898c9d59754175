"""Scaling: one quantity of a problem grows while the others stay. ``wbc report scaling`` measures and draws it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, final

import numpy as np

from wbc.models.model import RobotModel
from wbc.sim.plant import Drive, Plant
from wbc.sim.scenario import Parameter, Parameters, Setup
from wbc.stack.constraint import Constraint
from wbc.stack.formulation import Formulation, InverseDynamics, VelocityLevel
from wbc.stack.stack import Stack
from wbc.types import Vec

from ..limits.joint_velocity import JointVelocityLimits
from ..limits.torque import TorqueLimits
from ..point import Point
from ..position import Position
from ..posture import Posture
from .chains import EFFORT, chain, many_legs
from .workload import Certified

#: A chain on which tasks are counted; one on which torque limits are; legs that may stand.
TASKS_ON, LIMITS_ON, LEGS = 40, 60, 8


@final
class MovedPlant(Plant):
    """A robot that moves smoothly whatever it is told, so that every controller meets the same states: each joint on a
    sinusoid of 0.05 rad about the robot's reference, the base at rest."""

    takes = "position"

    def __init__(self, model: RobotModel) -> None:
        super().__init__(model, 1e-3)
        rng = np.random.default_rng(0)
        self._frequency, self._phase = rng.uniform(1.0, 5.0, model.nj), rng.uniform(0.0, 2.0 * np.pi, model.nj)
        self.reset(*self._at(0.0))

    def _at(self, t: float) -> tuple[Vec, Vec]:
        model, angle = self.model, self._frequency * t + self._phase
        q, v = np.array(model.q0), np.zeros(model.nv)
        q[model.nq - model.nj :] += 0.05 * np.sin(angle)
        v[model.nb :] = 0.05 * self._frequency * np.cos(angle)
        return q, v

    def _place(self, q: Vec, v: Vec) -> None:
        """The motion is one of time alone."""

    def _advance(self, command: Drive) -> tuple[Vec, Vec]:
        return self._at(self.t + self.dt)


class Growing(Certified):
    """A problem of this ``size``; everything else of it stays."""

    group: ClassVar[str] = "growth"
    takes = 5.0
    plants = ("moved",)
    duration = 0.1
    level: ClassVar[Formulation] = InverseDynamics()

    @abstractmethod
    def problem(self, size: int) -> tuple[RobotModel, Stack]:
        """The robot, and what it is to do."""

    def build(self, p: Parameters) -> Setup:
        robot, stack = self.problem(int(p.number("size", low=self.sizes[0])))
        return Setup(stack=stack, plant=MovedPlant(robot), level=self.level)


@final
class Joints(Growing):
    """A chain of ``size`` joints, whose end is to go on a little."""

    name: ClassVar[str] = "joints"
    summary: ClassVar[str] = "joints of a chain, inverse dynamics"
    parameters: ClassVar[Mapping[str, Parameter]] = {"size": 28}
    sizes = (7, 14, 28, 56, 80, 112)

    def problem(self, size: int) -> tuple[RobotModel, Stack]:
        return _chain(chain(size), [f"link{size}"], [TorqueLimits(), JointVelocityLimits()])


@final
class JointsOfVelocities(Growing):
    """The same chain at the velocity level."""

    name: ClassVar[str] = "joints, velocity level"
    summary: ClassVar[str] = "joints of a chain, velocity level"
    parameters = Joints.parameters
    sizes = Joints.sizes
    level = VelocityLevel()

    def problem(self, size: int) -> tuple[RobotModel, Stack]:
        return _chain(chain(size), [f"link{size}"], [JointVelocityLimits()])


@final
class Tasks(Growing):
    """``size`` links of one chain are to go on a little."""

    name: ClassVar[str] = "tasks"
    summary: ClassVar[str] = f"tasks of three rows on {TASKS_ON} joints"
    parameters: ClassVar[Mapping[str, Parameter]] = {"size": 10}
    sizes = (1, 2, 5, 10, 20, 30)

    def problem(self, size: int) -> tuple[RobotModel, Stack]:
        frames = [f"link{round(i)}" for i in np.linspace(TASKS_ON, 4, size)]
        return _chain(chain(TASKS_ON), frames, [TorqueLimits(), JointVelocityLimits()])


@final
class Contacts(Growing):
    """A body on legs, ``size`` of which stand."""

    name: ClassVar[str] = "contacts"
    summary: ClassVar[str] = f"point contacts of a body on {LEGS} legs"
    parameters: ClassVar[Mapping[str, Parameter]] = {"size": 4}
    sizes = (1, 2, 3, 4, 6, 8)

    def problem(self, size: int) -> tuple[RobotModel, Stack]:
        robot = many_legs(LEGS)
        feet = [Point(f"foot{i}", friction=0.7, friction_model="outer") for i in range(size)]
        tasks = [_ahead(robot, "body"), Posture(robot.q0, kp=25, weight=1e-2)]
        return robot, Stack(tasks, contacts=feet, subject_to=[TorqueLimits(), JointVelocityLimits()])


@final
class ActiveRows(Growing):
    """The last ``size`` joints of a chain, which carry least, may push with a hundredth of what their posture asks
    for."""

    name: ClassVar[str] = "active rows"
    summary: ClassVar[str] = f"torque limits that hold, on {LIMITS_ON} joints"
    parameters: ClassVar[Mapping[str, Parameter]] = {"size": 10}
    sizes = (0, 5, 10, 20, 30, 40)

    def problem(self, size: int) -> tuple[RobotModel, Stack]:
        robot = chain(LIMITS_ON)
        weak = np.full(robot.nj, EFFORT)
        weak[robot.nj - size :] = 1e-3
        tasks = [_ahead(robot, f"link{LIMITS_ON // 3}"), Posture(robot.q0 + 0.5, kp=100, weight=1e-3)]
        return robot, Stack(tasks, subject_to=[TorqueLimits(weak)])


def _ahead(robot: RobotModel, frame: str) -> Position:
    """Keep the frame's place a little off from where it is."""
    return Position(frame, target=robot.state().frame(frame).position + 0.05, kp=100)


def _chain(robot: RobotModel, frames: Sequence[str], limits: Sequence[Constraint]) -> tuple[RobotModel, Stack]:
    tasks = [*(_ahead(robot, frame) for frame in frames), Posture(robot.q0, kp=25, weight=1e-3)]
    return robot, Stack(tasks, subject_to=limits)


AXES: Mapping[str, Growing] = {
    axis.name: axis for axis in (Joints(), JointsOfVelocities(), Tasks(), Contacts(), ActiveRows())
}
