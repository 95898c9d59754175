"""Robots of any size for scaling curves: random chains on a base that stands, and a body on many legs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from wbc.models.model import RobotModel
from wbc.types import Vec

from .robots import loaded

#: Torque limit of every joint [N m], and its speed [rad/s].
EFFORT, SPEED = 500.0, 8.0


@cache
def chain(joints: int, seed: int = 0) -> RobotModel:
    """A chain of revolute joints about axes of all directions, links of 5 to 15 cm and 0.2 to 1 kg.

    Its frames are link1, link2, …, the last one is its end.

    Example:
        >>> chain(30).nj
        30
    """
    rng = np.random.default_rng(seed)
    robot = Element("robot", {"name": f"chain{joints}"})
    _link(robot, "link0", rng)
    for i in range(joints):
        _link(robot, f"link{i + 1}", rng)
        _joint(robot, f"q{i + 1}", (f"link{i}", f"link{i + 1}"), rng.normal(size=3), (rng.uniform(0.05, 0.15), 0, 0))
    return loaded(robot, "fixed")


@cache
def many_legs(legs: int, seed: int = 0) -> RobotModel:
    """A floating body with legs of three joints in a circle; their feet are foot0, foot1, …

    Example:
        >>> many_legs(8).nv
        30
    """
    rng = np.random.default_rng(seed)
    robot = Element("robot", {"name": f"legs{legs}"})
    _link(robot, "body", rng, mass=10.0)
    for leg in range(legs):
        angle = 2.0 * np.pi * leg / legs
        before, place = "body", (0.3 * np.cos(angle), 0.3 * np.sin(angle), 0.0)
        for joint, axis in enumerate(((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0))):
            name = f"leg{leg}_{joint}"
            _link(robot, name, rng)
            _joint(robot, f"q{leg}_{joint}", (before, name), np.array(axis), place)
            before, place = name, (0.1, 0.0, -0.15)
        SubElement(robot, "link", {"name": f"foot{leg}"})
        sole = SubElement(robot, "joint", {"name": f"sole{leg}", "type": "fixed"})
        SubElement(sole, "parent", {"link": before})
        SubElement(sole, "child", {"link": f"foot{leg}"})
        SubElement(sole, "origin", {"xyz": "-0.1 0 -0.15"})
    return loaded(robot, "floating")


def _link(robot: Element, name: str, rng: np.random.Generator, *, mass: float | None = None) -> None:
    inertial = SubElement(SubElement(robot, "link", {"name": name}), "inertial")
    SubElement(inertial, "origin", {"xyz": "0.04 0 0"})
    SubElement(inertial, "mass", {"value": repr(float(rng.uniform(0.2, 1.0)) if mass is None else mass)})
    moments = dict.fromkeys(("ixx", "iyy", "izz"), "0.002") | dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    SubElement(inertial, "inertia", moments)


def _joint(robot: Element, name: str, links: tuple[str, str], axis: Vec, origin: Sequence[float]) -> None:
    joint = SubElement(robot, "joint", {"name": name, "type": "revolute"})
    SubElement(joint, "parent", {"link": links[0]})
    SubElement(joint, "child", {"link": links[1]})
    SubElement(joint, "origin", {"xyz": " ".join(repr(float(x)) for x in origin)})
    SubElement(joint, "axis", {"xyz": " ".join(repr(float(x)) for x in axis / np.linalg.norm(axis))})
    limits = {"lower": "-3", "upper": "3", "effort": repr(EFFORT), "velocity": repr(SPEED)}
    SubElement(joint, "limit", limits)
