"""The order of the stages: hope that most can be met at once, and go down one by one where they cannot.

Strictly ranked least squares (Kanoun, Lamiraux, Wieber 2011; Escande, Mansard, Wieber 2014) are usually solved rank by
rank, one QP each. But a stage whose residual can be zero is decided by that alone: it is at its least, whatever else
holds. So the stages that were met in the last tick are taken as equations and the first one below them is minimised:
one QP where all stages can be met together, which is how a robot spends most of its time. If that has no answer, one
stage less is hoped for. What stands below is then decided one by one, each with the residuals above it held.

It is exact: J x of a stage is the same for all its minimisers, so holding it at one loses none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from wbc.compiled import place_of
from wbc.qp.certificate import TOLERANCE, Certificate
from wbc.qp.lexicographic.parts import Pull, Stage
from wbc.qp.rows import RowProblem, RowSolver
from wbc.qp.rows.row_task import NOT_OPTIMISED, WEIGHTED, Outcome
from wbc.tolerances import DISTANCE
from wbc.types import Index, Status, Vec


@final
class LexicographicSolver(RowSolver):
    """A row problem whose tasks are ranked. ``budget`` QPs a tick; ``leave`` solves the weighted sum instead.

    ``pulls`` says of each stage what damps it (None: nothing); one that is damped is decided by itself.

    Every stage is solved and certified from the rows (:mod:`wbc.qp.lexicographic.levels`), whichever solver the
    weighted sum is left to.
    """

    form = "levels"

    def __init__(
        self, source: RowProblem, stages: Sequence[Stage], *, budget: int, leave: RowSolver | None = None,
        pulls: Sequence[Pull | None] = (),
    ) -> None:  # fmt: skip
        # Who ranks nothing need not wait for their kernels.
        from wbc.qp.lexicographic.compiled.stage import hoped
        from wbc.qp.lexicographic.levels import Levels
        from wbc.qp.lexicographic.stages import StagedProblem

        super().__init__(source)
        self.staged = StagedProblem(source, stages)
        self.levels = Levels(self.staged, pulls)
        self._more = self.staged.problem.n - source.n
        self.counts = self.levels.core.counts
        self._hoped = hoped
        self.kernel = place_of(hoped), self.staged.address
        self.budget, self._leave = budget, leave
        self._last = len(stages) - 1
        self.reset()

    def reset(self) -> None:
        self.report = tuple
        self._weighed = False
        self.levels.reset()
        if self._leave is not None:
            self._leave.reset()

    # ---- one tick
    def solve(self) -> Status:
        return self.concluded(self._hoped(self.staged.address))

    def concluded(self, code: int) -> Status:
        """SOLVED: every stage is certified. MAX_ITERATIONS: some were not optimised, or all weighed instead."""
        levels, last = self.levels, self._last
        self.shortfall, self._weighed = "", False
        status = levels.concluded(code, self.budget)
        if not status.ok:
            self.staged.hope(levels.began)
            return self._weigh(status)
        ended = levels.ended
        self.report = report = levels.report()
        self.iterations = levels.iterations
        self.proof = report.certificate
        if ended < last:
            self.staged.settle(ended + 1)
        primal, distance = levels.worst
        if self._leave is not None and not primal <= TOLERANCE:
            return self._weigh(Status.INACCURATE)  # bounds are not met: that is no answer
        if ended < last:
            self.shortfall, self.certificate = NOT_OPTIMISED, self.certificate._replace(distance=np.inf)
            return Status.MAX_ITERATIONS
        return Status.SOLVED if primal <= TOLERANCE and distance <= DISTANCE * TOLERANCE else Status.INACCURATE

    @np.errstate(all="ignore")
    def _weigh(self, status: Status) -> Status:
        """The weighted fallback: one QP with the weighted sum of all levels, which is not the strict problem."""
        self._weighed, self.report = True, self._not_ranked
        self.certificate = Certificate.none()
        if self._leave is None:  # no level was decided, so that there is no answer that could be inaccurate
            return Status.FAILED if status is Status.INACCURATE else status
        status = self._leave.solve()
        self.proof, self.iterations = self._leave.proof, self._leave.iterations
        self.shortfall = WEIGHTED if status.ok else ""
        return Status.MAX_ITERATIONS if status.ok else status

    # ---- what others read
    def _not_ranked(self) -> tuple[Outcome, ...]:
        names = (tuple(str(part) for part in stage) for stage in self.staged.stages)
        return tuple(Outcome(each, WEIGHTED, np.nan, Certificate.none()) for each in names)

    @property
    def answered(self) -> RowProblem:
        """The problem that :meth:`answer` and :meth:`multipliers` are about: the last stage's, those above held."""
        return self.problem if self._weighed else self.staged.problem

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        if self._weighed and self._leave is not None:
            return self._leave.multipliers()
        if self.levels.ended < self._last:  # nothing pulls any more
            n, n_eq, n_in = self.staged.problem.qp_shape
            return np.zeros(n_eq), np.zeros(n_in), np.zeros(n)
        return self.levels.multipliers()

    def working_set(self) -> tuple[Index, Vec]:
        if self._weighed and self._leave is not None:
            return self._leave.working_set()
        items, side = self.levels.active()
        return np.where(items < self.problem.n, items, items - self._more), side

    def guess(self, items: Index, side: Vec) -> None:
        self.levels.guess(np.where(items < self.problem.n, items, items + self._more), side)
