"""Which pairs of shapes are near, and how near: compiled, with coal for what touches and for what has no proof."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from wbc.compiled import Memory
from wbc.models.coal_ import Answers, memory_of, placements
from wbc.models.compiled.nearest import AGAIN, BEGIN, LINES, measure
from wbc.models.convex import tables
from wbc.types import Index, Mat, Vec


@final
class NearPairs:
    """The collision pairs of a geometry that are near, in the order of their numbers.

    ``links`` numbers the pair of links of each pair of shapes: of two links those shapes count that are nearest, and
    others that are further by less than half the ``reach`` [m]. A pair that was far is not measured before its shapes
    have moved as far. With speeds a pair counts also within ``margin`` + 2 u ``ahead``, u its fastest approach.

    A pair has a line through its nearest points, and where it is nearer than ``close`` [m] others, as in
    :mod:`wbc.models.compiled.turned`: line j of pair k has the number k ``LINES`` + j.

    Placements are read from ``data``, and for :meth:`again` from ``beside``.
    """

    def __init__(
        self, model: Any, geometry: Any, links: Sequence[int], *, reach: float, margin: float, ahead: float,
        close: float = -np.inf,
    ) -> None:  # fmt: skip
        self.data, self.beside = memory_of(geometry), memory_of(geometry)
        self._here, self._beside = Answers(geometry, self.data), Answers(geometry, self.beside)
        shapes, radius = tables(shape.geometry for shape in geometry.geometryObjects)
        n, m = geometry.ngeoms, len(geometry.collisionPairs)
        counts = np.array([n, len(shapes[3]), len(shapes[5])], dtype=np.int64)
        work = np.zeros((4, 3)), np.zeros((4, 8)), np.zeros(4), np.zeros(4), np.zeros(12)
        here, there = placements(self.data), placements(self.beside)
        bodies, beside = (Memory(counts, where, *shapes, *work) for where in (here, there))
        #: (m LINES + 1, 10): distance, direction from the first shape to the second and both points, as found last.
        self.line = np.zeros((m * LINES + 1, 10))
        #: (m,): of each pair its distance when it was measured last, and the ways of its shapes until then.
        self.measured = np.full(m, -np.inf)
        n_lines = m * LINES
        self._again, self._found = np.zeros(n_lines), np.zeros(n_lines, dtype=np.int64)
        self._force = np.zeros((n_lines, 6))
        #: Velocities (n, 6) of shapes that are no robot's: linear about the world's origin, angular.
        self.own, self._twists = np.zeros((n, 6)), np.zeros((n, 6))
        self._sizes = np.array([n, m, max(links) + 1, 0, 0, 0, 0], dtype=np.int64)
        #: The shapes of each pair (m, 2), and 1 for each velocity that moves a shape (n, nv).
        self.pairs = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs], dtype=np.int64)
        self.moved = np.array([_moved_by(model, shape.parentJoint) for shape in geometry.geometryObjects])
        started = np.zeros((m, 4, 8)), np.full(m, -1, dtype=np.int64)
        rest = (
            self.pairs, np.array(links, dtype=np.int64), self.measured, np.zeros(m), self._again,
            np.zeros(m, dtype=np.int64), np.zeros(m), np.zeros(max(links) + 1), self.line, np.zeros((m + 1, 4, 8)),
            np.zeros(m, dtype=np.int64), *started, self._found, self._force, np.zeros(n), np.zeros((n, 12)),
            radius, self._twists, np.array([reach, margin, ahead, close]), self._sizes,
        )  # fmt: skip
        self._memory, self._memory_beside = Memory(bodies.addresses, *rest), Memory(beside.addresses, *rest)
        self._kept = bodies, beside  # of which these have the addresses

    def read(self, J: Mat, v: Vec, *, speeds: bool) -> Index:
        """The numbers of the lines of near pairs; ``J`` (6, nv) columns of the joints about the world's origin."""
        self._twists[:] = self.own + (self.moved * v) @ J.T
        self._sizes[4], self._sizes[6] = BEGIN, speeds
        while (pair := measure(self._memory.address)) >= 0:
            self.line[pair * LINES, 0] = self._here.of(pair)
            self.line[pair * LINES, 1:] = self._here.lines[pair]
        return self._found[: self._sizes[5]].copy()

    @property
    def force(self) -> Mat:
        """The lines of force (found, 6) along what was found, from the first shape to the second."""
        return self._force[: self._sizes[5]]

    def again(self, lines: Index) -> Vec:
        """The distances along lines that were found, where the shapes are in ``beside``."""
        n = len(lines)
        self._found[:n], self._sizes[4], self._sizes[5] = lines, AGAIN, n
        left = measure(self._memory_beside.address)
        distances = self._again[:n].copy()
        if left:
            for i in np.flatnonzero(np.isnan(distances)):
                distances[i] = self._beside.of(int(lines[i]) // LINES)
        return distances


def _moved_by(model: Any, joint: int) -> Vec:
    """1 for each velocity that moves ``joint``."""
    moved = np.zeros(model.nv)
    for carrier in list(model.supports[joint])[1:]:
        moved[model.idx_vs[carrier] :][: model.nvs[carrier]] = 1.0
    return moved
