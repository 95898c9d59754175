"""Rows of the lines of near pairs: distances with their derivatives by the velocities, each in the row it is given."""

from __future__ import annotations

from math import nan
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, entry
from wbc.models.compiled.nearest import LINES, pairs
from wbc.types import Index, Mat, Vec


class PairRows(NamedTuple):
    """So many rows (count) of the lines of pairs."""

    sizes: Annotated[Index, "3"]  # lines, count, nv
    row: Annotated[Index, "sizes[0]"]  # the row of each line, −1: none
    which: Annotated[Index, "count"]  # the pair of each row, −1: none
    distance: Annotated[Vec, "count"]
    jacobian: Annotated[Mat, "count, sizes[2]"]
    rate: Annotated[Vec, "count"]
    drift: Annotated[Vec, "count"]


LAYOUT = Layout(PairRows, count="sizes[1]")
_rows = LAYOUT.views


@entry
def write(at: int, to: int) -> int:
    """Write what :func:`~wbc.models.compiled.nearest.measure` has found to rows. What has none is left out.

    d = n·(b − a), so that ∂d/∂q = wᵀ J with w = (n, p × n), one line of force through the points a and b, and J the
    columns about the world's origin: those that move the second shape count +, those that move the first −.
    """
    s, r = pairs(at), _rows(to)
    for row in range(len(r.which)):
        r.which[row], r.distance[row], r.rate[row], r.drift[row] = -1, s.numbers[0], 0.0, 0.0 if s.sizes[6] else nan
        for c in range(len(s.v)):
            r.jacobian[row, c] = 0.0
    for i in range(s.sizes[5]):
        row = r.row[s.found[i]]
        if row >= 0:
            k, force = s.found[i] // LINES, s.force[i]
            first, second = s.pair[k, 0], s.pair[k, 1]
            r.which[row], r.distance[row] = k, s.line[s.found[i], 0]
            if s.sizes[6]:
                r.drift[row] = s.drift[i]
            for c in range(6):
                r.rate[row] += force[c] * (s.own[second, c] - s.own[first, c])
            for c in range(len(s.v)):
                sign = s.moved[second, c] - s.moved[first, c]
                if sign != 0.0:
                    for j in range(6):
                        r.jacobian[row, c] += sign * force[j] * s.columns[c, j]
    return 0
