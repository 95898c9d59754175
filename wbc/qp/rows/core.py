"""The core: one compiled working-set loop for a row problem, with a certificate of what it answers.

What it computes is told in four pages: :mod:`~wbc.qp.rows.compiled.equality` (the equality problem of a working set),
:mod:`~wbc.qp.rows.compiled.verify` (the verdict), :mod:`~wbc.qp.rows.compiled.finite` (the finite method) and
:mod:`~wbc.qp.rows.compiled.search` (the loop). This one owns their memory.
"""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.qp.certificate import Certificate
from wbc.qp.rows.compiled.search import decide, guess
from wbc.qp.rows.compiled.work import INACCURATE, INFEASIBLE, ROWS, SOLVED, UNDECIDED, VARIABLES
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.proof import RowProof
from wbc.qp.rows.solver import RowSolver
from wbc.types import Index, Status, Vec

#: Products in the row form, above which the form in the unknowns is cheaper whatever their numbers.
_PAYS = 3e5
#: Weight of a row beside the metric, beyond which the row form loses its digits.
_LIGHT = 1e8


@final
class CoreSolver(RowSolver):
    """Guess, verify, exchange, and a finite method, in one compiled call; no other solver is asked.

    ``form`` says which factorisation the problem's sizes and weights chose: "rows" or "variables".
    """

    is_compiled = True

    def __init__(self, problem: RowProblem) -> None:
        super().__init__(problem)
        p = problem
        self.proof = proof = RowProof(p)
        self.form = "rows" if fits_rows(p) else "variables"
        items = p.n_y + p.n_range + p.n_law
        most = p.n_soft + p.n_u + min(items, p.n_y + p.n_law) + 1
        form = ROWS if self.form == "rows" else VARIABLES
        self._sizes = np.array([p.n_u, p.n_y, p.n_range, p.n_soft, p.n_law, form, 0, 0, 0], dtype=np.int64)
        self._proof, self._numbers = np.zeros(7), np.array([p.unit, p.regularisation, 0.0, 0.0])
        self._side, self._best, self._wrong = np.zeros(items), np.zeros(items), np.zeros(items)
        floats = [np.zeros(p.n_y) for _ in range(3)] + [np.zeros(p.n_y + 1)] + [np.zeros(most) for _ in range(4)]
        shapes = (
            p.n_u, (p.n_u, p.n_u), (p.n_u, p.n_y + 1), (p.n_y, p.n_y), (most, p.n_y + 1), (most, p.n_y), (most, most),
        )  # fmt: skip
        weighed, self._reach = p.n_soft + p.n_u, np.zeros(p.n_soft + p.n_y)
        self._memory = Memory(
            p.G, p.value, p.lower, p.upper, p.metric, p.centre, p.scale, p.weights, np.zeros(weighed),
            np.zeros(weighed), self._reach, proof.push, proof.z, proof.left, self._proof, self._numbers, self._sizes,
            self._side, self._best,
            self._wrong, np.zeros(most, dtype=np.int64), *floats, *(np.zeros(shape) for shape in shapes),
        )  # fmt: skip
        self.address = self._memory.address
        # Where each item stands in ``value``.
        first = p.first_row
        self.places = np.concatenate([
            np.arange(p.n_u, p.n), np.arange(first + p.range.start, first + p.range.stop),
            np.arange(first + p.law.start, first + p.law.stop),
        ]).astype(np.intp)  # fmt: skip
        self._bounded = p.n_y + p.n_range
        # What certificates are told of ``reach``: they may be read when it has changed.
        self._told, self._version = self._reach, -1

    def solve(self) -> Status:
        p = self.problem
        changed = p.version != self._version
        if changed:
            self._numbers[0] = p.unit
        code = guess(self.address)
        if code == UNDECIDED:
            code = decide(self.address)
        guesses, steps = self.work
        self.iterations = guesses + steps
        self.counts.add(guesses, steps)
        if code == SOLVED:
            if changed:
                self._told, self._version = self._reach.copy(), p.version
            self.certificate = self.proof.found(self._proof.tolist(), self._told)
            return Status.SOLVED
        if code == INACCURATE:  # what rounding hides of an unknown that no task asks for is left to the reference
            with np.errstate(all="ignore"):
                self.certificate = self.proof.certify(self.proof.push.copy())
            return Status.SOLVED if self.certificate.ok else Status.INACCURATE
        self.reset()
        self.certificate = Certificate.none()
        return Status.INFEASIBLE if code == INFEASIBLE else Status.FAILED

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
        return self.proof.multipliers()

    @property
    def active_count(self) -> int:
        return int(np.count_nonzero(self._side[: self._bounded]))


def fits_rows(problem: RowProblem) -> bool:
    """Whether the row form is right and pays.

    It pays with fewer rows than unknowns, and as long as its products stay few. It is right while no row weighs so much
    more than the metric that rounding of K hides the metric.
    """
    p, rows = problem, problem.n_u + problem.n_soft + problem.n_law
    pays = rows < p.n_y or rows**2 * (rows / 3.0 + p.n_y) < _PAYS
    heavy = float(p.weights.max(initial=0.0)) > _LIGHT * p.unit * float(p.metric.min(initial=np.inf))
    return pays and not heavy
