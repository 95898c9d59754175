"""Tasks that ask for almost the same, against an independent oracle: ``python -m tests.families.twins --count 300``.

A task of the library stands in one level with its twin, whose gains differ by a share of 10⁻² to 10⁻¹⁰, and a posture
beside or below them, under ``Scaled`` and ``Strict``, on three robots. The rows of the twins nearly depend on one
another: what is left of them in the space below is rounding, or all but that.
"""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

import wbc
from tasks import JointAccelerationLimits, JointVelocityLimits, Posture
from tests.families.members import classes, samples
from tests.families.oracle import undamped
from tests.families.progress import Family, Ticks, followed
from wbc.errors import WbcError
from wbc.stack.task import Task
from wbc.testing import robots

LEVELS = (wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics())


def twin(task: Any, rng: np.random.Generator) -> Any:
    """A copy of a task, called ``twin``, each of whose rows asks for a little more or less."""
    other = copy.deepcopy(task)
    other._kp = np.asarray(task.kp) * (1.0 + 10.0 ** rng.uniform(-10.0, -2.0) * rng.normal(size=task.dim))
    other._name = "twin"
    return other


def draw(seed: int) -> tuple[wbc.Controller, np.ndarray, np.ndarray, str]:
    """A controller, where it starts, and what it is; combinations that are refused while building are drawn again."""
    rng = np.random.default_rng(seed)
    while True:
        number = int(rng.integers(len(robots())))
        robot: Any = robots()[number]
        known = samples(classes(Task)[rng.integers(len(classes(Task)))], number)
        task = known[rng.integers(len(known))] if known else None
        if getattr(task, "dim", 1) == 1 or isinstance(task.kp, Mapping):
            continue
        pair: list[Any] = [task, twin(task, rng)]
        rng.shuffle(pair)
        hierarchy = wbc.Scaled() if rng.uniform() < 0.8 else wbc.Strict()
        level = LEVELS[rng.integers(3)]
        posture = Posture(robot.q0, weight=float(10.0 ** rng.uniform(-3.0, 1.0)))
        limits: list[Any] = [JointAccelerationLimits(float(10.0 ** rng.uniform(0.0, 1.5)))]
        limits += [JointVelocityLimits()] if rng.uniform() < 0.5 else []
        levels = [pair, [posture]] if rng.uniform() < 0.5 else [[*pair, posture]]
        q = robot.integrate(robot.q0, 0.1 * rng.normal(size=robot.nv))
        v = rng.choice([0.01, 0.3]) * rng.normal(size=robot.nv)
        with contextlib.suppress(WbcError):
            stack = wbc.Stack(levels, subject_to=limits)
            control = wbc.Controller(robot, stack, level=undamped(level, hierarchy), hierarchy=hierarchy)
            return control, q, v, f"{type(level).__name__} {type(hierarchy).__name__}"


def ticked(case: int, ticks: int) -> Ticks:
    """The controller, each of its commands, and what it is."""
    yield from followed(*draw(case), ticks)


FAMILY = Family(ticked)

if __name__ == "__main__":
    FAMILY.command(__doc__, ticks=4)
