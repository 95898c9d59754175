"""The dual form with a compiled tick; what it does not settle goes to the reference, :mod:`wbc.qp.rows.dual`."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.qp.rows.compiled.dual_kernel import GIVE_UP, REPAIRED, solve_dual
from wbc.qp.rows.dual import DualSolver, write_compliance
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.proof import RowProof
from wbc.qp.rows.solver import RowSolver
from wbc.types import Index, Status, Vec

#: Repairs of a guess, each a few microseconds, before the reference is asked.
_TRIES = 30


@final
class CompiledDualSolver(RowSolver):
    """Same problem, same answer and same working set as :class:`~wbc.qp.rows.dual.DualSolver`, in one compiled call."""

    form = "dual, compiled"

    def __init__(self, problem: RowProblem, *, tolerance: float = 1e-8, tries: int = 3) -> None:
        super().__init__(problem)
        self.tolerance = tolerance
        self.reference = DualSolver(problem, tolerance=tolerance, tries=tries)
        p, most = problem, problem.n_soft + problem.n_law + problem.n_slots
        self._free_root, self._give = np.ones(p.n_y), np.zeros(p.n_soft)
        self._lam = np.zeros(most)
        work = [np.zeros(shape) for shape in ((most, p.n_y + 1), (most, p.n_y), (most, most))]
        sizes = (p.n_u, p.n_y, p.n_range, p.n_soft, p.n_law, p.n_slots, _TRIES, 0)
        self._sizes, self._proof = np.array(sizes, dtype=np.int64), np.zeros(7)
        self._items, self._side = np.zeros(p.n + p.n_slots, np.int64), np.zeros(p.n + p.n_slots)
        self.proof = proof = RowProof(p)
        self._memory = Memory(
            p.G, p.value, p.lower, p.upper, p.metric, self._free_root, p.centre, self._give,
            np.zeros((p.n_u, p.n_u)), np.zeros((p.n_u, p.n_y + 1)), *work, self._lam,
            np.zeros(p.n_y), np.zeros(p.n_y), np.zeros(p.n + p.n_slots),
            self._sizes, self._items, self._side, self._proof, np.zeros(most),
            proof.weights, proof.compliance, proof.reach, p.scale, proof.push, proof.z, np.zeros(p.n_u),
            proof.left,
        )  # fmt: skip
        self._version, self._delegated = -1, False

    @property
    def _active(self) -> int:
        return int(self._sizes[7])

    def solve(self) -> Status:
        p = self.problem
        if p.version != self._version:
            np.divide(1.0, np.sqrt(p.metric), out=self._free_root)
            write_compliance(p, self._give)
            self.proof.read()
            self._version = p.version
        code = solve_dual(self._memory.addresses, p.unit, p.regularisation / p.unit, self.tolerance)
        if code == GIVE_UP:
            return self._delegate()
        self._delegated = False
        if code == REPAIRED:
            self.counts.repaired += 1
        else:
            self.counts.first += 1
        self.iterations = 1 + code
        *numbers, spread = self._proof.tolist()
        self.certificate = self.proof.found(numbers, spread)
        return Status.SOLVED

    def _delegate(self) -> Status:
        """The reference answers, starting from the same guess; its working set is the next one."""
        reference, asked = self.reference, self.reference.counts.fallback
        reference.guess(*self.working_set())
        status = reference.solve()
        self.certificate, self.iterations, self._delegated = reference.certificate, reference.iterations, True
        if reference.counts.fallback > asked:
            self.counts.fallback += 1
        else:
            self.counts.repaired += 1
        self.guess(*reference.working_set())
        return status

    def reset(self) -> None:
        self._sizes[7] = 0
        self.reference.reset()

    def working_set(self) -> tuple[Index, Vec]:
        k = self._active
        return self._items[:k].astype(np.intp), self._side[:k].copy()

    def guess(self, items: Index, side: Vec) -> None:
        fits = (items < self.problem.n) | (np.cumsum(items >= self.problem.n) <= self.problem.n_slots)
        k = int(fits.sum())
        self._items[:k], self._side[:k], self._sizes[7] = items[fits], side[fits], k

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        if self._delegated:
            return self.reference.multipliers()
        return self.proof.multipliers()

    @property
    def active_count(self) -> int:
        return self._active
