"""Robots of any size for scaling curves: random chains on a base that stands, and a body on many legs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.models import load
from wbc.models.model import RobotModel
from wbc.types import Vec

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
    rng, model, parent = np.random.default_rng(seed), pin.Model(), 0
    model.name = f"chain{joints}"
    rng.uniform(0.2, 1.0)  # of a base that does not move
    for i in range(1, joints + 1):
        mass, axis = rng.uniform(0.2, 1.0), rng.normal(size=3)
        parent = _link(model, parent, (f"q{i}", f"link{i}"), axis, (rng.uniform(0.05, 0.15), 0.0, 0.0), mass=mass)
    return load(model)


@cache
def many_legs(legs: int, seed: int = 0) -> RobotModel:
    """A floating body with legs of three joints in a circle; their feet are foot0, foot1, …

    Example:
        >>> many_legs(8).nv
        30
    """
    rng, model = np.random.default_rng(seed), pin.Model()
    model.name = f"legs{legs}"
    body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    _body(model, body, "body", 10.0)
    for leg in range(legs):
        angle = 2.0 * np.pi * leg / legs
        parent, place = body, (0.3 * np.cos(angle), 0.3 * np.sin(angle), 0.0)
        for joint, axis in enumerate(((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0))):
            names = f"q{leg}_{joint}", f"leg{leg}_{joint}"
            parent = _link(model, parent, names, axis, place, mass=rng.uniform(0.2, 1.0))
            place = (0.1, 0.0, -0.15)
        foot = pin.SE3(np.eye(3), np.array([-0.1, 0.0, -0.15]))
        model.addFrame(pin.Frame(f"foot{leg}", parent, 0, foot, pin.FrameType.BODY))
    return load(model, feet=[])


def _link(
    model: Any, parent: int, names: tuple[str, str], axis: Vec | Sequence[float], place: Sequence[float], *, mass: float
) -> int:  # fmt: skip
    """A joint of limits ±3 rad and the link behind it, by their names."""
    joint, link = names
    turning = pin.JointModelRevoluteUnaligned(np.asarray(axis) / np.linalg.norm(axis))
    limits = (np.full(1, value) for value in (EFFORT, SPEED, -3.0, 3.0))
    number = model.addJoint(parent, turning, pin.SE3(np.eye(3), np.array(place)), joint, *limits)
    _body(model, number, link, mass)
    return int(number)


def _body(model: Any, joint: int, name: str, mass: float) -> None:
    inertia = pin.Inertia(float(mass), np.array([0.04, 0.0, 0.0]), 0.002 * np.eye(3))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
