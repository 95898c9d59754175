"""The order of the stages: hope that most can be met at once, and go down one by one where they cannot.

Strictly ranked least squares (Kanoun, Lamiraux, Wieber 2011; Escande, Mansard, Wieber 2014) are usually solved rank by
rank, one QP each. But a stage whose residual can be zero is decided by that alone: it is at its least, whatever else
holds. So the stages that were met in the last tick are taken as laws and the first one below them is minimised: one QP
where all stages can be met together, which is how a robot spends most of its time. If that has no answer, one stage
less is hoped for. What stands below is then decided one by one, each with the residuals above it held.

It is exact: J x of a stage is the same for all its minimisers, so holding it at one loses none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import final

import numpy as np

from wbc.qp.lexicographic.stages import MET, Stage, StagedProblem
from wbc.qp.lexicographic.way import Way
from wbc.qp.rows import Outcome, RowProblem, RowSolver
from wbc.qp.solver import Solver
from wbc.types import Index, Status, Vec


@final
class LexicographicSolver(RowSolver):
    """A row problem whose wishes are ranked. ``budget`` QPs a tick; ``leave`` solves the weighted sum instead."""

    def __init__(
        self, source: RowProblem, stages: Sequence[Stage], way: Callable[[StagedProblem], Way], *,
        budget: int, leave: RowSolver | None = None,
    ) -> None:  # fmt: skip
        super().__init__(source)
        self.staged = StagedProblem(source, stages)
        self.way = way(self.staged)
        self._more = self.staged.problem.n - source.n
        self.form = self.way.form
        self.counts = self.way.counts
        self.budget, self._leave = budget, leave
        self._last = len(stages) - 1
        self._names = [tuple(str(part) for part in stage) for stage in stages]
        self._met = [Outcome(names, "met", 0.0) for names in self._names]
        #: QPs of the last tick.
        self.qps = 0
        self.reset()

    def reset(self) -> None:
        self._hope = self._decided = self._last
        self.outcomes, self._weighed = (), False
        self.way.begin_over()
        if self._leave is not None:
            self._leave.reset()

    # ---- one tick
    def solve(self) -> Status:
        self.staged.fill()
        way, self.way.iterations, self.qps = self.way, 0, 0
        self._weighed = False
        status, k = self._start() if way.begin() else (Status.FAILED, 0)
        if not status.ok:
            return self._weigh(status)
        self._hope = k
        while k < self._last and self._go_on(k):
            k += 1
        self._decided = k
        self.outcomes = (*self._found, *self._below(k))
        if k < self._last:
            self.staged.settle(k + 1)
        self.staged.give_back()
        self.iterations = way.iterations
        return Status.SOLVED

    def _start(self) -> tuple[Status, int]:
        """The first answer, and the stage it minimises: all above that are met."""
        k = self._hope
        status = self._try(k)
        while not status.ok and k and self.qps < self.budget:
            k -= 1
            status = self._try(k)
        self._found = self._met[:k]
        return status, k

    def _try(self, k: int) -> Status:
        self.qps += 1
        status = self.way.solve(k)
        if status.ok:
            self.certificate = self.way.certificate()
        return status

    def _go_on(self, k: int) -> bool:
        """Hold what stage k came to and decide the next; False: it stays at this."""
        residual = self.way.hold(k)
        met = float(np.abs(residual).max(initial=0.0)) <= MET
        self._found = [*self._found, self._outcome(k, "met" if met else "least", residual)]
        if met and self._hope == k:
            self._hope = k + 1
        if self.qps >= self.budget:
            return False
        value = self.staged.problem.value
        best = value.copy()
        if self._try(k + 1).ok:
            return True
        value[:] = best
        return False

    def _outcome(self, k: int, how: str, residual: Vec) -> Outcome:
        return Outcome(self._names[k], how, float((self.staged.weights[k] * residual).dot(residual)) ** 0.5)

    def _below(self, k: int) -> Iterator[Outcome]:
        """What was decided last, and what was left after that."""
        p = self.staged.problem
        for i in range(len(self._found), self._last + 1):
            rows, how = self.staged.rows[i], "least" if k == self._last else "left"
            yield self._outcome(i, how, p.value[p.item(rows.start) : p.item(rows.stop)])

    def _weigh(self, status: Status) -> Status:
        """The exit: one QP in which the weights speak."""
        self._weighed = True
        self.outcomes = tuple(Outcome(names, "weighed", np.nan) for names in self._names)
        if self._leave is None:
            return status
        status = self._leave.solve()
        self.certificate, self.iterations = self._leave.certificate, self._leave.iterations
        return status

    # ---- what others read
    @property
    def answered(self) -> RowProblem:
        """The problem that :meth:`answer` and :meth:`multipliers` are about: the last stage's, those above held."""
        return self.problem if self._weighed else self.staged.problem

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        if self._weighed and self._leave is not None:
            return self._leave.multipliers()
        if self._decided < self._last:  # nothing pulls any more
            n, n_eq, n_in = self.staged.problem.qp_shape
            return np.zeros(n_eq), np.zeros(n_in), np.zeros(n)
        return self.way.multipliers()

    @property
    def active_count(self) -> int:
        if self._weighed and self._leave is not None:
            return self._leave.active_count
        return len(self.way.active()[0])

    def working_set(self) -> tuple[Index, Vec]:
        items, side = self.way.active()
        return np.where(items < self.problem.n, items, items - self._more), side

    def guess(self, items: Index, side: Vec) -> None:
        self.way.guess(np.where(items < self.problem.n, items, items + self._more), side)


def way_for(solver: Solver) -> Callable[[StagedProblem], Way]:
    """The way that a solver takes: the default works on the rows where their cost is real, any other on QPs."""
    from wbc.qp.lexicographic.dual import DualStages
    from wbc.qp.lexicographic.standard import StandardStages
    from wbc.qp.solvers.pdas import Pdas

    def way(staged: StagedProblem) -> Way:
        if isinstance(solver, Pdas) and has_real_cost(staged.problem):
            return DualStages(staged, tolerance=solver.accuracy, tries=solver.tries)
        return StandardStages(staged, solver)

    return way


def has_real_cost(problem: RowProblem) -> bool:
    """Whether the metric of y means something beside the regularisation of u, which the elimination of u leaves out."""
    cost = problem.metric[problem.scale[problem.n_u :] == 1.0] * problem.unit
    return not problem.n_u or float(cost.min(initial=np.inf)) >= 1e3 * problem.regularisation
