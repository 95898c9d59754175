"""Robots' own conventions: which joint is which slot, and frames as bytes. Nothing of it was tried on hardware.

No maker's software is imported, and ``import wbc`` does not load this package. Names are loaded when they are used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wbc.robots.estimator import BaseEstimator as BaseEstimator
    from wbc.robots.franka import Franka as Franka
    from wbc.robots.gym import TargetEnv as TargetEnv
    from wbc.robots.invariant_filter import ImuNoise as ImuNoise
    from wbc.robots.joint_map import JointMap as JointMap
    from wbc.robots.kinematics import RobotKinematics as RobotKinematics
    from wbc.robots.lerobot import LeRobot as LeRobot
    from wbc.robots.loop import Loop as Loop
    from wbc.robots.motor_board import MotorBoard as MotorBoard
    from wbc.robots.port import Udp as Udp
    from wbc.robots.ros2_control import Ros2Control as Ros2Control
    from wbc.robots.ros2_port import Ros2Port as Ros2Port
    from wbc.robots.sensors import SENSORS as SENSORS
    from wbc.robots.sensors import EstimatedBase as EstimatedBase
    from wbc.robots.sensors import Sensors as Sensors
    from wbc.robots.unitree import UnitreeG1 as UnitreeG1
    from wbc.robots.unitree import UnitreeG1Arms as UnitreeG1Arms
    from wbc.robots.unitree import UnitreeGo2 as UnitreeGo2

_HOME = {
    "SENSORS": "sensors",
    "BaseEstimator": "estimator",
    "EstimatedBase": "sensors",
    "Franka": "franka",
    "ImuNoise": "invariant_filter",
    "JointMap": "joint_map",
    "LeRobot": "lerobot",
    "Loop": "loop",
    "MotorBoard": "motor_board",
    "RobotKinematics": "kinematics",
    "Ros2Control": "ros2_control",
    "Ros2Port": "ros2_port",
    "Sensors": "sensors",
    "TargetEnv": "gym",
    "Udp": "port",
    "UnitreeG1": "unitree",
    "UnitreeG1Arms": "unitree",
    "UnitreeGo2": "unitree",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'wbc.robots' has no attribute {name!r}")
    return getattr(import_module(f"wbc.robots.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
