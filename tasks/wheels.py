"""A wheel on level ground: what rolling tasks share."""

from __future__ import annotations

from typing import Any, final

from wbc import checks
from wbc.models import plausible

from .directions import unit_axis


def height(name: str, value: Any) -> float | None:
    """The height of the ground [m]; None: it has none.

    Raises:
        InvalidInput: not a finite number.
    """
    return None if value is None else checks.number(name, value)


@final
class Wheel:
    """A disc of ``radius`` [m] about the origin of ``frame``, which turns with it about ``axle`` (3,).

    With a the axle in the world, n the ground's normal z, c = n·a and s = √(1 − c²): the point on the ground is
    p − radius m, m = (n − c a) / s; the heading is t = a × n / s, across it l = n × t. A wheel that lies nearly flat,
    s < 1e-3, has no heading, and counts as leaning by that.

    Raises:
        InvalidInput: a radius that is not positive, an axle that is zero.
    """

    __slots__ = ("axle", "frame", "radius")

    def __init__(self, name: str, frame: str, radius: float, axle: Any) -> None:
        self.frame = frame
        self.radius = checks.number(f"{name}.radius", radius, low=0.0, strict=True)
        plausible.extent(f"{name}.radius", self.radius)
        self.axle = unit_axis(f"{name}.axle", axle)

    def numbers(self, ground: float | None) -> list[float]:
        """What the kernel "wbc.tasks.compiled.frame:wheel" reads of it."""
        return [*self.axle.tolist(), self.radius, ground or 0.0]
