"""Feet: the places where a robot touches the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, final

import numpy as np

from wbc.arguments import TellsArguments
from wbc.models.geometry import Triple
from wbc.types import Vec


class Guessed(UserWarning):
    """Warning: a file does not say something that was guessed: feet, their friction, a standing posture."""


@final
@dataclass(frozen=True)
class Foot(metaclass=TellsArguments):
    """A flat ``sole`` or a round ``point`` fixed to ``frame``, and the friction it can be expected to have.

    sole    a rectangle in the x-y plane of the frame, centred at ``origin`` [m], ``half_size`` (x, y) [m]; where the
            sole is really a set of balls, ``balls`` are their centres and ``radius`` is theirs
    point   a ball of ``radius`` [m] centred at ``origin``

    ``load(..., feet=[...])`` measures a sole without ``half_size`` on the shapes of the robot.
    """

    frame: str
    kind: Literal["sole", "point"]
    friction: float
    origin: Triple = (0.0, 0.0, 0.0)
    half_size: tuple[float, float] | None = None
    radius: float = 0.0
    balls: tuple[Triple, ...] = ()

    def lowest(self) -> list[tuple[Triple, float]]:
        """The points of the foot that may touch first, and how far below each the foot reaches [m]."""
        if self.half_size is None:
            return [(self.origin, self.radius)]
        (x, y, z), (dx, dy) = self.origin, self.half_size
        return [((x + i * dx, y + j * dy, z), 0.0) for i in (-1, 1) for j in (-1, 1)]

    def lowest_in_world(self, position: Vec, rotation: Vec) -> Vec:
        """The points (…, k, 3) [m] that touch level ground first, where the frame is at ``position`` (…, 3) and turned
        by ``rotation`` (…, 3, 3).

        Example:
            >>> import numpy as np
            >>> from wbc.models.feet import Foot
            >>> Foot("toe", "point", 0.5, radius=0.02).lowest_in_world(np.array([0.0, 0.0, 0.1]), np.eye(3))
            array([[0.  , 0.  , 0.08]])
        """
        points, below = zip(*self.lowest(), strict=True)
        turned = np.array(points) @ np.swapaxes(rotation, -1, -2)
        return np.asarray(position[..., None, :] + turned - np.multiply.outer(below, [0.0, 0.0, 1.0]))
