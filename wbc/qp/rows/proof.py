"""The certificate of a row problem, from the numbers that compiled code finds, and how far each task can be off."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from wbc.qp.certificate import Bounds, Certificate
from wbc.qp.rows.problem import RowProblem

#: Primal, dual, gap, the scales of these two, distance and spread stand before what a unit of spread is of each row.
NUMBERS = 7


def proven(written: bytes, owners: Mapping[str, list[int]]) -> Certificate:
    """What the numbers prove that :mod:`wbc.qp.rows.compiled.verify` wrote, as bytes: they are kept in every tick."""
    numbers = np.frombuffer(written)
    primal, dual, gap, scale_dual, scale_gap, distance, spread = numbers[:NUMBERS].tolist()
    reach = numbers[NUMBERS:]  # how far a row moves per unit of ``spread``

    def bounds() -> Mapping[str, float]:
        return {name: spread * float(reach[rows].max(initial=0.0)) for name, rows in owners.items()}

    return Certificate(primal, dual, gap, scale_dual, scale_gap, -1, distance, 0.0, Bounds(bounds))


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
