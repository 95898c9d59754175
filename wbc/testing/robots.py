"""Robots to check members on, and moments of them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from wbc.errors import WbcError
from wbc.models import load
from wbc.models.model import RobotModel
from wbc.stack.member import bound
from wbc.testing.failure import CheckFailed
from wbc.types import Vec

#: Time [s], configuration (nq,), velocity (nv,).
Moment = tuple[float, Vec, Vec]


@cache
def robots() -> tuple[RobotModel, ...]:
    """The arm on its fixed base, the quadruped and the humanoid on floating ones."""
    return load("arm"), load("quadruped", base="floating"), load("humanoid", base="floating")


def moments(model: RobotModel, count: int = 3, seed: int = 0) -> list[Moment]:
    """Random moments inside the joint limits, velocities of about 1 rad/s, times within 2 s.

    Example:
        >>> from wbc.testing import moments, robots
        >>> len(moments(robots()[0], count=5))
        5
    """
    rng = np.random.default_rng(seed)
    return [
        (float(rng.uniform(0.1, 1.9)), model.random_configuration(rng), rng.normal(size=model.nv)) for _ in range(count)
    ]


def robots_for(member: Any, model: RobotModel | None) -> Iterator[tuple[Any, RobotModel]]:
    """A copy of ``member`` that is prepared for ``model``, or for each of our robots that it can be; and the robot.

    Raises:
        CheckFailed: none of them, with the reasons.
    """
    if model is not None:
        yield bound(member, model), model
        return
    refused = []
    for robot in robots():
        try:
            own = bound(member, robot)
        except WbcError as reason:
            refused.append(f"{robot.name}: {reason}")
        else:
            yield own, robot
    if len(refused) == len(robots()):
        raise CheckFailed(f"{member.name} fits none of our robots, so give a model; " + "; ".join(refused))
