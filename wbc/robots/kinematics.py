"""RobotKinematics: forward and inverse kinematics with the methods of LeRobot's class of that name, on ``wbc.reach``.

The class in ``lerobot.model.kinematics`` takes one step of PlaCo towards the pose in each call. This one goes on until
the pose is met within 10 µm, or is as near as it gets from where the arm is, and keeps the joint limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.control.reach import Reached, reach
from wbc.errors import InvalidInput
from wbc.models import load
from wbc.tasks import FrozenJoints, JointLimits, Orientation, Position
from wbc.types import Mat, Vec


@final
class RobotKinematics(metaclass=TellsArguments):
    """Kinematics of one frame of an arm, joints in degrees.

    Args:
        urdf_path: the arm, as ``wbc.load`` takes it: its base is fixed.
        target_frame_name: the frame of the tool.
        joint_names: the order of the joints in arrays; default: the arm's own. Others stay where they are at first.

    ``found`` is the result of the last inverse kinematics: ``found.ok`` and ``found.reason`` say whether it succeeded.

    Raises:
        UnknownFrame, UnknownJoint: a name that the arm does not have. InvalidInput: joints that are not angles.

    Example:
        >>> import numpy as np
        >>> from wbc.robots import RobotKinematics
        >>> arm = RobotKinematics("arm", "tool")
        >>> degrees = np.array([0.0, 20.0, 0.0, 80.0, 0.0, 45.0, 0.0])
        >>> pose = arm.forward_kinematics(degrees)
        >>> pose[2, 3] -= 0.05
        >>> there = arm.inverse_kinematics(degrees, pose)
        >>> arm.found.ok, bool(np.abs(arm.forward_kinematics(there) - pose).max() < 1e-4)
        (True, True)
    """

    def __init__(
        self,
        urdf_path: str | Path,
        target_frame_name: str = "gripper_frame_link",
        joint_names: Sequence[str] | None = None,
    ) -> None:
        self.robot = load(urdf_path, base="fixed")
        self.robot.check_frame(checks.text("target_frame_name", target_frame_name))
        self.target_frame_name = target_frame_name
        names = self.robot.joint_names if joint_names is None else checks.names("joint_names", joint_names)
        self.joint_names = list(names)
        self._index = np.array([self.robot.joint(name) for name in names])
        for name, k in zip(names, self._index, strict=True):
            if self.robot.joint_units[k] == "m":
                raise InvalidInput(f"joint {name!r} slides; name those that turn as joint_names")
        others = [name for name in self.robot.joint_names if name not in names]
        self._limits = [JointLimits(), *([FrozenJoints(others).exactly()] if others else [])]
        self._q: Vec = self.robot.q0.copy()
        self._state = self.robot.state()
        self.found: Reached | None = None

    def _radians(self, name: str, degrees: Any) -> Vec:
        """q (nq,) with the joints where they are said to be; numbers behind them are a gripper's."""
        given = checks.array(name, degrees, (None,))
        if len(given) < len(self._index):
            raise InvalidInput(f"{name} has {len(given)} entries for {len(self._index)} joints")
        q = self._q.copy()
        q[self._index] = np.deg2rad(given[: len(self._index)])
        return q

    def forward_kinematics(self, joint_pos_deg: Any) -> Mat:
        """The pose (4, 4) of the frame in the world, of joints in degrees.

        Raises:
            InvalidInput: fewer numbers than joints, or one that is not finite.
        """
        self._state.update(0.0, self._radians("joint_pos_deg", joint_pos_deg), np.zeros(self.robot.nv))
        frame, pose = self._state.frame(self.target_frame_name), np.eye(4)
        pose[:3, :3], pose[:3, 3] = frame.rotation, frame.position
        return pose

    def inverse_kinematics(
        self,
        current_joint_pos: Any,
        desired_ee_pose: Any,
        position_weight: float = 1.0,
        orientation_weight: float = 0.01,
    ) -> Vec:
        """Joints in degrees at which the frame has a pose (4, 4), the nearest from where the joints are.

        If position and orientation cannot both be met, the weights of their squared errors (m², rad²) set the
        trade-off; 0 leaves one out. Numbers behind those of the joints, such as a gripper's, come back as they were.

        Raises:
            InvalidInput: another shape, a matrix that is no pose, a negative weight, or both 0.
        """
        pose = checks.array("desired_ee_pose", desired_ee_pose, (4, 4))
        tasks: list[Position | Orientation] = []
        if checks.number("position_weight", position_weight, low=0.0):
            tasks.append(Position(self.target_frame_name, target=pose[:3, 3], weight=position_weight))
        if checks.number("orientation_weight", orientation_weight, low=0.0):
            tasks.append(Orientation(self.target_frame_name, target=pose[:3, :3], weight=orientation_weight))
        if not tasks:
            raise InvalidInput("position_weight and orientation_weight are 0; there is nothing to reach")
        start = self._radians("current_joint_pos", current_joint_pos)
        # No second attempt: an arm that follows a stream of poses must not jump to another branch.
        self.found = reach(self.robot, tasks, subject_to=self._limits, start=start, attempts=1)
        result = np.array(current_joint_pos, dtype=np.float64)
        result[: len(self._index)] = np.rad2deg(self.found.q[self._index])
        return result
