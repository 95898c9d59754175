"""Stages: the rows of a problem sorted by rank, so that what stands above a rank is one block of rows.

A *stage* is what is decided together: a level of a stack, or a part of one. Rows of the new problem:

    [base | range | last stage | … | second stage | first stage | equations]

so that all rows above stage k, and the equations, are the block behind stage k. The last stage is the cost that is
left when all others are settled: weighted rows, metric and centre, as in the problem it was made from.

A task that may be done in part gets one unknown σ in [0, ‖t‖∞], what is given up of it in its own unit, so that the
rows of a large and of a small task are alike, and two kinds of rows:

    direction   J x + drift − (1 − σ / ‖t‖∞) t = 0      the rest is done along t, in full or in part
    share       σ = 0, of weight (‖t‖_w / ‖t‖∞)²        nothing is given up

In the last stage the share is no row: σ has this weight in the metric.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.qp.lexicographic.compiled.stage import LAYOUT
from wbc.qp.lexicographic.parts import GIVEN_UP, Part, Stage
from wbc.qp.problem import Row
from wbc.qp.rows import RowProblem, RowTask
from wbc.types import Vec


@final
class StagedProblem:
    """A row problem whose rows stand in order of rank; compiled code brings it up to date with its source.

    ``problem`` is the last stage's: all stages above are equations of it. ``rows[k]`` is where stage k stands in its G,
    ``parts[k]`` where each task stands within that. Of the unknowns of the source it has the first ``kept``; the last
    ``without`` are zero. ``links`` leads to the memory of the levels and of the core; ``address`` is that of all this
    (:mod:`wbc.qp.lexicographic.compiled.stage`).
    """

    def __init__(self, source: RowProblem, stages: Sequence[Stage], without: int = 0) -> None:
        self.source, self.stages, self.kept = source, stages, source.n - without
        scaled = list({id(part.task): part.task for stage in stages for part in stage if part.kind != "whole"}.values())
        self._shares = {id(task): self.kept + i for i, task in enumerate(scaled)}
        upper = list(stages[:-1])
        # The unknowns that the last stage pulls on are in its metric and need no rows.
        last = [part for part in stages[-1] if part.kind == "whole" and part.task.rows is not None]
        every = [*upper, last]
        sizes = [sum(_size(part) for part in stage) for stage in every]
        self.problem = p = RowProblem(
            source.n_u, self.kept - source.n_u + len(scaled), n_range=source.n_range, n_soft=sizes[-1],
            n_equal=sum(sizes[:-1]) + source.n_equal, rows=self._names([last, *reversed(upper)], scaled),
            regularisation=source.regularisation,
        )  # fmt: skip
        p.units = source.units
        stops = p.equal.start + np.cumsum([0, *sizes[-2::-1]])
        self.rows = [*[slice(a, b) for a, b in pairwise(stops.tolist())][::-1], p.soft]
        #: Rows of each task within its stage.
        self.parts = [_places(stage) for stage in every]
        start = source.item(source.soft.start), p.item(p.soft.start)
        for side, mine in ((source.lower, p.lower), (source.upper, p.upper)):
            mine[p.n + 1 : start[1]] = side[source.n + 1 : start[0]]
        self._place(every, scaled)
        p.levels = [self._last_tasks(last)]

    def _names(self, stages: Sequence[Stage], scaled: Sequence[RowTask]) -> list[Row]:
        source = self.source
        names, found = source.rows, list[Row]()
        for stage in stages:
            for part in stage:
                task = part.task
                if part.kind == "share":
                    found.append(Row(f"{task.name}: share"))
                elif task.rows is not None:
                    found += names[task.rows]
                else:
                    assert task.unknowns is not None
                    first = source.n_rows + task.unknowns.start
                    found += [row._replace(owner=task.name) for row in names[first : first + task.dim]]
        first, last = names[: source.soft.start], names[source.equal.start : source.n_rows]
        unknowns = names[source.n_rows :][: self.kept]
        return [*first, *found, *last, *unknowns, *(Row(task.name, GIVEN_UP) for task in scaled)]

    def _place(self, stages: Sequence[Stage], scaled: Sequence[RowTask]) -> None:
        """Where each row comes from: a row of the source, an unknown, or what a task asks that is done in part."""
        p, source = self.problem, self.source
        row_of, weight = np.full(p.n_rows, -1), np.zeros(p.n_rows, dtype=np.int64)
        row_of[: p.soft.start] = np.arange(source.soft.start)
        row_of[p.n_rows - source.n_equal :] = np.arange(source.equal.start, source.equal.stop)
        divided = np.array(
            [[-1, task.dim, self._shares[id(task)], *map(address_of, (task.wanted, task.drift, task.weights)), -1]
             for task in scaled], dtype=np.int64,
        ).reshape(-1, 7)  # fmt: skip
        pulls, share = list[tuple[int, int, int]](), np.ones(len(divided))
        for stage, place in zip(stages, self.rows, strict=True):
            row = place.start
            for part in stage:
                task, at = part.task, slice(row, row + _size(part))
                row = at.stop
                of = divided[self._shares[id(task)] - self.kept] if part.kind != "whole" else None
                if part.kind == "share":
                    assert of is not None
                    of[-1], weight[at.start] = at.start, address_of(share[self._shares[id(task)] - self.kept :])
                    continue
                if of is not None:
                    of[0] = at.start
                weight[at] = address_of(task.weights) + 8 * np.arange(task.dim)
                if task.rows is not None:
                    row_of[at] = np.arange(task.rows.start, task.rows.stop)
                else:
                    assert task.unknowns is not None
                    wanted = address_of(task.wanted) + 8 * np.arange(task.dim)
                    pulls += zip(range(at.start, at.stop), range(source.n)[task.unknowns], wanted.tolist(), strict=True)
        self.links = np.zeros(4, dtype=np.int64)
        sizes = [source.n, source.n_y, source.n_rows, p.n_rows, len(pulls), len(divided), source.n - self.kept]
        self._share = share
        self._memory = Memory(*LAYOUT.arrays(
            np.array(sizes, dtype=np.int64), G=source.G, value=source.value, lower=source.lower, upper=source.upper,
            metric=source.metric, centre=source.centre, scale=source.scale, row=row_of, weight=weight,
            pulls=np.array(pulls, dtype=np.int64).reshape(-1, 3), parts=divided, share=share, links=self.links,
        ))  # fmt: skip
        self.address = self._memory.address
        self._asked = [part.task for stage in stages for part in stage]  # whose memory is read

    def _last_tasks(self, last: Stage) -> list[RowTask]:
        """The tasks of the last stage, where they stand here: in its rows, or in the metric."""
        p, found = self.problem, list[RowTask]()
        for part, place in zip(last, self.parts[-1].values(), strict=True):
            rows = slice(p.soft.start + place.start, p.soft.start + place.stop)
            one = np.ones(place.stop - place.start)
            found.append(RowTask(str(part), rows, None, one, one, one))
        for part in self.stages[-1]:
            if part.kind == "share":
                column = self._shares[id(part.task)]
                zero, weight = np.zeros(1), self._share[column - self.kept :][:1]
                found.append(RowTask(str(part), None, slice(column, column + 1), weight, zero, zero))
            elif part.task.rows is None:
                found.append(part.task)
        return found

    @np.errstate(all="ignore")
    def settle(self, k: int) -> None:
        """Let stage k and all below stay where they are: the last stage's cost is the distance from this point."""
        p = self.problem
        for rows in self.rows[k:-1]:
            left = p.value[p.item(rows.start) : p.item(rows.stop)]
            p.G[rows, p.n] -= left
            left[:] = 0.0
        p.centre[:] = p.x[p.n_u :]
        p.weights[:] = 0.0


def address_of(array: Vec) -> int:
    """Where a vector begins, whose numbers stand one beside the other."""
    assert array.strides == (8,), "a kernel reads it"
    return int(array.__array_interface__["data"][0])


def _places(stage: Stage) -> dict[str, slice]:
    """Where the rows of each part stand within its stage."""
    found, row = {}, 0
    for part in stage:
        found[str(part)] = slice(row, row + _size(part))
        row += _size(part)
    return found


def _size(part: Part) -> int:
    return 1 if part.kind == "share" else part.task.dim
