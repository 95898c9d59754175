"""Every member of the library does its work in a stack, at every level that carries it, on three robots."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tasks
import wbc
from tests.test_features import contacts_of
from wbc.errors import NotSupported
from wbc.models.model import RobotModel
from wbc.stack.constraint import Constraint
from wbc.stack.contact import Contact
from wbc.stack.task import Objective, Task
from wbc.testing import robots
from wbc.testing.levels import LEVELS, stack_with

KINDS = (Objective, Constraint, Contact)
MEMBERS = [m for _, m in sorted(vars(tasks).items()) if isinstance(m, type) and issubclass(m, KINDS)]


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
def test_a_member_does_its_work_at_every_level_that_carries_it(member: Any, robot: RobotModel):
    rng = np.random.default_rng(3)
    q = robot.integrate(robot.q0, 0.05 * rng.normal(size=robot.nv))
    v = 0.1 * rng.normal(size=robot.nv)
    for sample in member.samples(robot):
        contacts = contacts_of(sample, robot)
        for level in LEVELS:
            if robot.nb and level.dynamics:
                continue  # nothing holds a robot that floats; those that stand are tested elsewhere
            try:
                controller = wbc.Controller(robot, stack_with(sample, contacts), level=level)
            except NotSupported:
                assert not isinstance(sample, Task)  # a kinematic task serves every level
                continue
            command = controller.tick(0.1, q, v)
            assert command.status.ok, (level.name, command.status)
            assert np.isfinite(command.v).all()
