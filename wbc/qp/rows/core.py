"""The core: one compiled working-set loop for a row problem, with a certificate of what it answers.

What it computes is told in four pages: :mod:`~wbc.qp.rows.compiled.equality` (the equality problem of a working set),
:mod:`~wbc.qp.rows.compiled.verify` (the verdict), :mod:`~wbc.qp.rows.compiled.finite` (the finite method) and
:mod:`~wbc.qp.rows.compiled.search` (the loop). This one owns their memory.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import numpy as np

from wbc.compiled import Memory, place_of
from wbc.qp.certificate import Bounds, Certificate
from wbc.qp.rows.compiled.search import answer
from wbc.qp.rows.compiled.work import INACCURATE, INFEASIBLE, LAYOUT, ROWS, SOLVED, VARIABLES
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.solver import RowSolver
from wbc.tolerances import SHARP
from wbc.types import Index, Status, Vec

#: Products in the row form, above which the form in the unknowns is cheaper whatever their numbers.
_PAYS = 3e5
#: Weight of a row beside the metric, beyond which the row form loses its digits.
_LIGHT = 1.0 / SHARP
#: Primal, dual, gap, the scales of these two, distance and spread stand before what a unit of spread is of each row.
_NUMBERS = 7
#: What kernels say of an answer; FAILED whatever else they say.
STATUS = {SOLVED: Status.SOLVED, INACCURATE: Status.INACCURATE, INFEASIBLE: Status.INFEASIBLE}
_FAILED = Status.FAILED  # members of an Enum are slow to look up in a tick


@final
class CoreSolver(RowSolver):
    """Guess, verify, exchange, and a finite method, in one compiled call; no other solver is called.

    ``form`` says which factorisation the problem's sizes and weights chose: "rows" or "variables".
    """

    is_compiled = True

    def __init__(self, problem: RowProblem) -> None:
        super().__init__(problem)
        p = problem
        #: Multipliers of the last answer over ``unit``: of rows [B; R; S; L], and of the bounds on x.
        self.push, self.z = np.zeros(p.n_rows), np.zeros(p.n)
        self._owners = _owners_of(p)
        self.form = "rows" if fits_rows(p) else "variables"
        form = ROWS if self.form == "rows" else VARIABLES
        sizes = np.array([p.n_u, p.n_y, p.n_range, p.n_soft, p.n_equal, form, 0, 0, 0], dtype=np.int64)
        self._report = np.zeros(_NUMBERS + p.n_soft + p.n_y)
        proof, reach = np.split(self._report, (_NUMBERS,))
        memory = LAYOUT.arrays(
            sizes, G=p.G, value=p.value, lower=p.lower, upper=p.upper, metric=p.metric, centre=p.centre, scale=p.scale,
            given=p.weights, reach=reach, push=self.push, z=self.z, proof=proof, unit=p.units,
            numbers=np.array([p.regularisation, 0.0, 0.0]),
        )  # fmt: skip
        self._memory, self._side, self._sizes = Memory(*memory), memory.side, sizes
        self.address = self._memory.address
        self.kernel = place_of(answer), self.address
        # Where each item stands in ``value``.
        first = p.first_row
        self.places = np.concatenate([
            np.arange(p.n_u, p.n), np.arange(first + p.range.start, first + p.range.stop),
            np.arange(first + p.equal.start, first + p.equal.stop),
        ]).astype(np.intp)  # fmt: skip
        self._bounded = p.n_y + p.n_range

    def solve(self) -> Status:
        return self.concluded(answer(self.address))

    def concluded(self, code: int) -> Status:
        guesses, steps = self._sizes.item(7), self._sizes.item(8)
        self.iterations = guesses + steps
        self.counts.add(guesses, steps)
        status = STATUS.get(code, _FAILED)
        if status is not _FAILED and code != INFEASIBLE:
            numbers, owners = self._report.tobytes(), self._owners
            self.proof = lambda: _proven(numbers, owners)
        else:
            self.reset()
            self.certificate = Certificate.none()
        return status

    @property
    def work(self) -> tuple[int, int]:
        """Guesses of the last answer, and steps of the finite method after them."""
        return self._sizes.item(7), self._sizes.item(8)

    def reset(self) -> None:
        self._side.fill(0.0)

    def working_set(self) -> tuple[Index, Vec]:
        held = np.flatnonzero(self._side[: self._bounded])
        return self.places[held], self._side[held]

    def guess(self, items: Index, side: Vec) -> None:
        self._side.fill(0.0)
        p = self.problem
        rows = items >= p.n
        self._side[np.where(rows, items - p.first_row - p.n_u + p.n_y, items - p.n_u)] = side

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        p, push = self.problem, self.problem.unit * self.push
        return np.concatenate([push[p.base], push[p.equal]]), push[p.range], p.unit * self.z / p.scale


def fits_rows(problem: RowProblem) -> bool:
    """Whether the row form is right and pays.

    It pays with fewer rows than unknowns, and as long as its products stay few. It is right while no row weighs so much
    more than the metric that rounding of K hides the metric.
    """
    p, rows = problem, problem.n_u + problem.n_soft + problem.n_equal
    pays = rows < p.n_y or rows**2 * (rows / 3.0 + p.n_y) < _PAYS
    heavy = float(p.weights.max(initial=0.0)) > _LIGHT * p.unit * float(p.metric.min(initial=np.inf))
    return pays and not heavy


def _proven(written: bytes, owners: Mapping[str, list[int]]) -> Certificate:
    """What the numbers prove that :mod:`wbc.qp.rows.compiled.verify` wrote, as bytes: they are kept in every tick."""
    numbers = np.frombuffer(written)
    primal, dual, gap, scale_dual, scale_gap, distance, spread = numbers[:_NUMBERS].tolist()
    reach = numbers[_NUMBERS:]  # how far a row moves per unit of ``spread``

    def bounds() -> Mapping[str, float]:
        return {name: spread * float(reach[rows].max(initial=0.0)) for name, rows in owners.items()}

    return Certificate(primal, dual, gap, scale_dual, scale_gap, distance, 0.0, Bounds(bounds))


def _owners_of(p: RowProblem) -> dict[str, list[int]]:
    """Rows of each task among the soft rows and the unknowns y; without tasks, whose rows and unknowns they are."""
    found: dict[str, list[int]] = {}
    for task in p.tasks:
        at = task.rows or task.unknowns
        assert at is not None
        first = at.start - p.soft.start if task.rows else p.n_soft + at.start - p.n_u
        found.setdefault(task.name, []).extend(range(first, first + task.dim))
    if not found:
        names = [*p.rows[p.soft], *p.rows[p.n_rows + p.n_u :]]
        for i, row in enumerate(names):
            found.setdefault(row.owner, []).append(i)
    return found
