"""Clearance: how far a frame is from an obstacle."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.types import Vec

from .criterion import Criterion


@final
class Clearance(Criterion):
    """H = −½ max(0, reach − d)² [m²], d [m] the distance of the frame's origin p from a point or a plane.

    ``point`` (3,) [m]: d = |p − point|. ``plane`` (normal (3,), offset [m]): d = n·p − offset with |n| = 1, negative
    behind the plane. Beyond ``reach`` [m] an obstacle is not felt. ∂H/∂q = max(0, reach − d) J_pᵀ ∂d/∂p, J_p (3, nj)
    the linear rows of the joints; exact, and continuous but where p is on the point itself: there it is zero.

    Raises:
        InvalidInput: neither or both of point and plane, a normal of length zero, a reach that is not positive.
        UnknownFrame: when a stack is compiled.

    Example:
        >>> import wbc
        >>> from wbc.tasks import Clearance
        >>> robot, above_table = wbc.load("arm"), Clearance("forearm", plane=([0, 0, 1], 0.1), reach=0.2)
        >>> above_table.prepare(robot)
        >>> above_table.value(robot.state())
        0.0
    """

    units = "m^2"

    def __init__(self, frame: str, *, point: Any = None, plane: Any = None, reach: float = 0.3) -> None:
        self.frame = frame
        self.name = f"clearance of {frame}"
        if (point is None) == (plane is None):
            raise InvalidInput("Clearance takes a point or a plane, one of them")
        self.reach = checks.number("Clearance.reach", reach, low=0.0, strict=True)
        self._point = None if point is None else checks.array("Clearance.point", point, (3,))
        if plane is not None:
            ((normal, offset),) = checks.pairs("Clearance.plane", [plane], "normal, offset")
            normal = checks.array("Clearance.plane[0]", normal, (3,))
            length = float(np.linalg.norm(normal))
            if length < 1e-9:
                raise InvalidInput(f"Clearance.plane[0] is a normal of length {length:g}; it must point somewhere")
            self._normal, self._offset = normal / length, checks.number("Clearance.plane[1]", offset)

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def distance(self, state: RobotState) -> float:
        """d [m]."""
        return self._distance(state)[0]

    def value(self, state: RobotState) -> float:
        return 0.0 - 0.5 * max(0.0, self.reach - self.distance(state)) ** 2

    def gradient(self, state: RobotState) -> Vec:
        d, away = self._distance(state)
        J = state.frame(self.frame).jacobian()[:3, state.model.nb :]
        push: Vec = max(0.0, self.reach - d) * away
        return push @ J

    def _distance(self, state: RobotState) -> tuple[float, Vec]:
        """d and its gradient ∂d/∂p (3,)."""
        p = state.frame(self.frame).position
        if self._point is None:
            return float(self._normal.dot(p)) - self._offset, self._normal
        apart = p - self._point
        d = float(np.linalg.norm(apart))
        return d, apart / d if d > 0.0 else apart
