"""Stages: the rows of a problem sorted by rank, so that what stands above a rank is one block of rows.

A *stage* is what is decided together: a level of a stack, or a part of one. Rows of the new problem:

    [base | range | last stage | … | second stage | first stage | laws]

so that all rows above stage k, and the laws, are the block behind stage k. The last stage is the cost that is left when
all others are settled: weighted rows, metric and centre, as in the problem it was made from.

A wish that may be done in part gets one unknown σ in [0, ‖t‖∞], what is given up of it in its own unit, so that the
rows of a large and of a small wish are alike, and two kinds of rows:

    direction   J x + drift − (1 − σ / ‖t‖∞) t = 0      the rest is done along t, in full or in part
    share       ‖t‖_w / ‖t‖∞ σ = 0                      nothing is given up
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple, final

import numpy as np
from scipy.linalg.blas import dgemv

from wbc.qp.problem import Row
from wbc.qp.rows import RowProblem, Wish
from wbc.types import Vec

#: Largest residual, in the rows' own units, of a stage that counts as met.
MET = 1e-6
#: A wish smaller than this is met by any part of it, but its share still has a place among the others.
_LEAST_SHARE = 1e-6


@final
@dataclass(frozen=True, eq=False)
class Part:
    """What a stage says about one wish: all of it, the direction alone, or the share alone."""

    wish: Wish
    kind: Literal["whole", "direction", "share"] = "whole"

    def __str__(self) -> str:
        return self.wish.name if self.kind == "whole" else f"{self.kind} of {self.wish.name}"


Stage = Sequence[Part]


class Pull(NamedTuple):
    """What damps a stage while it is decided, ½ Σ ``share`` wⱼ (yⱼ − tⱼ)² on a part of y; no stage below keeps it.

    ``weights`` and ``wanted`` are views that follow the plan; where all weights are 0 nothing is damped.
    """

    columns: slice
    weights: Vec
    wanted: Vec
    share: float


@final
class StagedProblem:
    """A row problem whose rows stand in order of rank; ``fill`` brings it up to date with its source.

    ``problem`` is the last stage's: all stages above are laws of it. ``rows[k]`` is where stage k stands in its G,
    ``weights[k]`` how its rows weigh against one another.
    """

    def __init__(self, source: RowProblem, stages: Sequence[Stage]) -> None:
        self.source, self.stages = source, stages
        scaled = list({id(part.wish): part.wish for stage in stages for part in stage if part.kind != "whole"}.values())
        self._shares = {id(wish): source.n + i for i, wish in enumerate(scaled)}
        upper = list(stages[:-1])
        # The unknowns that the last stage pulls on are in its metric and need no rows.
        last = [part for part in stages[-1] if part.kind == "share" or part.wish.rows is not None]
        if source.n_u:  # nothing is left out of the cost where u is eliminated
            none, weights = np.zeros(source.n_u), np.full(source.n_u, source.regularisation)
            last.append(Part(Wish("regularisation", None, slice(0, source.n_u), weights, none, none)))
        sizes = [sum(_size(part) for part in stage) for stage in [*upper, last]]
        n_soft, n_law = sizes[-1], sum(sizes[:-1]) + source.n_law
        names = self._names([last, *reversed(upper)])
        p = RowProblem(
            source.n_u, source.n_y + len(scaled), n_range=source.n_range, n_soft=n_soft, n_law=n_law,
            rows=names, regularisation=0.0,
        )  # fmt: skip
        self.problem, self._plain = p, not scaled
        stops = p.law.start + np.cumsum([0, *sizes[-2::-1]])
        self.rows = [*[slice(a, b) for a, b in pairwise(stops.tolist())][::-1], p.soft]
        self.weights = [np.ones(size) for size in sizes]
        self._order = np.arange(p.n_rows)
        self._order[: p.soft.start] = np.arange(source.soft.start)
        self._order[p.n_rows - source.n_law : p.n_rows] = np.arange(source.law.start, source.law.stop)
        self._order[p.soft.start : p.n_rows - source.n_law] = 0
        self._place(list(zip([*upper, last], self.rows, self.weights, strict=True)))
        #: Rows of each task within its stage.
        self.parts = [_places(stage) for stage in [*upper, last]]
        p.levels = [self._last_wishes(last)]
        self._buffer = np.zeros((0 if self._plain else p.n_rows, source.n + 1))
        self._version = -1
        self._ends = source.item(source.soft.start), p.item(p.soft.start)
        for side, mine in ((source.lower, p.lower), (source.upper, p.upper)):
            mine[source.n + len(scaled) + 1 : self._ends[1]] = side[source.n + 1 : self._ends[0]]

    def _names(self, stages: Sequence[Stage]) -> list[Row]:
        source = self.source
        names, found = source.rows, list[Row]()
        for stage in stages:
            for part in stage:
                wish = part.wish
                if part.kind == "share":
                    found.append(Row(f"{wish.name}: share"))
                elif wish.rows is not None:
                    found += names[wish.rows]
                else:
                    assert wish.unknowns is not None
                    first = source.n_rows + wish.unknowns.start
                    found += [row._replace(owner=wish.name) for row in names[first : first + wish.dim]]
        first, last = names[: source.soft.start], names[source.law.start : source.n_rows]
        given_up = [Row("given up", stage_name(self._shares, key, stages)) for key in self._shares]
        return [*first, *found, *last, *names[source.n_rows :], *given_up]

    def _place(self, stages: Sequence[tuple[Stage, slice, Vec]]) -> None:
        """Where each part stands, and what has to be written there besides the rows of the source."""
        p, source = self.problem, self.source
        self._weighed: list[tuple[Vec, Wish]] = []
        self._pulls: list[tuple[slice, Wish]] = []
        self._directions: list[tuple[Vec, Wish]] = []
        self._lengths: list[tuple[int, int, Wish]] = []
        for stage, place, weights in stages:
            row = place.start
            for part in stage:
                wish, at = part.wish, slice(row, row + _size(part))
                if part.kind == "share":
                    self._lengths.append((row, self._shares[id(wish)], wish))
                else:
                    self._weighed.append((weights[at.start - place.start : at.stop - place.start], wish))
                    if wish.rows is not None:
                        self._order[at] = np.arange(wish.rows.start, wish.rows.stop)
                    else:
                        self._pulls.append((at, wish))
                    if part.kind == "direction":
                        self._directions.append((p.G[at, self._shares[id(wish)]], wish))
                row = at.stop
        self._n = source.n
        self._source_rows_T = source.G[: source.n_rows].T
        self._source_values = source.value[source.first_row : source.item(source.n_rows)]

    def _last_wishes(self, last: Stage) -> list[Wish]:
        """The tasks of the last stage, where they stand here: in its rows, or in the metric."""
        p, found = self.problem, list[Wish]()
        for part, place in zip(last, self.parts[-1].values(), strict=True):
            rows = slice(p.soft.start + place.start, p.soft.start + place.stop)
            one = np.ones(place.stop - place.start)
            found.append(Wish(str(part), rows, None, one, one, one))
        pulling = [part.wish for part in self.stages[-1] if part.kind != "share" and part.wish.rows is None]
        return found + pulling

    def fill(self) -> None:
        """Take over rows, bounds, weights, metric and centre as they are now."""
        source, p, n = self.source, self.problem, self._n
        rows = p.G[: p.n_rows]
        if source.version != self._version:
            self._read_weights()
        if self._plain:
            source.G.take(self._order, 0, rows, "clip")
        else:
            source.G.take(self._order, 0, self._buffer, "clip")
            rows[:, :n] = self._buffer[:, :n]
            rows[:, n : p.n] = 0.0
            rows[:, p.n] = self._buffer[:, n]
        for at, wish in self._pulls:
            assert wish.unknowns is not None
            rows[at] = 0.0
            rows[: p.soft.start, wish.unknowns] /= source.scale[wish.unknowns]
            np.fill_diagonal(rows[at, wish.unknowns], 1.0)
            rows[at, p.n] = -wish.wanted
        for column, wish in self._directions:
            np.add(wish.wanted, wish.drift, column)
            length = max(float(np.abs(column).max(initial=0.0)), _LEAST_SHARE)
            p.ub[self._shares[id(wish)]] = length
            column /= length
        for row, share, wish in self._lengths:
            rows[row] = 0.0
            asked = wish.wanted + wish.drift
            whole = max(float(np.sqrt((wish.weights * asked * asked).sum())), _LEAST_SHARE)
            rows[row, share] = whole / max(float(np.abs(asked).max(initial=0.0)), _LEAST_SHARE)
        start, stop = self._ends
        for side, mine in ((source.lower, p.lower), (source.upper, p.upper)):
            mine[:n] = side[:n]
            mine[p.n + 1 : stop] = side[n + 1 : start]
        p.lb[n:] = 0.0
        p.centre[: source.n_y] = source.centre

    def _read_weights(self) -> None:
        source, p = self.source, self.problem
        for weights, wish in self._weighed:
            weights[:] = wish.weights
        p.weights[:] = self.weights[-1]
        p.metric[: source.n_y], p.scale[: source.n] = source.metric, source.scale
        for (
            _,
            wish,
        ) in self._pulls:  # their rows say what they are worth; scaled by it they would be stiffer than others
            p.scale[wish.unknowns] = 1.0
        p.unit = source.unit
        p.version += 1
        self._version = source.version

    def residual(self, k: int) -> Vec:
        """What the rows of stage k come to now, beside what they are held at."""
        p, rows = self.problem, self.rows[k]
        return p.value[p.item(rows.start) : p.item(rows.stop)].copy()

    def hold(self, k: int) -> Vec:
        """From here on the rows of stage k are laws that ask for what they have now: their residual, before."""
        p, rows = self.problem, self.rows[k]
        residual = self.residual(k)
        p.G[rows, p.n] -= residual
        p.value[p.item(rows.start) : p.item(rows.stop)] = 0.0
        return residual

    def settle(self, k: int) -> None:
        """Let stage k and all below stay where they are: the last stage's cost is the distance from this point."""
        p = self.problem
        for i in range(k, len(self.stages) - 1):
            self.hold(i)
        p.centre[:] = p.x[p.n_u :]
        p.weights[:] = 0.0
        self._version = -1

    def give_back(self) -> None:
        """Write the answer where the source keeps its own."""
        source, p = self.source, self.problem
        source.x[:] = p.x[: source.n]
        for _, wish in self._pulls:
            source.x[wish.unknowns] /= source.scale[wish.unknowns]
        dgemv(1.0, self._source_rows_T, source.x1, 0.0, self._source_values, 0, 1, 0, 1, 1, 1)


def _places(stage: Stage) -> dict[str, slice]:
    """Where the rows of each part stand within its stage."""
    found, row = {}, 0
    for part in stage:
        found[str(part)] = slice(row, row + _size(part))
        row += _size(part)
    return found


def _size(part: Part) -> int:
    return 1 if part.kind == "share" else part.wish.dim


def stage_name(shares: dict[int, int], key: int, stages: Sequence[Stage]) -> str:
    """Name of the wish that an unknown share belongs to."""
    return next(part.wish.name for stage in stages for part in stage if id(part.wish) == key)
