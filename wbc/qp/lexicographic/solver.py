"""The order of the stages: hope that most can be met at once, and go down one by one where they cannot.

Strictly ranked least squares (Kanoun, Lamiraux, Wieber 2011; Escande, Mansard, Wieber 2014) are usually solved rank by
rank, one QP each. But a stage whose residual can be zero is decided by that alone: it is at its least, whatever else
holds. So the stages that were met in the last tick are taken as laws and the first one below them is minimised: one QP
where all stages can be met together, which is how a robot spends most of its time. If that has no answer, one stage
less is hoped for. What stands below is then decided one by one, each with the residuals above it held.

It is exact: J x of a stage is the same for all its minimisers, so holding it at one loses none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import final

import numpy as np

from wbc.qp.certificate import TOLERANCE, Certificate
from wbc.qp.lexicographic.stages import MET, Pull, Stage, StagedProblem
from wbc.qp.rows import RowProblem, RowSolver
from wbc.qp.rows.wish import NOT_OPTIMISED, WEIGHTED, Outcome
from wbc.types import Index, Status, Vec


@final
class LexicographicSolver(RowSolver):
    """A row problem whose wishes are ranked. ``budget`` QPs a tick; ``leave`` solves the weighted sum instead.

    ``pulls`` says of each stage what damps it (None: nothing); one that is damped is decided by itself.

    Every stage is solved and certified from the rows (:mod:`wbc.qp.lexicographic.levels`), whichever solver the
    weighted sum is left to.
    """

    form = "levels"

    def __init__(
        self, source: RowProblem, stages: Sequence[Stage], *, budget: int, leave: RowSolver | None = None,
        pulls: Sequence[Pull | None] = (),
    ) -> None:  # fmt: skip
        from wbc.qp.lexicographic.levels import Levels  # who ranks nothing need not wait for its kernels

        super().__init__(source)
        self.staged = StagedProblem(source, stages)
        self.way = Levels(self.staged, pulls)
        self._more = self.staged.problem.n - source.n
        self.counts = self.way.counts
        self.budget, self._leave = budget, leave
        self._last = len(stages) - 1
        self._names = [tuple(str(part) for part in stage) for stage in stages]
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
        """SOLVED: every stage is certified. MAX_ITERATIONS: some were not optimised, or all weighed instead."""
        self.staged.fill()
        self.shortfall = ""
        way, self.way.iterations, self.qps = self.way, 0, 0
        self._weighed = False
        way.begin()
        status, k = self._start()
        if not status.ok:
            return self._weigh(status)
        self._hope, first = k, k
        while k < self._last and self._go_on(k):
            k += 1
        self._decided = k
        self.outcomes = (*self._met(first), *self._found, *self._below(k))
        if k < self._last:
            self.staged.settle(k + 1)
        self.staged.give_back()
        self.iterations = way.iterations
        self.certificate = worst(outcome.certificate for outcome in self.outcomes if outcome.how != NOT_OPTIMISED)
        if self._leave is not None and not self.certificate.primal <= TOLERANCE:
            return self._weigh(Status.INACCURATE)  # bounds are not met: that is no answer
        if k < self._last:
            self.shortfall, self.certificate = NOT_OPTIMISED, self.certificate._replace(distance=np.inf)
            return Status.MAX_ITERATIONS
        return Status.SOLVED if self.certificate.ok else Status.INACCURATE

    def _start(self) -> tuple[Status, int]:
        """The first answer, and the stage it minimises: all above that are met."""
        k = min(self._hope, self.way.first_damped())
        self._found: list[Outcome] = []
        status = self._try(k)
        while not status.ok and k and self.qps < self.budget:
            k -= 1
            status = self._try(k)
        return status, k

    def _try(self, k: int) -> Status:
        self.qps += 1
        return self.way.solve(k)

    def _go_on(self, k: int) -> bool:
        """Hold what stage k came to and decide the next; False: it stays at this."""
        proof = self.way.certificate(k)
        residual = self.way.hold(k)
        met = float(np.abs(residual).max(initial=0.0)) <= MET
        self._found.append(self._outcome(k, "met" if met else "optimal", residual, proof))
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

    def _outcome(self, k: int, how: str, residual: Vec, proof: Certificate) -> Outcome:
        length = float((self.staged.weights[k] * residual).dot(residual)) ** 0.5
        return Outcome(self._names[k], how, length, proof)

    def _met(self, first: int) -> Iterator[Outcome]:
        """The stages that held exactly from the start."""
        for i in range(first):
            residual = self.staged.residual(i)
            yield Outcome(self._names[i], "met", 0.0, self.way.met(i, residual))

    def _below(self, k: int) -> Iterator[Outcome]:
        """What was decided last, and what was left after that."""
        if k == self._last:
            yield self._outcome(k, "optimal", self.staged.residual(k), self.way.certificate(k))
            return
        for i in range(k + 1, self._last + 1):
            yield self._outcome(i, NOT_OPTIMISED, self.staged.residual(i), Certificate.none())

    def _weigh(self, status: Status) -> Status:
        """The exit: one QP in which the weights speak. It is not what was asked."""
        self._weighed = True
        none = Certificate.none()
        self.outcomes = tuple(Outcome(names, WEIGHTED, np.nan, none) for names in self._names)
        self.certificate = none
        if self._leave is None:  # no level was decided, so that there is no answer that could be inaccurate
            return Status.FAILED if status is Status.INACCURATE else status
        status = self._leave.solve()
        self.certificate, self.iterations = self._leave.certificate, self._leave.iterations
        self.shortfall = WEIGHTED if status.ok else ""
        return Status.MAX_ITERATIONS if status.ok else status

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


def worst(certificates: Iterable[Certificate]) -> Certificate:
    """The worst number of each kind, and the bounds of all tasks."""
    bounds: dict[str, float] = {}
    found = list(certificates)
    for proof in found:
        bounds.update(proof.bounds)
    return max(found, key=lambda proof: proof.level)._replace(
        primal=max(proof.primal for proof in found), distance=max(proof.distance for proof in found), bounds=bounds
    )
