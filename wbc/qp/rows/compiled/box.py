"""Bounds and nothing else, with a compiled tick; what it does not settle goes to the reference, by DAQP."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.qp.rows.box import RESTLESS, BoxSolver
from wbc.qp.rows.compiled.box_kernel import solve_box
from wbc.qp.rows.compiled.dual_kernel import GIVE_UP, REPAIRED
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.proof import RowProof
from wbc.qp.rows.solver import RowSolver
from wbc.types import Index, Status, Vec

#: Where bounds change many at once, DAQP's single changes are cheaper than factoring anew: one repair, then DAQP.
_TRIES = 2


@final
class CompiledBoxSolver(RowSolver):
    """Same problem and answer as :class:`~wbc.qp.rows.box.BoxSolver`; the bounds of the last answer are a guess."""

    form = "box, compiled"

    def __init__(self, problem: RowProblem, *, tolerance: float = 1e-8) -> None:
        super().__init__(problem)
        self.tolerance = tolerance
        self.reference = BoxSolver(problem, tolerance=tolerance)
        p, n, m = problem, problem.n, problem.n_soft
        self.proof, self._held = RowProof(p), np.zeros(n)
        sizes, self._proof = np.array((n, m, _TRIES), dtype=np.int64), np.zeros(7)
        self._memory = Memory(
            p.G[p.soft], p.value, p.lower, p.upper, p.metric, p.centre, self.proof.weights, self._held,
            np.zeros((m, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n),
            sizes, self._proof, self.proof.compliance, self.proof.reach, p.scale, self.proof.push, self.proof.z,
        )  # fmt: skip
        self._delegated, self._changes = False, 0

    def solve(self) -> Status:
        p = self.problem
        self.proof.read()
        restless = self._changes >= RESTLESS
        code = GIVE_UP if restless else solve_box(self._memory.addresses, p.unit, self.tolerance)
        self._delegated = code == GIVE_UP
        if self._delegated:
            return self._delegate()
        self._changes = 0
        if code == REPAIRED:
            self.counts.repaired += 1
        else:
            self.counts.first += 1
        self.iterations = 1 + code
        *numbers, spread = self._proof.tolist()
        self.certificate = self.proof.found(numbers, spread)
        return Status.SOLVED

    def _delegate(self) -> Status:
        reference = self.reference
        status = reference.solve_afresh()
        self.counts.fallback += 1
        self.certificate, self.iterations = reference.certificate, reference.iterations
        before, changes = self._held.tobytes(), self._changes + 1
        self.guess(*reference.working_set())
        self._changes = changes if self._held.tobytes() != before else 0
        return status

    def reset(self) -> None:
        self._held.fill(0.0)
        self._changes = 0
        self.reference.reset()

    def working_set(self) -> tuple[Index, Vec]:
        items = np.flatnonzero(self._held)
        return items, self._held[items]

    def guess(self, items: Index, side: Vec) -> None:
        self._held.fill(0.0)
        self._held[items] = side
        self._changes = 0

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        if self._delegated:
            return self.reference.multipliers()
        return self.proof.multipliers()

    @property
    def active_count(self) -> int:
        return int(np.count_nonzero(self._held))
