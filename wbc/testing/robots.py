"""Robots to check members on, and moments of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from wbc import checks
from wbc.errors import UnknownFrame, UnknownJoint, WbcError
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
    checks.instance("model", model, RobotModel, "a robot from wbc.load(...)")
    count, rng = int(checks.number("count", count, low=1)), np.random.default_rng(checks.seed("seed", seed))
    return [
        (float(rng.uniform(0.1, 1.9)), model.random_configuration(rng), rng.normal(size=model.nv)) for _ in range(count)
    ]


def on_robots(member: Any, model: RobotModel | None, check: Callable[[Any, RobotModel], None]) -> None:
    """``check`` a prepared copy of ``member`` on ``model``, or on each of our robots that has the names it asks for.

    Raises:
        CheckFailed: by ``check``; or none of our robots will do, with the reasons.
    """
    if model is not None:
        checks.instance("model", model, RobotModel, "a robot from wbc.load(...)")
        check(bound(member, model), model)
        return
    refused = []
    for robot in robots():
        try:
            own = bound(member, robot)
        except WbcError as reason:
            refused.append(f"{robot.name}: {reason}")
            continue
        try:
            check(own, robot)
        except (UnknownFrame, UnknownJoint) as reason:  # of a member that looks for its frames in ``fill`` alone
            refused.append(f"{robot.name}: {reason}")
    if len(refused) == len(robots()):
        raise CheckFailed(
            f"{member.name} fits none of our robots, so give yours as the second argument; " + "; ".join(refused)
        )
