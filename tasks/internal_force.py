"""InternalForce: sets how strongly contacts press against each other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.contact import Contact
from wbc.stack.target import vector_target
from wbc.stack.task import LinearRows, LinearTask
from wbc.stack.tracking import Tracking

from .point import Point


@final
class InternalForce(Tracking, LinearTask):
    """½ uᵢⱼ · (Fⱼ − Fᵢ) = target [N] for each pair of ``contacts``: F the force on the robot at a contact, u the unit
    vector from contact i to contact j, world axes. Positive: what lies between the two is pressed together. It moves
    nothing: forces that are equal everywhere, such as those that carry a weight, are no part of it.

    ``target``: one number for all pairs, (pairs,) in the order 1-2, 1-3, …, 2-3, …, or a function of time giving
    (pairs,). All pairs together are the forces in the bars of a frame between the contacts: for n >= 3 points not in
    a line, 3 n − 6 bars are all internal forces there are. Source: Williams, Khatib, ICRA 1993 (virtual linkage).

    Raises:
        InvalidInput: fewer than two contacts, the same twice, what is no contact with the world, a target of another
            shape. UnknownName: no such contact, when a stack is compiled.

    Example:
        >>> from wbc.tasks import InternalForce, Point
        >>> left, right = Point("left_hand", friction=0.8), Point("right_hand", friction=0.8)
        >>> InternalForce([left, right], target=20.0, weight=1e-2).dim
        1
    """

    on = "force"
    units = "N"
    read_once = frozenset({"contact", "contacts"})

    def __init__(
        self, contacts: Sequence[Contact], *, target: Any = 0.0, weight: Any = 1.0, name: str | None = None
    ) -> None:
        contacts = checks.items("InternalForce.contacts", contacts, "contacts")
        for i, contact in enumerate(contacts):
            if not isinstance(contact, Contact) or contact.bilateral:
                raise InvalidInput(f"InternalForce.contacts[{i}] is {contact!r}; it must be a contact with the world")
        self.contact = tuple(contact.name for contact in contacts)
        if len(set(self.contact)) != len(contacts) or len(contacts) < 2:
            raise InvalidInput(f"InternalForce.contacts are {self.contact}; there must be at least two, each once")
        self.contacts = tuple(contacts)
        short = [contact.short_name for contact in contacts]
        self.subject = ", ".join(short)
        self.labels = [f"{a} - {b}" for a, b in combinations(short, 2)]
        self.dim = len(self.labels)
        self.convert = vector_target(self.dim)
        super().__init__(weight=weight, name=name)
        one_for_all = not callable(target) and checks.ndim(target) == 0
        self.target = checks.each(f"{self.name}.target", target, self.dim) if one_for_all else target

    def fill(self, state: RobotState, out: LinearRows) -> None:
        out.A[:] = 0.0
        places, first = [], 0
        for contact in self.contacts:  # the three forces come first in every wrench
            anchor = contact.anchor(state)
            places.append((anchor.position, anchor.rotation, slice(first, first + 3)))
            first += contact.dim
        for row, ((p, R, mine), (q, S, other)) in enumerate(combinations(places, 2)):
            way = q - p
            half = 0.5 / max(float(np.sqrt(way @ way)), 1e-9) * way
            out.A[row, mine], out.A[row, other] = -half @ R, half @ S
        out.b[:] = self.reference(state.t).value

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frames = model.frame_names[-1], model.frame_names[len(model.frame_names) // 2]
        return [cls([Point(frame, friction=0.5) for frame in frames], target=10.0)]
