"""Which pairs of shapes are near, and how near: compiled, with coal for what touches and for what has no proof."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from wbc.compiled import Memory
from wbc.models.coal_ import Answers, memory_of, placements
from wbc.models.compiled import nearest
from wbc.models.compiled.nearest import LINES
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
        n, m, joints = geometry.ngeoms, len(geometry.collisionPairs), model.njoints
        counts = np.array([n, len(shapes[3]), len(shapes[5])], dtype=np.int64)
        work = np.zeros((4, 3)), np.zeros((4, 8)), np.zeros(4), np.zeros(4), np.zeros(12)
        self._bodies = Memory(counts, placements(self.data), *shapes, *work, np.zeros((2, 4, 3)), np.zeros((4, 6)))
        #: The shapes of each pair (m, 2).
        self.pairs = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs], dtype=np.int64)
        carrier = np.array([shape.parentJoint for shape in geometry.geometryObjects])
        self._pairs = pairs = nearest.LAYOUT.arrays(
            np.array([n, m, max(links) + 1, 0, 0, 0, 0, joints, model.nv, self._bodies.address]), pair=self.pairs,
            links=np.array(links), measured=np.full(m, -np.inf), starts=np.full(m, -1), radius=radius, carrier=carrier,
            parent=np.array(model.parents, dtype=np.int64), begin=np.array([0, *list(model.idx_vs)[1:], model.nv]),
            moved=np.array([_moved_by(model, joint) for joint in carrier.tolist()]),
            numbers=np.array([reach, margin, ahead, close]),
        )  # fmt: skip
        self._memory = Memory(*pairs)
        #: (m LINES, 10): distance, direction from the first shape to the second and both points, as found last.
        self.line = pairs.line
        #: (m,): of each pair its distance when it was measured last, and the ways of its shapes until then.
        self.measured = pairs.measured
        #: ``reach``, ``margin``, ``ahead`` and ``close``.
        self.numbers = pairs.numbers
        #: Twists of shapes that are no robot's, and their derivatives (n, 12), about the world's origin.
        self.own = pairs.own

    def forget(self) -> None:
        """Have the next reading measure all pairs."""
        self.measured.fill(-np.inf)

    def read(self, J: Mat, v: Vec, *, speeds: bool) -> Index:
        """The numbers of the lines of near pairs; ``J`` (6, nv) columns of the joints about the world's origin."""
        pairs = self._pairs
        pairs.columns[:], pairs.v[:] = J.T, v
        pairs.sizes[4], pairs.sizes[6] = nearest.BEGIN, speeds
        while (pair := nearest.measure(self._memory.address)) >= 0:
            self.line[pair * LINES, 0] = self._here.of(pair)
            self.line[pair * LINES, 1:] = self._here.lines[pair]
        return pairs.found[: pairs.sizes[5]].copy()

    @property
    def soon(self) -> Vec:
        """How near what was found will be (found,) [m] after ``ahead``, at the velocity of now."""
        return self._pairs.soon[: self._pairs.sizes[5]]

    def write_to(self, rows: PairRows) -> None:
        """Where :meth:`write` writes."""
        self._rows = Memory(*rows)

    def write(self) -> None:
        """Write what was found to the rows."""
        write(self._memory.address, self._rows.address)


def _moved_by(model: Any, joint: int) -> Vec:
    """1 for each velocity that moves ``joint``."""
    moved = np.zeros(model.nv)
    for carrier in list(model.supports[joint])[1:]:
        moved[model.idx_vs[carrier] :][: model.nvs[carrier]] = 1.0
    return moved
