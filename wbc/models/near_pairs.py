"""Which pairs of shapes are near, and how near: compiled, with coal for what touches and for what has no proof."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from wbc.compiled import Memory
from wbc.models.coal_ import Answers, memory_of, placements
from wbc.models.compiled.nearest import BEGIN, LINES, measure
from wbc.models.compiled.pair_rows import PairRows, write
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

    Placements are read from ``data``.
    """

    def __init__(
        self, model: Any, geometry: Any, links: Sequence[int], *, reach: float, margin: float, ahead: float,
        close: float = -np.inf,
    ) -> None:  # fmt: skip
        self.data = memory_of(geometry)
        self._here = Answers(geometry, self.data)
        shapes, radius = tables(shape.geometry for shape in geometry.geometryObjects)
        n, m, n_links, joints = geometry.ngeoms, len(geometry.collisionPairs), max(links) + 1, model.njoints
        counts = np.array([n, len(shapes[3]), len(shapes[5])], dtype=np.int64)
        work = np.zeros((4, 3)), np.zeros((4, 8)), np.zeros(4), np.zeros(4), np.zeros(12)
        self._bodies = Memory(counts, placements(self.data), *shapes, *work, np.zeros((2, 4, 3)), np.zeros((4, 6)))
        #: (m LINES, 10): distance, direction from the first shape to the second and both points, as found last.
        self.line = np.zeros((m * LINES, 10))
        #: (m,): of each pair its distance when it was measured last, and the ways of its shapes until then.
        self.measured = np.full(m, -np.inf)
        self._found = np.zeros(m * LINES, dtype=np.int64)
        self._force, self._drift, self._soon = np.zeros((m * LINES, 6)), np.zeros(m * LINES), np.zeros(m * LINES)
        #: Twists of shapes that are no robot's, and their derivatives (n, 12), about the world's origin.
        self.own = np.zeros((n, 12))
        self._sizes = np.array([n, m, n_links, 0, 0, 0, 0, joints, model.nv], dtype=np.int64)
        #: The shapes of each pair (m, 2).
        self.pairs = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs], dtype=np.int64)
        carrier = [shape.parentJoint for shape in geometry.geometryObjects]
        begin = np.array([0, *list(model.idx_vs)[1:], model.nv], dtype=np.int64)
        self._columns, self._v = np.zeros((model.nv, 6)), np.zeros(model.nv)
        self._memory = Memory(
            self._bodies.addresses, self.pairs, np.array(links, dtype=np.int64), self.measured, np.zeros(m),
            np.zeros(m), np.zeros(m, dtype=np.int64), np.zeros(m), np.zeros(n_links), self.line,
            np.zeros((m + 1, 4, 8)), np.zeros(m, dtype=np.int64), np.zeros((m, 4, 8)), np.full(m, -1, dtype=np.int64),
            self._found, self._force, self._drift, self._soon, np.zeros(n), np.zeros((n, 12)), radius,
            np.zeros((n, 6)), np.zeros((n, 6)), self.own, np.array(carrier, dtype=np.int64),
            np.array(model.parents, dtype=np.int64), begin, self._columns, self._v, np.zeros((joints, 12)),
            np.array([_moved_by(model, joint) for joint in carrier]), np.array([reach, margin, ahead, close]),
            self._sizes,
        )  # fmt: skip

    def forget(self) -> None:
        """Have the next reading measure all pairs."""
        self.measured.fill(-np.inf)

    def read(self, J: Mat, v: Vec, *, speeds: bool) -> Index:
        """The numbers of the lines of near pairs; ``J`` (6, nv) columns of the joints about the world's origin."""
        self._columns[:], self._v[:] = J.T, v
        self._sizes[4], self._sizes[6] = BEGIN, speeds
        while (pair := measure(self._memory.address)) >= 0:
            self.line[pair * LINES, 0] = self._here.of(pair)
            self.line[pair * LINES, 1:] = self._here.lines[pair]
        return self._found[: self._sizes[5]].copy()

    @property
    def soon(self) -> Vec:
        """How near what was found will be (found,) [m] after ``ahead``, at the velocity of now."""
        return self._soon[: self._sizes[5]]

    def write_to(self, rows: PairRows) -> None:
        """Where :meth:`write` writes."""
        self._rows = Memory(np.array([len(rows.row), *rows.jacobian.shape], dtype=np.int64), *rows)

    def write(self) -> None:
        """Write what was found to the rows."""
        write(self._memory.address, self._rows.address)


def _moved_by(model: Any, joint: int) -> Vec:
    """1 for each velocity that moves ``joint``."""
    moved = np.zeros(model.nv)
    for carrier in list(model.supports[joint])[1:]:
        moved[model.idx_vs[carrier] :][: model.nvs[carrier]] = 1.0
    return moved
