"""The certificate of a row problem, from the numbers that compiled code finds, and how far each task can be off."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import final

from wbc.qp.certificate import Certificate
from wbc.qp.rows.problem import RowProblem
from wbc.types import Vec

#: Primal, dual, gap, the scales of these two, distance and spread stand before what a unit of spread is of each row.
NUMBERS = 7


@final
class Proof:
    """Says what ``numbers`` prove: a copy of what :mod:`wbc.qp.rows.compiled.verify` wrote."""

    __slots__ = ("_numbers", "_owners")

    def __init__(self, numbers: Vec, owners: Mapping[str, list[int]]) -> None:
        self._numbers, self._owners = numbers, owners

    def __call__(self) -> Certificate:
        primal, dual, gap, scale_dual, scale_gap, distance, spread = self._numbers[:NUMBERS].tolist()
        bounds = Bounds(spread, self._numbers[NUMBERS:], self._owners)
        return Certificate(primal, dual, gap, scale_dual, scale_gap, -1, distance, 0.0, bounds)


@final
class Bounds(Mapping[str, float]):
    """How far each task can be from its optimum [unit of the task]; computed when it is read.

    ``reach`` (rows,) is how far a row moves per unit of ``spread``; ``owners`` says whose row it is.
    """

    __slots__ = ("_owners", "_reach", "_spread")

    def __init__(self, spread: float, reach: Vec, owners: Mapping[str, list[int]]) -> None:
        self._spread, self._reach, self._owners = spread, reach, owners

    def __getitem__(self, name: str) -> float:
        return self._spread * float(self._reach[self._owners[name]].max(initial=0.0))

    def __iter__(self) -> Iterator[str]:
        return iter(self._owners)

    def __len__(self) -> int:
        return len(self._owners)

    def __repr__(self) -> str:
        return repr({name: float(f"{bound:.3g}") for name, bound in self.items()})


def owners_of(p: RowProblem) -> dict[str, list[int]]:
    """Rows of each task among the soft rows and the unknowns y; without tasks, whose rows and unknowns they are."""
    found: dict[str, list[int]] = {}
    for level in p.levels:
        for task in level:
            at = task.rows or task.unknowns
            assert at is not None
            first = at.start - p.soft.start if task.rows else p.n_soft + at.start - p.n_u
            found.setdefault(task.name, []).extend(range(first, first + task.dim))
    if not found:
        names = [*p.rows[p.soft], *p.rows[p.n_rows + p.n_u :]]
        for i, row in enumerate(names):
            found.setdefault(row.owner, []).append(i)
    return found
