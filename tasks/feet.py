"""feet: a contact for each foot that a robot's description knows."""

from __future__ import annotations

from typing import Any

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.errors import NotSupported
from wbc.models.pinocchio_ import PinocchioModel
from wbc.stack.contact import Contact

from .point import Point
from .sole import Sole


@tells_arguments
def feet(robot: PinocchioModel, *, friction_share: float = 0.8, **settings: Any) -> list[Contact]:
    """One :class:`~tasks.sole.Sole` or :class:`~tasks.point.Point` for each of ``robot.feet``, of its size and place.

    ``friction_share`` is how much of the foot's friction the controller may count on; ``settings`` (kp, kd,
    force_weight, friction_model) are each contact's.

    Raises:
        NotSupported: a robot without feet. InvalidInput: no robot, a share that is not positive.

    Example:
        >>> import wbc
        >>> from wbc.tasks import feet
        >>> feet(wbc.load("quadruped"))[0]
        Point[front_left_foot](friction=0.48)
    """
    checks.instance("robot", robot, PinocchioModel, "a robot from wbc.load(...)")
    share = checks.number("friction_share", friction_share, low=0.0, strict=True)
    if not robot.feet:
        stand = "" if robot.nb else "; a robot with legs that is loaded with base='floating' has feet"
        raise NotSupported(f"{robot.name} has no feet: list its contacts, or load(..., feet=[...]) names them{stand}")
    contacts: list[Contact] = []
    for foot in robot.feet.values():
        common: dict[str, Any] = {"friction": share * foot.friction, **settings}
        if foot.half_size is None:
            contacts.append(Point(foot.frame, radius=foot.radius, **common))
        else:
            contacts.append(Sole(foot.frame, half_size=foot.half_size, origin=foot.origin, **common))
    return contacts
