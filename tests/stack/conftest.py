"""Robots and stacks that the tests of a plan share."""

from __future__ import annotations

import numpy as np
import pytest

import tasks as T
import wbc
from wbc.models.pinocchio_ import PinocchioModel
from wbc.types import Vec


class Saying(wbc.Component):
    """Overrides what it is told to."""

    def __init__(self, now: wbc.Overrides | None = None, *, name: str | None = None) -> None:
        super().__init__(name=name)
        self.now = now

    def before(self, state: object, last: object, plan: object) -> wbc.Overrides | None:
        return self.now


def bounds_on(joints: object, most: float, nj: int) -> tuple[Vec, Vec]:
    """Bounds (lower, upper) of these joints alone."""
    high = np.full(nj, np.inf)
    high[joints] = most
    return -high, high


@pytest.fixture(scope="session")
def arm() -> PinocchioModel:
    return wbc.load("arm")


@pytest.fixture(scope="session")
def quadruped() -> PinocchioModel:
    return wbc.load("quadruped")


@pytest.fixture(scope="session")
def humanoid() -> PinocchioModel:
    return wbc.load("humanoid")


def feet(robot: PinocchioModel) -> list[T.Sole | T.Point]:
    return [
        T.Sole(f.frame, half_size=f.half_size, origin=f.origin, friction=f.friction)
        if f.half_size
        else T.Point(f.frame, radius=f.radius, friction=f.friction)
        for f in robot.feet.values()
    ]


def standing(robot: PinocchioModel, *, shift: float = 0.02, extra: tuple = ()) -> wbc.Stack:
    """Move the centre of mass by ``shift`` [m], keep the base upright, stay near the stance."""
    state = robot.state()
    return wbc.Stack(
        [
            T.CenterOfMass(target=state.com + np.array([0.0, shift, 0.0]), kp=100),
            T.Orientation(robot.frame_names[0], target=np.eye(3), kp=100, weight=0.1),
            T.Posture(robot.q0, kp=10, weight=1e-3),
            *extra,
        ],
        contacts=feet(robot),
        subject_to=[T.TorqueLimits(), T.JointVelocityLimits()],
    )


def moving(robot: PinocchioModel, seed: int) -> tuple[Vec, Vec]:
    """A state near the stance, moving."""
    rng = np.random.default_rng(seed)
    q = robot.integrate(robot.q0, 0.05 * rng.normal(size=robot.nv))
    return q, 0.1 * rng.normal(size=robot.nv)
