"""Tables of convex shapes, as kernels read them."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Any

import coal
import numpy as np

from wbc.types import Index, Mat, Vec

#: What of the shapes :class:`~wbc.models.compiled.gjk.Bodies` has, from ``is_cylinder`` to ``first``.
Tables = tuple[Index, Mat, Vec, Mat, Index, Index, Index]


def tables(shapes: Iterable[Any]) -> tuple[Tables, Vec]:
    """Of shapes of coal, as :func:`wbc.models.coal_.coal_shape` makes them; and of each the radius of a ball about its
    middle that holds it."""
    is_cylinder, sizes, rounds, corners, first, radii = [], [], [], [], [], []
    neighbours: list[list[int]] = []
    for shape in shapes:
        points, beside = _corners(shape)
        first.append(len(neighbours))
        neighbours += [[first[-1] + i for i in near] for near in beside]
        is_cylinder.append(isinstance(shape, coal.Cylinder))
        sizes.append((shape.radius, shape.halfLength) if is_cylinder[-1] else (0.0, 0.0))
        rounds.append(shape.radius if isinstance(shape, coal.Sphere) else 0.0)
        corners.append(points)
        radii.append(np.hypot(*sizes[-1]) + rounds[-1] + np.linalg.norm(points, axis=1).max())
    return (
        np.array(is_cylinder, dtype=np.int64), np.array(sizes), np.array(rounds), np.vstack(corners),
        np.cumsum([0, *map(len, neighbours)], dtype=np.int64),
        np.array([i for near in neighbours for i in near], dtype=np.int64), np.array(first, dtype=np.int64),
    ), np.array(radii)  # fmt: skip


def _corners(shape: Any) -> tuple[Mat, list[list[int]]]:
    """The corners of a shape and the neighbours of each."""
    if isinstance(shape, coal.Box):
        points = np.array(list(product((-1.0, 1.0), repeat=3))) * shape.halfSide
        return points, [[i ^ 1, i ^ 2, i ^ 4] for i in range(8)]
    if isinstance(shape, coal.ConvexBase):
        return np.array(shape.points()), [list(shape.neighbors(i)) for i in range(shape.num_points)]
    return np.zeros((1, 3)), [[]]
