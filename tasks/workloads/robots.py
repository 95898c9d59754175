"""The robots of the workloads: made from the extra ``robots`` when they are needed, never stored.

Only what moves is kept of a robot description: links with their inertias, joints with their limits. Shapes,
transmissions and simulator settings are left out, and no joint mimics another. Inertias, limits and frames stay as
they are but for two robots: the fingers of the Panda are fixed, and the G1 may move at a tenth of its speed, so that
speed limits decide something.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal, final

import numpy as np
import pinocchio as pin

from wbc.models import load
from wbc.models.catalogue import example_robots
from wbc.models.model import RobotModel
from wbc.models.poses import read_poses
from wbc.types import Vec


@final
@dataclass(frozen=True, eq=False)
class RobotRecipe:
    """How to make one robot: a file of the robot data, what to change in it, and where it starts.

    ``start`` gives joint positions by name [rad], the others are 0; or the name of a group state of the file
    ``poses``. On a floating base the origin of ``ground`` starts at height 0.
    """

    name: str
    source: str
    base: Literal["fixed", "floating"]
    start: Mapping[str, float] | str
    fixed_joints: Sequence[str] = ()
    speed: float = 1.0
    poses: str = ""
    ground: str = ""

    def made(self) -> MadeRobot:
        """The robot, and its start; made once.

        Raises:
            ModelError: the extra ``robots`` is not installed.
        """
        return _made(self)

    def model(self) -> Any:
        """The robot as Pinocchio reads it from the file, changed.

        Raises:
            ModelError: the extra ``robots`` is not installed.
        """
        free = [pin.JointModelFreeFlyer()] if self.base == "floating" else []
        model = pin.buildModelFromUrdf(str(example_robots() / "robots" / self.source), *free)
        model = pin.buildReducedModel(model, [model.getJointId(j) for j in self.fixed_joints], pin.neutral(model))
        model.velocityLimit = self.speed * model.velocityLimit
        return model

    def start_of(self, robot: RobotModel) -> Vec:
        """The configuration that it starts from (nq,)."""
        if isinstance(self.start, Mapping):
            positions = self.start
        else:
            pose = read_poses(example_robots() / "robots" / self.poses)[self.start]
            positions = {joint: values[0] for joint, values in pose.items() if len(values) == 1}
        q = np.array(robot.q0)
        first = robot.nq - robot.nj
        q[first:] = [positions.get(joint, 0.0) for joint in robot.joint_names]
        if robot.nb:
            q[:7] = (0, 0, 0, 0, 0, 0, 1)
            state = robot.state()
            state.update(0.0, q, np.zeros(robot.nv))
            q[2] = -state.frame(self.ground).position[2]
        return q


@final
@dataclass(frozen=True)
class MadeRobot:
    """A robot of a workload: the model that is controlled, the configuration it starts from (nq,), and the same robot
    in Pinocchio, which judges the result."""

    robot: RobotModel
    q0: Vec
    reference: Any = field(repr=False)

    def placement(self, frame: str) -> Any:
        """Where a frame starts, a pinocchio.SE3."""
        data = self.reference.createData()
        pin.framesForwardKinematics(self.reference, data, self.q0)
        return data.oMf[self.reference.getFrameId(frame)].copy()

    def com(self) -> Vec:
        """Where the centre of mass starts (3,) [m]."""
        return np.array(pin.centerOfMass(self.reference, self.reference.createData(), self.q0))


@cache
def _made(recipe: RobotRecipe) -> MadeRobot:
    model = recipe.model()
    robot = load(model, feet=[])
    return MadeRobot(robot, recipe.start_of(robot), model)


PANDA = RobotRecipe(
    "panda",
    "panda_description/urdf/panda.urdf",
    "fixed",
    {"panda_joint2": -0.3, "panda_joint4": -2.2, "panda_joint6": 2.0, "panda_joint7": 0.785},
    fixed_joints=("panda_finger_joint1", "panda_finger_joint2"),
)

GO2 = RobotRecipe(
    "go2",
    "go2_description/urdf/go2.urdf",
    "floating",
    {f"{leg}_{joint}_joint": q for leg in ("FL", "FR", "RL", "RR") for joint, q in (("thigh", 0.8), ("calf", -1.6))},
    ground="FL_foot",
)

_G1_SIDE = {"hip_pitch": -0.3, "knee": 0.6, "ankle_pitch": -0.3, "shoulder_pitch": 0.2, "elbow": 0.7}

G1 = RobotRecipe(
    "g1",
    "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "floating",
    {f"{side}_{joint}_joint": q for side in ("left", "right") for joint, q in _G1_SIDE.items()}
    | {"left_shoulder_roll_joint": 0.25, "right_shoulder_roll_joint": -0.25},
    speed=0.1,
    ground="left_ankle_roll_link",
)

TALOS = RobotRecipe(
    "talos",
    "talos_data/robots/talos_reduced.urdf",
    "floating",
    "half_sitting",
    poses="talos_data/srdf/talos.srdf",
    ground="left_sole_link",
)
