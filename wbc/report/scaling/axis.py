"""Axis: what grows, how far, and the problem of each size."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.models.model import RobotModel
from wbc.stack.formulation import Formulation
from wbc.stack.stack import Stack
from wbc.types import Vec


@final
@dataclass(frozen=True, eq=False)
class Problem:
    """A robot, what it should do, and at which level."""

    robot: RobotModel
    stack: Stack
    level: Formulation

    def states(self, count: int) -> Iterator[tuple[float, Vec, Vec]]:
        """Time [s], configuration and velocity at ``count`` moments of a smooth motion of 1 ms steps, the same for
        every solver: each joint on a sinusoid of 0.05 rad about the robot's reference, the base at rest."""
        robot, rng = self.robot, np.random.default_rng(0)
        frequency, phase = rng.uniform(1.0, 5.0, robot.nj), rng.uniform(0.0, 2.0 * np.pi, robot.nj)
        for k in range(count):
            angle = frequency * 1e-3 * k + phase
            q, v = np.array(robot.q0), np.zeros(robot.nv)
            q[robot.nq - robot.nj :] += 0.05 * np.sin(angle)
            v[robot.nb :] = 0.05 * frequency * np.cos(angle)
            yield 1e-3 * k, q, v


@final
@dataclass(frozen=True, eq=False)
class Axis:
    """``sizes`` along which it is measured, and ``problem(size)``."""

    name: str
    title: str
    sizes: Sequence[int]
    problem: Callable[[int], Problem]
