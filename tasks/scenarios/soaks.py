"""What ``wbc soak`` runs: an arm, a quadruped and a humanoid with limits on everything."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.models import load
from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import Parameters, Scenario, Setup
from wbc.stack.formulation import Formulation

from ..com import CenterOfMass
from ..feet import feet
from ..limits.joint_acceleration import JointAccelerationLimits
from ..limits.joint_position import JointPositionLimits
from ..limits.joint_velocity import JointVelocityLimits
from ..limits.torque import TorqueLimits
from ..orientation import Orientation
from ..position import Position
from ..posture import Posture
from ..workloads.workload import Certified


class ArmSoak(Certified):
    """The tool of an arm is sent to points in and out of reach."""

    group: ClassVar[str] = "soaks"
    level: ClassVar[Formulation]

    def build(self, p: Parameters) -> Setup:
        robot = load("arm")
        limits: list[Any] = [JointPositionLimits(), JointVelocityLimits(2.0), JointAccelerationLimits(20.0)]
        if self.level.dynamics:
            limits.append(TorqueLimits())
        tasks = [Position("tool", target=[0.4, 0.2, 0.5], kp=100.0), Posture(robot.q0, kp=10.0, weight=1e-2)]
        plant = IntegratorPlant(robot, level="velocity" if self.level.order == 1 else "acceleration")
        return Setup(stack=wbc.Stack(tasks, subject_to=limits), plant=plant, level=self.level)

    def stir(self, controller: wbc.Controller, rng: np.random.Generator) -> None:
        reach, posture = controller.stack.tasks
        far = 3.0 if rng.uniform() < 0.2 else 0.7
        reach.target = rng.uniform(-far, far, 3)  # type: ignore[attr-defined]
        reach.weight, posture.weight = 10.0 ** rng.uniform(-1, 2), 10.0 ** rng.uniform(-3, 0)


@final
class ArmVelocity(ArmSoak):
    """At the velocity level."""

    name: ClassVar[str] = "arm-velocity"
    summary: ClassVar[str] = "an arm at the velocity level: points in and out of reach"
    level = wbc.VelocityLevel()


@final
class ArmAcceleration(ArmSoak):
    """At the acceleration level."""

    name: ClassVar[str] = "arm-acceleration"
    summary: ClassVar[str] = "an arm at the acceleration level: points in and out of reach"
    level = wbc.AccelerationLevel()


@final
class ArmTorque(ArmSoak):
    """By inverse dynamics."""

    name: ClassVar[str] = "arm-torque"
    summary: ClassVar[str] = "an arm, inverse dynamics: points in and out of reach"
    level = wbc.InverseDynamics()


class LegSoak(Certified):
    """The centre of mass of a robot that stands is sent about, now and then to the edge of its feet."""

    group: ClassVar[str] = "soaks"

    def build(self, p: Parameters) -> Setup:
        robot = load(self.name)
        limits = [JointPositionLimits(), JointVelocityLimits(), TorqueLimits()]
        tasks = [
            CenterOfMass(target=robot.state().com.copy(), kp=50.0),
            Orientation(robot.frame_names[0], target=np.eye(3), kp=100.0, weight=0.1),
            Posture(robot.q0, kp=20.0, weight=1e-1),
        ]
        stack = wbc.Stack(tasks, contacts=feet(robot), subject_to=limits)
        return Setup(stack=stack, plant=IntegratorPlant(robot))

    def stir(self, controller: wbc.Controller, rng: np.random.Generator) -> None:
        sway, _, posture = controller.stack.tasks
        home = controller.model.state().com
        far = 0.06 if rng.uniform() < 0.1 else 0.03
        sway.target = home + rng.uniform(-far, far, 3) * (1.0, 1.0, 0.5)  # type: ignore[attr-defined]
        posture.weight = 10.0 ** rng.uniform(-2, 0)


@final
class Quadruped(LegSoak):
    """On its points."""

    name: ClassVar[str] = "quadruped"
    summary: ClassVar[str] = "a quadruped on its feet, inverse dynamics: sways, some of them wide"


@final
class Humanoid(LegSoak):
    """On its soles."""

    name: ClassVar[str] = "humanoid"
    summary: ClassVar[str] = "a humanoid on its feet, inverse dynamics: sways, some of them wide"


SOAKS: Mapping[str, Scenario] = {
    soak.name: soak for soak in (ArmVelocity(), ArmAcceleration(), ArmTorque(), Quadruped(), Humanoid())
}
