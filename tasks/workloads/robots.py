"""The robots of the workloads: made from the extra ``robots`` when they are asked for, never stored.

Only what moves is kept of a robot description: links with their inertias, joints with their limits. Shapes,
transmissions and simulator settings are left out, and no joint mimics another. Inertias, limits and frames stay as
they are but for two robots: the fingers of the Panda are fixed, and the G1 may move at a tenth of its speed, so that
speed limits decide something.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from wbc.models import load
from wbc.models.catalogue import example_robots
from wbc.models.model import RobotModel
from wbc.models.poses import read_poses
from wbc.models.safe_xml import read_xml
from wbc.types import Vec

_KEPT = ("link", "joint")
_SHAPES = ("visual", "collision")


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
    fixed_joints: Collection[str] = ()
    speed: float = 1.0
    poses: str = ""
    ground: str = ""

    def description(self) -> Element:
        """The URDF, reduced and changed.

        Raises:
            ModelError: the extra ``robots`` is not installed.
        """
        source = read_xml(example_robots() / "robots" / self.source, "robot")
        robot = Element("robot", {"name": self.name})
        robot.extend(child for child in source if child.tag in _KEPT)
        for link in robot.iter("link"):
            _remove(link, _SHAPES)
        for joint in robot.iter("joint"):
            _remove(joint, ("mimic",))
            if joint.get("name") in self.fixed_joints:
                joint.set("type", "fixed")
                _remove(joint, ("limit", "axis", "dynamics"))
            for limit in joint.iter("limit"):
                if limit.get("velocity"):
                    limit.set("velocity", repr(self.speed * float(limit.attrib["velocity"])))
        return robot

    def made(self) -> MadeRobot:
        """The robot, and its start; made once."""
        return _made(self)

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
    """A robot of a workload: the model that is controlled, the configuration it starts from (nq,), and the same
    robot as Pinocchio reads it from the file, which judges the result."""

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
    description = recipe.description()
    robot = loaded(description, recipe.base)
    return MadeRobot(robot, recipe.start_of(robot), _reference(description, recipe.base))


def loaded(description: Element, base: Literal["fixed", "floating"]) -> RobotModel:
    """The robot of a URDF, which is a file meanwhile."""
    with TemporaryDirectory(prefix="wbc-workload-") as folder:
        path = Path(folder) / f"{description.attrib['name']}.urdf"
        ElementTree.ElementTree(description).write(path, encoding="utf-8")
        return load(path, base=base)


def _reference(description: Element, base: str) -> Any:
    text = ElementTree.tostring(description, encoding="unicode")
    if base == "floating":
        return pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    return pin.buildModelFromXML(text)


def _remove(parent: Element, tags: Collection[str]) -> None:
    for child in [child for child in parent if child.tag in tags]:
        parent.remove(child)


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
