"""The memory of levels that are decided one by one, in compiled code (:mod:`wbc.qp.lexicographic.compiled.rank`)."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Mapping, Sequence
from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.qp.certificate import Bounds, Certificate
from wbc.qp.lexicographic.compiled import rank
from wbc.qp.lexicographic.compiled.rank import IS_MET, NOT_DECIDED, Count
from wbc.qp.lexicographic.compiled.rank import LAYOUT as RANKINGS
from wbc.qp.lexicographic.compiled.space import LAYOUT as SPACES
from wbc.qp.lexicographic.compiled.space import Size
from wbc.qp.lexicographic.compiled.stage import CORE_AT, LEVELS_AT, conclude
from wbc.qp.lexicographic.parts import Pull
from wbc.qp.lexicographic.stages import StagedProblem, address_of
from wbc.qp.problem import QP, Row
from wbc.qp.rows import RowProblem
from wbc.qp.rows.compiled.work import SOLVED
from wbc.qp.rows.core import STATUS, CoreSolver
from wbc.qp.rows.row_task import NOT_OPTIMISED, Outcome
from wbc.tolerances import ROUNDING
from wbc.types import Index, Status, Vec


@final
class Levels:
    """Decides the levels of ``staged`` from any of them on; ``pulls`` says of each what damps it.

    ``core`` solves the last one, all others equations; in ``rank`` each is decided in the space that is left.
    """

    def __init__(self, staged: StagedProblem, pulls: Sequence[Pull | None] = ()) -> None:
        self.staged, self.problem = staged, staged.problem
        self.core = CoreSolver(self.problem)
        p, n, count = self.problem, self.problem.n_y, len(staged.stages)
        self._pulls = [*pulls, *[None] * (count - len(pulls))]
        items = n + p.n_range
        rows = max(place.stop - place.start for place in staged.rows)
        rows += max(p.n_u, *(len(pull.weights) for pull in self._pulls if pull is not None), 0)
        long = max(items, rows, p.n_soft + p.n_equal, n)
        names = [Row("z")] * (items + rows + n)
        finder = RowProblem(0, n, n_range=items, n_soft=rows, n_equal=0, rows=names, regularisation=0.0)
        self._finder = CoreSolver(finder)
        sizes = np.zeros(16, dtype=np.int64)
        sizes[[Size.N, Size.ITEMS, Size.CORE, Size.MOST, Size.LONG]] = n, items, self.core.address, rows, long
        sizes[Size.FINDER] = self._finder.address
        space = SPACES.arrays(sizes)
        self._side, self._kept, self._push, self._memory = space.side, space.kept, space.push, Memory(*space)
        table, share = np.zeros((count, 6), dtype=np.int64), np.zeros(count)
        table[:, 4:] = address_of(share)  # of nothing
        for k, (place, pull) in enumerate(zip(staged.rows, self._pulls, strict=True)):
            table[k, :2] = place.start, place.stop
            if pull is not None:
                table[k, 2:4], share[k] = (len(pull.weights), pull.columns.start), pull.share
                table[k, 4:] = address_of(pull.weights), address_of(pull.wanted)
        # What a report is made of stands in one piece: how each level came out, what is left of each row, its weight,
        # and how far unknowns can be off.
        behind = 2 + 5 * count + p.n_rows
        self._report = np.zeros(behind + p.n_rows + items)
        worst, found, left, root, pulled = np.split(self._report, (2, 2 + 5 * count, behind, behind + p.n_rows))
        self._work = np.zeros(14, dtype=np.int64)
        self._work[:5] = count, p.n_rows, len(p.value), items, self._memory.address
        ranking = RANKINGS.arrays(
            self._work, level=table, share=share, unit=np.ones(count), root=root, left=left, found=found, worst=worst,
            pulled=pulled,
        )  # fmt: skip
        self._sides, self._ranking = ranking.sides, Memory(*ranking)
        staged.links[[LEVELS_AT, CORE_AT]] = self._ranking.address, self.core.address
        self._places = self.core.places[:items]
        self._last = count - 1
        #: First and last level that were decided by themselves in the last answer, and steps that it took.
        self.began, self.ended, self.iterations = self._last, self._last, 0
        self.reset()

    def reset(self) -> None:
        """Forget all earlier ticks."""
        self._sides[:] = 0.0
        self.core.reset()
        self.staged.hope(self._last)
        self._one_by_one = False

    # ---- one tick
    def concluded(self, code: int, budget: int) -> Status:
        """What the levels came to, with ``budget`` QPs at most, once :func:`hoped` said ``code``.

        What stands above the first level is hoped to be met; where that has no answer, or a level above is damped,
        another one above is the first.
        """
        first, last, work = self.staged.first, self._last, self._work
        self._one_by_one = first < last
        if first == last:
            self.began = self.ended = last
            status = self.core.concluded(code)
            self.iterations = self.core.iterations
            if status.ok or budget == 1:
                return status
            self._one_by_one, work[Count.QPS], work[Count.WORK] = True, 1, self.iterations
        work[Count.START], work[Count.BUDGET] = min(first, last - 1), budget
        code = rank.rank(self._ranking.address)
        self.began, self.ended, self.iterations = work.item(Count.BEGAN), work.item(Count.ENDED), work.item(Count.WORK)
        counts = self.core.counts
        counts.first += work.item(Count.AT_ONCE)
        counts.repaired += work.item(Count.REPAIRED)
        counts.fallback += work.item(Count.FALLBACK)
        if code == SOLVED:
            conclude(self.staged.address)
        return STATUS.get(code, Status.FAILED)

    @property
    def worst(self) -> tuple[float, float]:
        """The largest violation, and the largest relative distance, of the levels that the core did not certify."""
        return self._report.item(0), self._report.item(1)

    def report(self) -> Report:
        """How all levels came out."""
        return Report(self.staged, self._report.copy(), None if self._one_by_one else self.core.proof)

    # ---- what explain() and the reports ask for
    def active(self) -> tuple[Index, Vec]:
        """Items at a bound in the last answer, and on which side."""
        if not self._one_by_one:
            return self.core.working_set()
        p, held = self.problem, np.flatnonzero((self._kept != 0.0) | (self._side != 0.0))
        items = self._places[held]
        return items, np.where(p.upper[items] - p.value[items] <= p.value[items] - p.lower[items], 1.0, -1.0)

    def guess(self, items: Index, side: Vec) -> None:
        """Take these as active in the next answers."""
        self.core.guess(items, side)
        found = dict(zip(items.tolist(), side.tolist(), strict=True))
        self._sides[:] = [found.get(item, 0.0) for item in self._places.tolist()]

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        """y, z and z_box of the last answer in the standard form of its own problem.

        Those of held items are found; those of rows above, and of what held them back, make it stationary.
        """
        if not self._one_by_one:
            return self.core.multipliers()
        p = self.problem
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
