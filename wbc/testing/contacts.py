"""check_contact: the properties of every contact."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.models.model import RobotModel, RobotState
from wbc.stack.contact import Anchor, Contact
from wbc.stack.layout import refuse_cone
from wbc.stack.member import bound
from wbc.stack.task import Reaction, Task, TaskRows
from wbc.testing.differences import along, velocity_names
from wbc.testing.failure import accepted, differs, require, worst
from wbc.testing.filling import Filling
from wbc.testing.robots import Moment, moments, on_robots
from wbc.testing.tasks import check_task
from wbc.types import Mat, Vec


@tells_arguments
def check_contact(contact: Contact, model: RobotModel | None = None, states: Iterable[Moment] | None = None) -> None:
    """Check a contact on ``model``, or on those of our arm, quadruped and humanoid that have its frame.

    Power: f · J v is that of the wrench f, in the axes of the anchor at its position, on the moving frame. By
    differences: J = −∂e/∂q where the contact was made (rows whose e is always zero hold velocities only) and
    drift = J̇ v. The cone: one label a row, it lets the surface push and, if it has rows, not pull. Filled twice, same
    bits, nothing left unwritten, nothing beside.

    Raises:
        CheckFailed: which rule, which row, and the two numbers that differ.

    Example:
        >>> from wbc.tasks import Point
        >>> from wbc.testing import check_contact
        >>> check_contact(Point("tool", friction=0.5))
    """
    if isinstance(contact, Reaction):
        assert isinstance(contact.task, Task), "a reaction is made by a task"
        check_task(contact.task, model, states)
        return
    checks.instance("contact", contact, Contact, "a contact")
    given = None if states is None else checks.moments("states", states)

    def check(own: Any, robot: RobotModel) -> None:
        when = moments(robot) if given is None else given
        _check_cone(own)
        for first, second in zip(when, [*when[1:], when[0]], strict=True):
            _check_moment(own, robot, first, second)

    on_robots(contact, model, check)


def _check_cone(contact: Contact) -> None:
    accepted(refuse_cone, contact)
    name, (cone, again) = contact.name, (np.array(contact.cone(), dtype=np.float64) for _ in range(2))
    require(cone.tobytes() == again.tobytes(), f"{name}.cone() is not pure: it differs when asked twice")
    if len(cone):
        push = np.eye(contact.dim)[[*contact.wrench_axes].index(2)]
        require((cone @ push <= 0.0).all(), f"{name}.cone() does not let the surface push along its normal z")
        require((cone @ -push > 0.0).any(), f"{name}.cone() lets the surface pull")


def _filling(contact: Contact, model: RobotModel, anchor: Anchor) -> Filling:
    def write(state: RobotState, out: TaskRows) -> None:
        contact.fill(state, anchor, out)

    dim = contact.dim
    return Filling(contact.name, model, write, TaskRows, {"J": (dim, model.nv), "drift": (dim,), "e": (dim,)})


def _check_moment(contact: Contact, model: RobotModel, first: Moment, second: Moment) -> None:
    state, v = model.state(), first[2]
    state.update(*first)
    anchor = contact.anchor(state)
    filling, twin = (_filling(one, model, anchor) for one in (contact, bound(contact, model)))
    filling.check_purity(twin, [first, second])
    rows = filling.at(first)
    J = rows["J"]

    where = f"{contact.name} on {model.name}, row "
    changed = along(lambda m: filling.at(m)["J"] @ v, model, first, v)
    for what, wrote, by, expected in (
        ("e at its own anchor", rows["e"], "0, where it was made,", np.zeros(contact.dim)),
        ("J v", J @ v, "the velocity of the surface", _surface_velocity(contact, state, anchor, v)),
        ("drift", rows["drift"], "d(J v)/dt at a = 0", changed),
    ):
        at = worst(wrote, expected)
        if at is not None:
            raise differs(f"{where}{at[0]}", what=what, wrote=wrote[at], by=by, found=expected[at])
    found = -np.column_stack([along(lambda m: filling.at(m)["e"], model, first, axis) for axis in np.eye(model.nv)])
    held = np.abs(found).max(axis=1) > 0.0
    at = worst(found[held], J[held])
    if at is not None:
        row, what = int(np.flatnonzero(held)[at[0]]), f"J for {velocity_names(model)[at[1]]!r}"
        raise differs(f"{where}{row}", what=what, wrote=J[row, at[1]], by="-de/dq", found=found[row, at[1]])


def _surface_velocity(contact: Contact, state: RobotState, anchor: Anchor, v: Vec) -> Vec:
    """Twist of the material point at the anchor, in the anchor's axes; of one frame of the robot against another in the
    carrier's, at the frame's origin."""
    frame = state.frame(contact.frame)
    linear, angular = np.split(frame.jacobian() @ v, 2)
    if contact.carrier is None:
        to_surface: Mat = anchor.rotation.T
        linear = linear + np.cross(angular, anchor.position - frame.position)
    else:
        carrier = state.frame(contact.carrier)
        to_surface = carrier.rotation.T
        moved, turned = np.split(carrier.jacobian() @ v, 2)
        linear = linear - moved - np.cross(turned, frame.position - carrier.position)
        angular = angular - turned
    return np.concatenate([to_surface @ linear, to_surface @ angular])[list(contact.wrench_axes)]
