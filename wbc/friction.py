"""Friction pyramids: the circular cone ‖(f_x, f_y)‖ <= µ f_z with flat sides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from wbc import checks
from wbc.types import Mat

MODELS = ("inner", "outer")
SIDES = (4, 8)


@final
class Pyramid:
    """n_k · (f_x, f_y) <= ``mu`` f_z for ``sides`` unit normals n_k at equal angles, the first along x.

    ``model`` "inner": the pyramid touches the circular cone from inside, mu = µ cos(π / sides), so what it allows does
    not slip. "outer": from outside, mu = µ; along its edges it allows 1.41 µ (4 sides) or 1.08 µ (8 sides).

    Raises:
        InvalidInput: µ that is not positive, another model, a number of sides that is neither 4 nor 8.

    Example:
        >>> from wbc.friction import Pyramid
        >>> Pyramid(0.5, "outer", 4).rows
        array([[ 1. ,  0. , -0.5],
               [-1. ,  0. , -0.5],
               [ 0. ,  1. , -0.5],
               [ 0. , -1. , -0.5]])
    """

    def __init__(self, friction: float, model: str, sides: int, *, name: str = "") -> None:
        dot = f"{name}." if name else ""
        self.friction = checks.number(f"{dot}friction", friction, low=0.0, strict=True)
        self.model: str = checks.one_of(f"{dot}friction_model", model, MODELS)
        self.sides = int(checks.one_of(f"{dot}sides", sides, SIDES))
        self.mu = self.friction * (float(np.cos(np.pi / self.sides)) if model == "inner" else 1.0)

    @property
    def normals(self) -> Mat:
        """(sides, 2), in pairs of opposite ones: ±x, ±y, then the diagonals."""
        half = np.sqrt(0.5)
        axes = [(1.0, 0.0), (0.0, 1.0), (half, half), (half, -half)][: self.sides // 2]
        return np.array([(sign * x + 0.0, sign * y + 0.0) for x, y in axes for sign in (1.0, -1.0)])

    @property
    def names(self) -> list[str]:
        """What each side bounds."""
        axes = ["fx", "fy", "(fx + fy) / √2", "(fx - fy) / √2"][: self.sides // 2]
        return [sign + axis for axis in axes for sign in ("", "-")]

    @property
    def edges(self) -> Mat:
        """The forces (sides, 3) along the edges, with f_z = 1."""
        angles = np.pi * (2.0 * np.arange(self.sides) + 1.0) / self.sides
        reach = self.mu / np.cos(np.pi / self.sides)
        return np.column_stack([reach * np.cos(angles), reach * np.sin(angles), np.ones(self.sides)])

    @property
    def rows(self) -> Mat:
        """K (sides, 3) with K f <= 0 exactly the forces of a point."""
        return np.column_stack([self.normals, np.full(self.sides, -self.mu)])


def wrench_facets(wrenches: Mat, normal: int, scale: Sequence[float]) -> Mat:
    """K (k, d) with K w <= 0 exactly the sums of ``wrenches`` (m, d) with shares that are not negative.

    All have 1 at place ``normal``; ``scale`` (d,) is how large the others are. The facets are those of the convex hull
    in the plane where that place is 1.
    """
    from scipy.spatial import ConvexHull

    rest = [i for i in range(wrenches.shape[1]) if i != normal]
    unit = np.asarray(scale)[rest]
    planes = np.unique(ConvexHull(wrenches[:, rest] / unit).equations.round(9) + 0.0, axis=0)
    K = np.zeros((len(planes), wrenches.shape[1]))
    K[:, rest] = planes[:, :-1] / unit
    K[:, normal] = -(K @ wrenches.T).max(axis=1)  # each facet touches its wrenches to the last bit
    return K
