"""Which pairs of shapes are near, and how near: compiled, with coal for what touches and for what has no proof."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.compiled import Memory
from wbc.models.coal_ import TIGHT, memory_of, placements
from wbc.models.compiled.nearest import AGAIN, BEGIN, measure
from wbc.models.convex import Tables
from wbc.types import Index, Mat, Vec

#: A distance [m] that is no answer, and the tolerance at which coal is asked again.
_ABSURD, _LOOSE = 1e6, 1e-6


@final
class NearPairs:
    """The collision pairs of a geometry that are near, in the order of their numbers.

    ``links`` numbers the pair of links of each pair of shapes: of two links those shapes count that are nearest, and
    others that are further by less than half the ``reach`` [m]. A pair that was far is not measured before its shapes
    have moved as far. With speeds a pair counts also within ``margin`` + 2 u ``ahead``, u its fastest approach.

    Placements are read from ``data``, and for :meth:`again` from ``beside``.
    """

    def __init__(
        self, model: Any, geometry: Any, links: Sequence[int], *, reach: float, margin: float, ahead: float
    ) -> None:
        self._geometry = geometry
        self.data, self.beside = memory_of(geometry), memory_of(geometry)
        tables = Tables.of([shape.geometry for shape in geometry.geometryObjects])
        n, m, joints, nv = geometry.ngeoms, len(geometry.collisionPairs), model.njoints, model.nv
        counts = np.array([n, len(tables.corners), len(tables.neighbours)], dtype=np.int64)
        work = np.zeros((4, 3)), np.zeros((4, 8)), np.zeros(4), np.zeros(4)
        here, there = placements(self.data), placements(self.beside)
        bodies, beside = (Memory(counts, where, *tables[:-1], *work) for where in (here, there))
        #: (m, 10): distance, normal from the first shape to the second and nearest points, of what was found last.
        self.line = np.zeros((m + 1, 10))
        #: (m,): of each pair its distance when it was measured last, and the ways of its shapes until then.
        self.measured = np.full(m, -np.inf)
        self._again, self._found, self._force = np.zeros(m), np.zeros(m, dtype=np.int64), np.zeros((m, 6))
        self._J, self._v = np.zeros((nv, 6)), np.zeros(nv)
        #: Of shapes that no joint carries (n, 6): linear about the world's origin, angular.
        self.twists = np.zeros((n, 6))
        self._sizes = np.array([n, m, max(links) + 1, joints, nv, 0, 0, 0, 0], dtype=np.int64)
        chosen = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs], dtype=np.int64)
        carriers = np.array([shape.parentJoint for shape in geometry.geometryObjects], dtype=np.int64)
        chain = np.array([list(model.parents), model.idx_vs, model.nvs], dtype=np.int64).T.copy()
        chain[0] = 0
        started = np.zeros((m, 4, 8)), np.full(m, -1, dtype=np.int64)
        rest = (
            chosen, np.array(links, dtype=np.int64), self.measured, np.zeros(m), self._again,
            np.zeros(m, dtype=np.int64), np.zeros(m), np.zeros(max(links) + 1), self.line, np.zeros((m + 1, 4, 8)),
            np.zeros(m, dtype=np.int64), *started, self._found, self._force, np.zeros(n), np.zeros((n, 12)),
            tables.radius, carriers, chain, self._J, self._v, np.zeros((joints, 6)), self.twists,
            np.array([reach, margin, ahead]), self._sizes,
        )  # fmt: skip
        self._memory, self._memory_beside = Memory(bodies.addresses, *rest), Memory(beside.addresses, *rest)
        self._kept = bodies, beside  # of which these have the addresses

    def read(self, J: Mat, v: Vec, *, speeds: bool) -> Index:
        """The numbers of the near pairs; ``J`` (6, nv) columns of the joints about the world's origin."""
        self._sizes[8] = speeds
        if speeds:
            self._J[:], self._v[:] = J.T, v
        address = self._memory.address
        self._sizes[6] = BEGIN
        while (pair := measure(address)) >= 0:
            self._ask(pair)
        return self._found[: self._sizes[7]].copy()

    def forces(self) -> Mat:
        """Lines of force (found, 6) along the normals through the nearest points, about the world's origin."""
        return self._force[: self._sizes[7]]

    def again(self, pairs: Index) -> Vec:
        """The distances of pairs that were found, where the shapes are in ``beside``."""
        n = len(pairs)
        self._found[:n], self._sizes[6], self._sizes[7] = pairs, AGAIN, n
        left = measure(self._memory_beside.address)
        distances = self._again[:n].copy()
        if left:
            for i in np.flatnonzero(np.isnan(distances)):
                distances[i] = self._measured(self.beside, int(pairs[i]))
        return distances

    def _ask(self, pair: int) -> None:
        """Let coal fill the line of a pair."""
        d = self._measured(self.data, pair)
        result = self.data.distanceResults[pair]
        self.line[pair] = (d, *result.normal, *result.getNearestPoint1(), *result.getNearestPoint2())

    def _measured(self, data: Any, pair: int) -> float:
        """The distance; to a looser tolerance where the tight one was too much.

        Where neither is enough, the shapes count as touching.
        """
        pin.computeDistance(self._geometry, data, pair)
        d = float(data.distanceResults[pair].min_distance)
        if -_ABSURD < d < _ABSURD:
            return d
        request = data.distanceRequests[pair]
        request.gjk_tolerance = _LOOSE
        pin.computeDistance(self._geometry, data, pair)
        request.gjk_tolerance = TIGHT
        d = float(data.distanceResults[pair].min_distance)
        return d if -_ABSURD < d < _ABSURD else 0.0
