"""Every member of the library keeps the contract of its kind, on three robots. A new member is found here by itself."""

from __future__ import annotations

import inspect
import pkgutil
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import tasks
from wbc.models.model import RobotModel
from wbc.stack.component import Component
from wbc.stack.constraint import Constraint
from wbc.stack.contact import Contact
from wbc.stack.task import Objective
from wbc.testing import check_constraint, check_contact, check_task, robots

KINDS = {Objective: check_task, Constraint: check_constraint, Contact: check_contact}
LIBRARY = Path(tasks.__file__).parent
#: Folders of the package that hold programs, not members.
PROGRAMS = {"scenarios", "workloads"}


def is_member(value: Any, kinds: tuple[type, ...] = tuple(KINDS)) -> bool:
    """A class of one of the kinds that can be instantiated."""
    return isinstance(value, type) and issubclass(value, kinds) and not inspect.isabstract(value)


MEMBERS = [value for name, value in sorted(vars(tasks).items()) if is_member(value)]


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
def test_a_member_keeps_the_contract(member: Any, robot: RobotModel):
    check = next(check for kind, check in KINDS.items() if issubclass(member, kind))
    for sample in member.samples(robot):
        check(sample, robot)


@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
def test_a_member_has_samples(member: Any):
    assert any(member.samples(robot) for robot in robots())


@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
def test_a_member_says_what_it_is_and_shows_how(member: Any):
    assert "Example:" in (inspect.getdoc(member) or ""), "its docstring has no example"
    assert str(inspect.signature(member)).startswith("("), "its arguments cannot be read"


def test_a_member_may_be_used_by_its_name_alone():
    kinds = (*KINDS, Component)
    exported = {value for value in vars(tasks).values() if is_member(value, kinds)}
    for module in pkgutil.walk_packages([str(LIBRARY)], "wbc.tasks."):
        if module.name.split(".")[2] in PROGRAMS:
            continue
        for value in vars(import_module(module.name)).values():
            if is_member(value, kinds) and value.__module__ == module.name and not value.__name__.startswith("_"):
                assert value in exported, f"{module.name}.{value.__name__} is not in tasks/__init__.py"


def test_the_library_has_what_it_promises():
    promised = (
        "Frame Position Orientation CenterOfMass Posture JointVelocity Damping Torque ContactForce Point Sole "
        "JointPositionLimits JointVelocityLimits JointAccelerationLimits TorqueLimits"
    )
    assert set(promised.split()) <= {member.__name__ for member in MEMBERS}


def test_a_task_is_one_short_file():
    assert len((LIBRARY / "damping.py").read_text(encoding="utf-8").splitlines()) <= 40
