"""Bounds on normal forces of contacts, and forces that are wanted of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks import CenterOfMass, ContactForce, Orientation, Point, Posture
from tests.stack.conftest import Saying, feet

ROBOTS = {name: wbc.load(name) for name in ("humanoid", "quadruped")}
HUMANOID = ROBOTS["humanoid"]
HIERARCHIES = {"weighted": wbc.Weighted(), "strict": wbc.Strict(), "scaled": wbc.Scaled()}


def standing(name: str, *more: Any, hierarchy: str = "weighted", **parts: Any) -> tuple[wbc.Controller, list[Any]]:
    """A robot on its feet; tasks ``more`` stand below its balance."""
    robot = ROBOTS[name]
    contacts = feet(robot)
    balance = [CenterOfMass(target=robot.state().com), Orientation(robot.frame_names[0], target=np.eye(3))]
    levels = [balance, *([more] if more else []), [Posture(robot.q0, weight=1e-3)]]
    stack = wbc.Stack(levels, contacts=contacts, **parts)
    return wbc.Controller(robot, stack, level=wbc.InverseDynamics(), hierarchy=HIERARCHIES[hierarchy]), contacts


def normals(controller: wbc.Controller, contacts: list[Any]) -> np.ndarray:
    """The normal forces of a tick at rest, which has an answer."""
    robot = controller.model
    command = controller.tick(0.0, robot.q0, np.zeros(robot.nv))
    assert command.status.ok, controller.why
    return np.array([command.f[contact.name][2] for contact in contacts])


@pytest.mark.parametrize("hierarchy", HIERARCHIES)
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_normal_force_stays_within_its_bounds_and_the_others_carry_the_rest(robot: str, hierarchy: str):
    controller, contacts = standing(robot, hierarchy=hierarchy)
    free = normals(controller, contacts)
    contacts[0].f_max = 0.9 * free[0]
    less = normals(controller, contacts)
    assert less[0] <= 0.9 * free[0] + 1e-5 and less.sum() == pytest.approx(free.sum(), rel=0.02)
    contacts[0].f_max, contacts[0].f_min = None, 1.1 * free[0]
    more = normals(controller, contacts)
    assert more[0] >= 1.1 * free[0] - 1e-5 and more.sum() == pytest.approx(free.sum(), rel=0.02)
    contacts[0].f_min = None
    np.testing.assert_allclose(normals(controller, contacts), free, atol=1e-3 * free.max())


def test_bounds_given_with_a_contact_are_those_assigned_to_it():
    assigned, contacts = standing("quadruped")
    for contact in contacts:
        contact.f_min, contact.f_max = 10.0, 45.0
    robot = ROBOTS["quadruped"]
    balance = [CenterOfMass(target=robot.state().com), Orientation(robot.frame_names[0], target=np.eye(3))]
    given = [Point(f.frame, radius=f.radius, friction=f.friction, f_min=10.0, f_max=45.0) for f in robot.feet.values()]
    stack = wbc.Stack([balance, [Posture(robot.q0, weight=1e-3)]], contacts=given)
    found = normals(wbc.Controller(robot, stack, level=wbc.InverseDynamics()), given)
    np.testing.assert_allclose(found, normals(assigned, contacts), atol=1e-6)


def test_what_a_component_allows_goes_before_the_least_force():
    lifting = Saying()
    controller, contacts = standing("quadruped", components=[lifting])
    contacts[1].f_min = 30.0
    assert normals(controller, contacts)[1] >= 30.0 - 1e-5
    lifting.now = wbc.Overrides(normal_limits={contacts[1].name: 5.0})
    assert normals(controller, contacts)[1] <= 5.0 + 1e-5
    lifting.now = None
    assert normals(controller, contacts)[1] >= 30.0 - 1e-5


@pytest.mark.parametrize("what", ["normal_limits", "normal_floors"])
def test_bounds_on_the_force_of_a_contact_that_the_stack_does_not_have_are_named(what: str):
    lifting = Saying()
    controller, contacts = standing("quadruped", components=[lifting])
    normals(controller, contacts)
    lifting.now = wbc.Overrides(**{what: {"rear_left_fot": 5.0}})
    command = controller.tick(0.001, controller.model.q0, np.zeros(controller.model.nv))
    assert not command.status.ok and np.isfinite(command.tau).all()
    assert f"{what} speaks of a contact" in controller.why and "'rear_left_fot'" in controller.why
    assert "did you mean 'rear_left_foot'" in controller.why


@pytest.mark.parametrize("hierarchy", HIERARCHIES)
def test_a_wanted_normal_force_leaves_the_rest_of_the_wrench_free(hierarchy: str):
    free = normals(*standing("humanoid"))
    target = [1e3, 1e3, 1.2 * free[0]]  # the first two are not wanted
    wanted = ContactForce(HUMANOID.feet["left_sole"].frame, target=target, weight={"fz": 1e-1, "f[xy]": 0.0})
    controller, contacts = standing("humanoid", wanted, hierarchy=hierarchy)
    found = normals(controller, contacts)
    left = [contact.frame for contact in contacts].index(HUMANOID.feet["left_sole"].frame)
    assert found[left] == pytest.approx(target[2], rel=1e-2)


def test_bounds_count_where_forces_are_decided():
    robot = ROBOTS["quadruped"]
    contacts = [Point(f, friction=0.5, f_min=1.0, f_max=2.0) for f in robot.feet]
    stack = wbc.Stack([Posture(robot.q0)], contacts=contacts)
    command = wbc.Controller(robot, stack, level=wbc.VelocityLevel()).tick(0.0, robot.q0, np.zeros(robot.nv))
    assert command.status.ok
