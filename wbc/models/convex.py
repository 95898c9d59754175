"""Tables of convex shapes, as kernels read them."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Any, NamedTuple

import coal
import numpy as np

from wbc.types import Index, Mat, Vec


class Tables(NamedTuple):
    """n shapes, each about its middle: corners of hulls, of which a ball has one; a cylinder has none."""

    is_other: Index  # (n,): 1 for a cylinder
    size: Mat  # (n, 2): radius and half the length of a cylinder
    round: Vec  # (n,): radius of a ball
    corners: Mat  # (c, 3), of one shape behind the other
    edges: Index  # (c + 1,): where each corner's neighbours begin
    neighbours: Index
    seeds: Index  # (n, 24): the corners furthest along (±1, ±1, ±1), one component doubled; see ``gjk.support``
    radius: Vec  # (n,): of a ball about the middle that holds the shape

    @classmethod
    def of(cls, shapes: Iterable[Any]) -> Tables:
        """Of shapes of coal, as :func:`wbc.models.coal_.coal_shape` makes them."""
        is_other, sizes, rounds, corners, seeds, radii = [], [], [], [], [], []
        neighbours: list[list[int]] = []
        for shape in shapes:
            points, beside = _corners(shape)
            first = len(neighbours)
            neighbours += [[first + i for i in near] for near in beside]
            is_other.append(isinstance(shape, coal.Cylinder))
            sizes.append((shape.radius, shape.halfLength) if is_other[-1] else (0.0, 0.0))
            rounds.append(shape.radius if isinstance(shape, coal.Sphere) else 0.0)
            reach = np.hypot(*sizes[-1]) if is_other[-1] else rounds[-1]
            corners.append(points)
            seeds.append(first + np.argmax(_DIRECTIONS @ points.T, axis=1))
            radii.append(reach + np.linalg.norm(points, axis=1).max())
        edges = np.cumsum([0, *map(len, neighbours)])
        return cls(
            np.array(is_other, dtype=np.int64), np.array(sizes), np.array(rounds), np.vstack(corners),
            edges.astype(np.int64),
            np.array([i for near in neighbours for i in near], dtype=np.int64), np.array(seeds, dtype=np.int64),
            np.array(radii),
        )  # fmt: skip


#: By the largest component, then by which of x, y, z are negative.
_DIRECTIONS = np.array([
    [sign * (2.0 if axis == i else 1.0) for i, sign in enumerate((x, y, z))]
    for axis in range(3)
    for z, y, x in product((1.0, -1.0), repeat=3)
])  # fmt: skip


def _corners(shape: Any) -> tuple[Mat, list[list[int]]]:
    """The corners of a shape and the neighbours of each."""
    if isinstance(shape, coal.Box):
        points = np.array(list(product((-1.0, 1.0), repeat=3))) * shape.halfSide
        return points, [[i ^ 1, i ^ 2, i ^ 4] for i in range(8)]
    if isinstance(shape, coal.ConvexBase):
        return np.array(shape.points()), [list(shape.neighbors(i)) for i in range(shape.num_points)]
    return np.zeros((1, 3)), [[]]
