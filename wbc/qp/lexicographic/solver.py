"""The order of the stages: hope that most can be met at once, and go down one by one where they cannot.

Strictly ranked least squares (Kanoun, Lamiraux, Wieber 2011; Escande, Mansard, Wieber 2014) are usually solved rank by
rank, one QP each. But a stage whose residual can be zero is decided by that alone: it is at its least, whatever else
holds. So the stages that were met in the last tick are taken as equations and the first one below them is minimised:
one QP where all stages can be met together, which is how a robot spends most of its time. If that has no answer, one
stage less is hoped for. What stands below is then decided one by one, each with the residuals above it held.

It is exact: J x of a stage is the same for all its minimisers, so holding it at one loses none.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Mapping, Sequence
from typing import final

import numpy as np

from wbc.compiled import Memory, place_of
from wbc.qp.certificate import TOLERANCE, Bounds, Certificate
from wbc.qp.lexicographic.compiled.rank import AGAIN, IS_MET, NOT_DECIDED, Count, rank
from wbc.qp.lexicographic.compiled.rank import LAYOUT as RANKINGS
from wbc.qp.lexicographic.compiled.space import LAYOUT as SPACES
from wbc.qp.lexicographic.compiled.space import Size
from wbc.qp.lexicographic.compiled.stage import CORE_AT, FIRST, HOPE, LEVELS_AT, conclude, fill, hoped
from wbc.qp.lexicographic.parts import Pull, Stage
from wbc.qp.lexicographic.stages import StagedProblem, address_of
from wbc.qp.problem import QP, Row
from wbc.qp.rows import RowProblem, RowSolver
from wbc.qp.rows.compiled.work import SOLVED
from wbc.qp.rows.core import STATUS, CoreSolver
from wbc.qp.rows.row_task import NOT_OPTIMISED, WEIGHTED, Outcome
from wbc.tolerances import DISTANCE, ROUNDING
from wbc.types import Index, Status, Vec


@final
class LexicographicSolver(RowSolver):
    """A row problem whose tasks are ranked. ``budget`` QPs a tick; ``leave`` solves the weighted sum instead.

    ``pulls`` says of each stage what damps it (None: nothing); one that is damped is decided by itself. The last
    ``without`` unknowns of the source are zero, and no stage is about them.

    Every stage is solved and certified from the rows, whichever solver the weighted sum is left to: the core solves the
    last one, all others equations, and :mod:`wbc.qp.lexicographic.compiled.rank` each in the space that is left.
    """

    form = "levels"
    is_compiled = True

    def __init__(
        self, source: RowProblem, stages: Sequence[Stage], *, budget: int, leave: RowSolver | None = None,
        pulls: Sequence[Pull | None] = (), without: int = 0,
    ) -> None:  # fmt: skip
        super().__init__(source)
        self.staged = StagedProblem(source, stages, without)
        self._core = CoreSolver(self.staged.problem)
        self.counts = self._core.counts
        self.kernel = place_of(hoped), self.staged.address
        self.budget, self._leave = budget, leave
        self._more, self._last = self.staged.problem.n - source.n, len(stages) - 1
        #: First and last stage that were decided by themselves in the last answer.
        self.began, self.ended = self._last, self._last
        self._connect([*pulls, *[None] * (len(stages) - len(pulls))])
        self.reset()

    def _connect(self, pulls: Sequence[Pull | None]) -> None:
        """The memory of stages that are decided one by one, in compiled code."""
        staged, p = self.staged, self.staged.problem
        n, count = p.n_y, len(pulls)
        items = n + p.n_range
        rows = max(place.stop - place.start for place in staged.rows)
        rows += max(p.n_u, *(len(pull.weights) for pull in pulls if pull is not None), 0)
        long = max(items, rows, p.n_soft + p.n_equal, n)
        names = [Row("z")] * (items + rows + n)
        finder = RowProblem(0, n, n_range=items, n_soft=rows, n_equal=0, rows=names, regularisation=0.0)
        self._finder = CoreSolver(finder)
        sizes = np.zeros(16, dtype=np.int64)
        sizes[[Size.N, Size.ITEMS, Size.CORE, Size.MOST, Size.LONG]] = n, items, self._core.address, rows, long
        sizes[Size.FINDER] = self._finder.address
        space = SPACES.arrays(sizes)
        self._side, self._kept, self._push, self._memory = space.side, space.kept, space.push, Memory(*space)
        table, share = np.zeros((count, 6), dtype=np.int64), np.zeros(count)
        table[:, 4:] = address_of(share)  # of nothing
        for k, (place, pull) in enumerate(zip(staged.rows, pulls, strict=True)):
            table[k, :2] = place.start, place.stop
            if pull is not None:
                table[k, 2:4], share[k] = (len(pull.weights), pull.columns.start), pull.share
                table[k, 4:] = address_of(pull.weights), address_of(pull.wanted)
        # What a report is made of stands in one piece: how each level came out, what is left of each row, its weight,
        # and how far unknowns can be off.
        behind = 2 + 5 * count + p.n_rows
        self._report = np.zeros(behind + p.n_rows + items)
        worst, found, left, root, pulled = np.split(self._report, (2, 2 + 5 * count, behind, behind + p.n_rows))
        self._work = np.zeros(16, dtype=np.int64)
        self._work[:5] = count, p.n_rows, len(p.value), items, self._memory.address
        ranking = RANKINGS.arrays(
            self._work, level=table, share=share, unit=np.ones(count), root=root, left=left, found=found, worst=worst,
            pulled=pulled,
        )  # fmt: skip
        self._sides, self._ranking, self._pulls = ranking.sides, Memory(*ranking), pulls
        staged.links[[LEVELS_AT, CORE_AT]] = self._ranking.address, self._core.address
        self._places = self._core.places[:items]

    def reset(self) -> None:
        self.report = tuple
        self._weighed = self._one_by_one = False
        self._sides[:] = 0.0
        self._core.reset()
        self.staged.links[HOPE] = self._last
        if self._leave is not None:
            self._leave.reset()

    # ---- one tick
    def solve(self) -> Status:
        return self.concluded(hoped(self.staged.address))

    def concluded(self, code: int) -> Status:
        """SOLVED: every stage is certified. MAX_ITERATIONS: some were not optimised, or all weighed instead."""
        self.shortfall, self._weighed = "", False
        status = self._decided(code)
        if not status.ok:
            self.staged.links[HOPE] = self.began
            return self._weigh(status)
        report = Report(self.staged, self._report.copy(), None if self._one_by_one else self._core.proof)
        self.report, self.proof = report, report.certificate
        if self.ended < self._last:
            self.staged.settle(self.ended + 1)
        # The largest violation, and the largest relative distance, of the stages that the core did not certify.
        primal, distance = self._report.item(0), self._report.item(1)
        if self._leave is not None and not primal <= TOLERANCE:
            return self._weigh(Status.INACCURATE)  # bounds are not met: that is no answer
        if self.ended < self._last:
            self.shortfall, self.certificate = NOT_OPTIMISED, self.certificate._replace(distance=np.inf)
            return Status.MAX_ITERATIONS
        return Status.SOLVED if primal <= TOLERANCE and distance <= DISTANCE * TOLERANCE else Status.INACCURATE

    def _decided(self, code: int) -> Status:
        """What the stages came to, once :func:`hoped` said ``code``.

        What stands above the first stage is hoped to be met; where that has no answer, or a stage above is damped,
        another one above is the first.
        """
        first, last, work, counts = self.staged.links.item(FIRST), self._last, self._work, self.counts
        self._one_by_one = first < last
        if first == last:
            self.began = self.ended = last
            status = self._core.concluded(code)
            self.iterations = self._core.iterations
            if status.ok or self.budget == 1 or last == 0:
                return status
            self._one_by_one, work[Count.QPS], work[Count.WORK] = True, 1, self.iterations
        work[Count.START], work[Count.BUDGET], work[Count.ALL] = min(first, last - 1), self.budget, 0
        code = rank(self._ranking.address)
        if code == AGAIN:
            work[Count.START], work[Count.ALL] = work.item(Count.BEGAN), 1
            spent = work[Count.QPS : Count.WORK + 1].copy()
            fill(self.staged.address)
            work[Count.QPS : Count.WORK + 1] = spent
            code = rank(self._ranking.address)
        self.began, self.ended, self.iterations = work.item(Count.BEGAN), work.item(Count.ENDED), work.item(Count.WORK)
        counts.first += work.item(Count.AT_ONCE)
        counts.repaired += work.item(Count.REPAIRED)
        counts.fallback += work.item(Count.FALLBACK)
        if code == SOLVED:
            conclude(self.staged.address)
        return STATUS.get(code, Status.FAILED)

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

    def wait(self, waits: bool) -> None:
        """Whether the compiled call of a tick skips this problem, because another solver will answer."""
        self.staged.links[HOPE] = -1 if waits else self._last

    def count_with(self, other: RowSolver) -> None:
        """Count solves where another solver does."""
        self.counts = self._core.counts = other.counts

    # ---- what others read
    @property
    def is_spent(self) -> bool:
        """Whether the budget ended the last answer that was decided one by one."""
        return bool(self._work.item(Count.QPS) >= self.budget)

    @property
    def first_is_met(self) -> bool:
        """Whether nothing was left of the first stage in the last answer."""
        return bool(self._report.item(2) == IS_MET)

    @property
    def shared(self) -> int:
        return self.problem.n if self._weighed else self.staged.kept

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
        p = self.staged.problem
        if self.ended < self._last:  # nothing pulls any more
            n, n_eq, n_in = p.qp_shape
            return np.zeros(n_eq), np.zeros(n_in), np.zeros(n)
        if not self._one_by_one:
            return self._core.multipliers()
        # Those of held items are found; those of rows above, and of what held them back, make it stationary.
        qp = QP.empty(p.qp_shape)
        p.write_qp(qp)
        force, n_y = np.zeros(p.n_range + p.n), p.n_y
        push = np.where(self._side != 0.0, p.unit * self._push, 0.0)
        force[: p.n_range], force[p.n_range + p.n_u :] = push[n_y:], push[:n_y] / p.scale[p.n_u :]
        kept = np.flatnonzero(self._kept != 0.0)
        kept = np.where(kept < n_y, kept + p.n_range + p.n_u, kept - n_y)
        force[kept] = 0.0
        bounded = np.concatenate([qp.C, np.eye(p.n)])
        pull = qp.H @ (p.x * p.scale) + qp.g + force @ bounded
        columns = np.concatenate([qp.A, bounded[kept]])
        length = np.linalg.norm(columns, axis=1)
        length[length == 0.0] = 1.0
        found = np.linalg.lstsq((columns / length[:, None]).T, -pull, rcond=ROUNDING)[0] / length
        force[kept] = found[qp.n_eq :]
        return found[: qp.n_eq], force[: p.n_range], force[p.n_range :]

    def working_set(self) -> tuple[Index, Vec]:
        if self._weighed and self._leave is not None:
            return self._leave.working_set()
        if self._one_by_one:
            p, held = self.staged.problem, np.flatnonzero((self._kept != 0.0) | (self._side != 0.0))
            items = self._places[held]
            side = np.where(p.upper[items] - p.value[items] <= p.value[items] - p.lower[items], 1.0, -1.0)
        else:
            items, side = self._core.working_set()
        return self._translated(items, side, self.staged.problem.n, -self._more)

    def _translated(self, items: Index, side: Vec, n: int, more: int) -> tuple[Index, Vec]:
        """Items of a problem of ``n`` unknowns as those of one with ``more``, less unknowns that only one has."""
        kept = self.staged.kept
        known = (items < kept) | (items >= n)
        items, side = items[known], side[known]
        return np.where(items < kept, items, items + more), side

    def guess(self, items: Index, side: Vec) -> None:
        items, side = self._translated(items, side, self.problem.n, self._more)
        self._core.guess(items, side)
        found = dict(zip(items.tolist(), side.tolist(), strict=True))
        self._sides[:] = [found.get(item, 0.0) for item in self._places.tolist()]


@final
class Report:
    """How the levels of a tick came out, by number; words and certificates are made when they are read.

    ``proof`` says what is certified of the last level where the core decided it, all others met.
    """

    def __init__(self, staged: StagedProblem, numbers: Vec, proof: Callable[[], Certificate] | None) -> None:
        self._staged, self._numbers, self._proof = staged, numbers, proof

    def __call__(self) -> tuple[Outcome, ...]:
        """In words, with a certificate each."""
        outcomes = list[Outcome]()
        count, last = len(self._staged.stages), len(self._staged.stages) - 1
        found, behind = np.split(self._numbers[2:], (5 * count,))
        n_rows, n_u = self._staged.problem.n_rows, self._staged.problem.n_u
        left, root, pulled = np.split(behind, (n_rows, 2 * n_rows))
        for k, (stage, place) in enumerate(zip(self._staged.stages, self._staged.rows, strict=True)):
            names = tuple(str(part) for part in stage)
            how, length, primal, off, distance = found[5 * k : 5 * k + 5].tolist()
            if how == NOT_DECIDED:
                outcomes.append(Outcome(names, NOT_OPTIMISED, length, Certificate.none()))
                continue
            if k == last and self._proof is not None:
                outcomes.append(Outcome(names, "optimal", length, self._proof()))
                continue
            with np.errstate(divide="ignore", invalid="ignore"):
                reach = np.abs(left[place]) if off < 0.0 else np.where(root[place] > 0.0, off / root[place], 0.0)
            bounds = {name: float(reach[rows].max(initial=0.0)) for name, rows in self._staged.parts[k].items()}
            for task in self._staged.problem.levels[0] if k == last else ():
                if task.unknowns is not None:
                    columns = slice(task.unknowns.start - n_u, task.unknowns.stop - n_u)
                    bounds[task.name] = float(pulled[columns].max(initial=0.0))
            proof = Certificate(primal, 0.0, 0.0, distance=distance, bounds=bounds)
            outcomes.append(Outcome(names, "met" if how == IS_MET else "optimal", length, proof))
        return tuple(outcomes)

    def certificate(self) -> Certificate:
        """The worst number of each kind among the levels that were decided, and the bounds of all tasks."""
        primal, distance = self._numbers.item(0), self._numbers.item(1)
        if self._proof is None:
            return Certificate(primal, 0.0, 0.0, 1.0, 1.0, distance, 0.0, Bounds(self._bounds))
        worst, dual, gap, scale_dual, scale_gap, far, slope, _ = self._proof()
        primal, distance = max(worst, primal), max(far, distance)
        return Certificate(primal, dual, gap, scale_dual, scale_gap, distance, slope, Bounds(self._bounds))

    def _bounds(self) -> Mapping[str, float]:
        """The bounds of the tasks of all levels, the lowest level's where one is in several."""
        proofs = [outcome.certificate for outcome in self() if outcome.how != NOT_OPTIMISED]
        return ChainMap(*(dict(proof.bounds) for proof in reversed(proofs)))
