"""What ``wbc soak`` runs: an arm, a quadruped and a humanoid with limits on everything."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import numpy as np

import wbc
from wbc.models import load
from wbc.sim.soak import Subject

from ..com import CenterOfMass
from ..feet import feet
from ..limits.joint_acceleration import JointAccelerationLimits
from ..limits.joint_position import JointPositionLimits
from ..limits.joint_velocity import JointVelocityLimits
from ..limits.torque import TorqueLimits
from ..orientation import Orientation
from ..position import Position
from ..posture import Posture


@final
class ArmSoak(Subject):
    """The tool of an arm is sent to points in and out of reach."""

    def __init__(self, name: str, level: Any) -> None:
        self.name, self._level = name, level
        self.summary = f"an arm at the {level.name}: points in and out of reach"

    def controller(self, solver: str) -> wbc.Controller:
        robot = load("arm")
        limits: list[Any] = [JointPositionLimits(), JointVelocityLimits(2.0), JointAccelerationLimits(20.0)]
        if self._level.dynamics:
            limits.append(TorqueLimits())
        tasks = [Position("tool", target=[0.4, 0.2, 0.5], kp=100.0), Posture(robot.q0, kp=10.0, weight=1e-2)]
        return wbc.Controller(robot, wbc.Stack(tasks, subject_to=limits), level=self._level, solver=solver)

    def stir(self, controller: wbc.Controller, rng: np.random.Generator) -> None:
        reach, posture = controller.stack.tasks
        far = 3.0 if rng.uniform() < 0.2 else 0.7
        reach.target = rng.uniform(-far, far, 3)  # type: ignore[attr-defined]
        reach.weight, posture.weight = 10.0 ** rng.uniform(-1, 2), 10.0 ** rng.uniform(-3, 0)


@final
class LegSoak(Subject):
    """The centre of mass of a robot that stands is sent about, now and then to the edge of its feet."""

    def __init__(self, name: str, robot: str) -> None:
        self.name, self._robot = name, robot
        self.summary = f"a {robot} on its feet, inverse dynamics: sways, some of them wide"

    def controller(self, solver: str) -> wbc.Controller:
        robot = load(self._robot)
        limits = [JointPositionLimits(), JointVelocityLimits(), TorqueLimits()]
        tasks = [
            CenterOfMass(target=robot.state().com.copy(), kp=50.0),
            Orientation(robot.frame_names[0], target=np.eye(3), kp=100.0, weight=0.1),
            Posture(robot.q0, kp=20.0, weight=1e-1),
        ]
        stack = wbc.Stack(tasks, contacts=feet(robot), subject_to=limits)
        return wbc.Controller(robot, stack, level=wbc.InverseDynamics(), solver=solver)

    def stir(self, controller: wbc.Controller, rng: np.random.Generator) -> None:
        sway, _, posture = controller.stack.tasks
        home = controller.model.state().com
        far = 0.06 if rng.uniform() < 0.1 else 0.03
        sway.target = home + rng.uniform(-far, far, 3) * (1.0, 1.0, 0.5)  # type: ignore[attr-defined]
        posture.weight = 10.0 ** rng.uniform(-2, 0)


SOAKS: Mapping[str, Subject] = {
    subject.name: subject
    for subject in (
        ArmSoak("arm-velocity", wbc.VelocityLevel()),
        ArmSoak("arm-acceleration", wbc.AccelerationLevel()),
        ArmSoak("arm-torque", wbc.InverseDynamics()),
        LegSoak("quadruped", "quadruped"),
        LegSoak("humanoid", "humanoid"),
    )
}
