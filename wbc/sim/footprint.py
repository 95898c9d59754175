"""Footprint: a declared contact as physics builds it, a box or balls fixed to a link."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol, final, runtime_checkable

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.models.pinocchio_ import PinocchioModel
from wbc.stack.contact import Contact
from wbc.types import Mat, Vec

#: Half the thickness of a sole's box, the radius of the balls at its corners, the least radius of a point [m].
SOLE_HALF_THICKNESS = 0.01
CORNER_RADIUS = 0.005
POINT_RADIUS = 0.001

Ball = tuple[Vec, float]


@runtime_checkable
class Rectangular(Protocol):
    """A contact with a rectangular surface."""

    half_size: Any


@runtime_checkable
class _Straight(Protocol):
    """A contact along a line, the x of its anchor."""

    half_length: Any


@runtime_checkable
class _Round(Protocol):
    """A contact that is one point of a ball about its frame's origin."""

    radius: Any


@final
@dataclass(frozen=True, eq=False)
class Footprint:
    """What touches the floor for one contact, in the axes of the link it is fixed to.

    A rectangle of ``half_size`` (2,) [m] in the plane z = 0 of ``rotation`` (3, 3) and ``origin`` (3,); or, with
    ``half_size`` None, a ball about ``origin``, and ``rotation`` is that of the surface in the world. ``balls`` are
    (centre (3,), radius) [m]: the ball itself, or what stands for the rectangle; none means a box. An edge is a
    rectangle of no width with a ball at each end. ``friction`` is the plant's coefficient.
    """

    name: str
    link: str
    friction: float
    rotation: Mat
    origin: Vec
    half_size: Vec | None
    balls: tuple[Ball, ...]

    def lowest(self, rotation: Mat, position: Vec) -> float:
        """Height [m] of the lowest point when the link is at (rotation, position) in the world."""
        if self.balls or self.half_size is None:
            return min(float((position + rotation @ centre)[2] - radius) for centre, radius in self.balls)
        slope = (rotation @ self.rotation)[2, :2]
        return float((position + rotation @ self.origin)[2] - np.abs(slope) @ self.half_size)


def footprints(
    contacts: Iterable[Contact], robot: PinocchioModel, *, friction: float | None, balls: bool
) -> list[Footprint]:
    """The footprints of a stack's contacts, with ``friction`` for all or each contact's own.

    ``balls``: a sole stands on the balls that the robot's description gives it, or on one at each corner.

    Raises:
        NotSupported: a contact that is no rectangle, edge or ball, such as a gear, or whose surface is not level.
        InvalidInput: a friction that is not positive, or two contacts of one name.
    """
    state = robot.state()
    state.update(0.0, robot.q0, np.zeros(robot.nv))
    found: dict[str, Footprint] = {}
    for contact in contacts:
        name, link = contact.name, contact.frame
        if name in found:
            raise InvalidInput(f"two contacts are called {name!r}; give one of them a name of its own")
        if contact.bilateral:
            raise NotSupported(
                f"contact {name!r} is a part of the mechanism, which physics cannot build; task.exactly() in "
                "subject_to makes motors do the same"
            )
        mu = contact.friction if friction is None else checks.number("friction", friction, low=0.0, strict=True)
        frame, anchor = state.frame(link), contact.anchor(state)
        surface = anchor if contact.target is None and isinstance(contact, _Round) else contact.target
        if surface is not None and not np.isclose(surface.rotation[2, 2], 1.0):
            lean = np.degrees(np.arccos(np.clip(surface.rotation[2, 2], -1.0, 1.0)))
            raise NotSupported(f"contact {name!r} is on a surface that leans by {lean:.3g}°; here the floor is level")
        if isinstance(contact, Rectangular):
            rotation = frame.rotation.T @ anchor.rotation
            origin = frame.rotation.T @ (anchor.position - frame.position)
            half_size = np.array(contact.half_size, dtype=np.float64)
            standing = _standing_on(robot, link, rotation, origin, half_size) if balls else ()
            found[name] = Footprint(name, link, mu, rotation, origin, half_size, standing)
        elif isinstance(contact, _Straight):
            rotation = frame.rotation.T @ anchor.rotation
            origin = frame.rotation.T @ (anchor.position - frame.position)
            length = float(contact.half_length)
            ends = [origin + rotation @ np.array([x, 0.0, CORNER_RADIUS]) for x in (-length, length)]
            found[name] = Footprint(
                name, link, mu, rotation, origin, np.array([length, 0.0]), tuple((end, CORNER_RADIUS) for end in ends)
            )
        elif isinstance(contact, _Round):
            ball = (np.zeros(3), max(float(contact.radius), POINT_RADIUS))
            found[name] = Footprint(name, link, mu, anchor.rotation, np.zeros(3), None, (ball,))
        else:
            raise NotSupported(f"contact {name!r} has no half_size, half_length or radius: physics cannot build it")
    return list(found.values())


def _standing_on(robot: PinocchioModel, link: str, rotation: Mat, origin: Vec, half_size: Vec) -> tuple[Ball, ...]:
    foot = robot.feet.get(link)
    if foot is not None and foot.balls:
        return tuple((np.array(centre), foot.radius) for centre in foot.balls)
    corners = [np.array([x, y, 0.0]) for x in (-half_size[0], half_size[0]) for y in (-half_size[1], half_size[1])]
    lift = np.array([0.0, 0.0, CORNER_RADIUS])
    return tuple((origin + rotation @ (corner + lift), CORNER_RADIUS) for corner in corners)
