"""Where a robot touches the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, final

from wbc.errors import ModelError
from wbc.models.geometry import Sphere, Triple
from wbc.models.urdf import Urdf


@final
@dataclass(frozen=True)
class Foot:
    """A flat ``sole`` or a round ``point`` fixed to ``frame``, and the friction it can be expected to have.

    sole    a rectangle in the x-y plane of the frame, centred at ``origin`` [m], ``half_size`` (x, y) [m]; where the
            sole is really a set of balls, ``balls`` are their centres and ``radius`` is theirs
    point   a ball of ``radius`` [m] centred at ``origin``
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


def sole_of_balls(urdf: Urdf, frame: str, friction: float) -> Foot:
    """The sole of a foot that stands on four balls, as the collision shapes of its link say.

    The rectangle is the largest that the four centres enclose, so a centre of pressure in it is one that the balls
    can give.

    Raises:
        ModelError: the link has not four balls of one size in one plane.
    """
    balls = [g for g in urdf.collisions if g.link == frame and isinstance(g.shape, Sphere)]
    centres = [g.origin.xyz for g in balls]
    radii = {g.shape.radius for g in balls if isinstance(g.shape, Sphere)}
    if len(balls) != 4 or len(radii) != 1 or len({z for _, _, z in centres}) != 1:
        raise ModelError(f"link {frame!r} does not stand on four balls of one size in one plane")
    radius, z = radii.pop(), centres[0][2]
    x_low, x_high = _inner([x for x, _, _ in centres])
    y_low, y_high = _inner([y for _, y, _ in centres])
    return Foot(
        frame,
        "sole",
        friction,
        origin=((x_low + x_high) / 2, (y_low + y_high) / 2, z - radius),
        half_size=((x_high - x_low) / 2, (y_high - y_low) / 2),
        radius=radius,
        balls=tuple(centres),
    )


def _inner(values: list[float]) -> tuple[float, float]:
    """The second smallest and third smallest of four: the sides of the inner rectangle."""
    _, low, high, _ = sorted(values)
    return low, high
