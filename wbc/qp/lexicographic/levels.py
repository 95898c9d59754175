"""Levels decided one by one, in compiled code; the core decides all at once where they can be met.

Two ways to an answer. While all levels above the last can be met, they are equations of the last one's problem, which
the core solves (:mod:`wbc.qp.rows.core`). Else each level is least squares in the space that those above it leave
(:mod:`wbc.qp.lexicographic.compiled.level`), and has a certificate of its own
(:mod:`wbc.qp.lexicographic.compiled.proof`). A point to begin with, or the proof that there is none, is the core's.

What held a level back while it was decided stays held, and may push either way from then on; else a lower level could
leave the set where the level above is best.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.qp.certificate import Certificate
from wbc.qp.lexicographic.compiled import proof, search
from wbc.qp.lexicographic.compiled.space import CORE, FIRST, HELD, INSIDE, ITEMS, LAST, LONG, MOST, OWN, ROWS, STEPS, N
from wbc.qp.lexicographic.stages import MET, Pull, StagedProblem
from wbc.qp.problem import QP
from wbc.qp.rows.compiled.work import SOLVED
from wbc.qp.rows.core import CoreSolver
from wbc.qp.rows.problem import RowProblem
from wbc.types import Index, Mat, Status, Vec

#: Weight of a level's rows beside the distance, where a point near its least is found; the next where none is.
_HEAVY = 1e6, 1.0
#: What an answer may be off by, and what a level above may lose by it.
_ENOUGH, _LITTLE = 1e-7, 1e-5


@final
class Levels:
    """In one tick: ``begin`` once, then ``solve(k)``, ``certificate(k)`` and ``hold(k)`` for levels in order of rank.

    ``solve(k)`` takes the levels above k as equations, whether they were solved in this tick and are held, or are only
    hoped to be met.
    """

    def __init__(self, staged: StagedProblem, pulls: Sequence[Pull | None] = ()) -> None:
        self.staged, self.problem = staged, staged.problem
        self.core = CoreSolver(self.problem)
        self.counts, self.iterations = self.core.counts, 0
        p, n = self.problem, self.problem.n_y
        items, rows = n + p.n_range, max((len(weights) for weights in staged.weights), default=0)
        self._pulls = [*pulls, *[None] * (len(staged.stages) - len(pulls))]
        rows += max((len(pull.weights) for pull in self._pulls if pull is not None), default=0)
        long = max(items, rows, p.n_soft + p.n_law, n)
        self._sizes = np.zeros(14, dtype=np.int64)
        self._item, self._holds = np.zeros(items, dtype=np.int64), np.zeros(items)
        self._which, self._toward = np.zeros(n, dtype=np.int64), np.zeros(n)
        self._sizes[[N, ITEMS, CORE, MOST, LONG]] = n, items, self.core.address, rows, long
        self._root, self._weigh, self._proof = np.ones(n), np.zeros(rows), np.zeros(6)
        self._side, self._kept, self._push = np.zeros(items), np.zeros(items), np.zeros(items)

        def of(*shape: int) -> Mat:
            return np.zeros(shape)

        self._memory = Memory(
            of(n, n), self._root, of(n), of(items), of(items), of(items), self._side, self._kept, of(items), self._push,
            of(items), of(items, n), of(items), of(items), self._item, self._holds, of(n, n), of(n),
            of(n), of(n), of(n), of(n), of(n + 1), of(n), of(n), of(rows, n), of(rows, n), of(n, rows), of(rows),
            self._weigh, of(rows), of(long), of(long), of(long), np.zeros(long, dtype=np.int64), of(rows, rows),
            of(n, n), of(long, n), of(n), self._proof, of(items), self._which, self._toward,
            self._sizes,
        )  # fmt: skip
        self._at = self._memory.address
        self._places = self.core.places[:items]
        self._finders = [CoreSolver(_alone(p, rows)) for rows in staged.rows]
        self._y = p.value[p.n_u : p.n]
        self._version = -1
        self._weighs: list[Vec] = []
        self.begin_over()

    def begin_over(self) -> None:
        """Forget all earlier ticks."""
        self._memories = [np.zeros(len(self._side)) for _ in self.staged.stages]
        for solver in (self.core, *self._finders):
            solver.reset()
        self._one_by_one = False

    # ---- one tick
    def begin(self) -> None:
        """Take over what the problem's memory says now."""
        p = self.problem
        if p.version != self._version:
            self._root[:] = 1.0 / np.sqrt(p.metric)
            weights = [*self.staged.weights[:-1], p.weights]
            self._units = [*(float(each.max(initial=0.0)) or 1.0 for each in weights[:-1]), p.unit]
            self._weighs = [np.sqrt(each / unit) for each, unit in zip(weights, self._units, strict=True)]
            self._version = p.version
        self._one_by_one = False
        self._unmet: list[tuple[slice, Vec, Vec]] = []  # levels with a residual: items, weights and residual

    def solve(self, k: int) -> Status:
        """Minimise level k; what stands above it holds."""
        if k == len(self.staged.stages) - 1 and not self._one_by_one:
            status = self.core.solve()
            self.iterations += self.core.iterations
            return status
        status = self._least(k)
        self.iterations += int(self._sizes[STEPS])
        if not status.ok:
            return status
        if not self._keeps(k):
            return Status.INACCURATE
        self._memories[k][:] = self._side
        if not self._sizes[LAST]:  # what holds nothing back would be moved to its bounds in the next tick, for nothing
            idle = self._item[: self._sizes[HELD]][self._holds[: self._sizes[HELD]] == 0.0]
            self._memories[k][idle] = 0.0
        self._one_by_one = True
        if self._sizes[LAST]:  # what held a level back is one value in the last problem
            p, kept = self.problem, self._places[self._kept != 0.0]
            p.lower[kept] = p.upper[kept] = p.value[kept]
        return Status.SOLVED

    def _least(self, k: int) -> Status:
        """The level in the space that those above it leave; the first opens that space."""
        begins = not self._one_by_one
        self._read(k, begins=begins)
        self._side[:] = self._memories[k]
        if begins:
            self._sizes[FIRST] = self.staged.rows[k].stop
            if search.begin(self._at) != SOLVED:
                return Status.FAILED
            self._sizes[FIRST] = self.staged.rows[k].start
        there = not begins or self._proof[0] <= _ENOUGH
        if there and search.guess(self._at) == SOLVED:
            self.counts.first += self._sizes[STEPS] == 1
            self.counts.repaired += self._sizes[STEPS] > 1
            return Status.SOLVED
        self.counts.fallback += 1
        status, found = self._find(k)
        if begins:
            if not status.ok:
                return status
            self._y[:] = found
            search.begin_from(self._at)
            self._sizes[INSIDE] = 1
        if search.guess(self._at) == SOLVED:
            return Status.SOLVED
        self._y[:] = found
        return Status.SOLVED if search.decide(self._at) == SOLVED else Status.FAILED

    def _find(self, k: int) -> tuple[Status, Vec]:
        """A point y within all bounds that keeps the levels above k, near the least, and its working set, by the core.

        The rows of the level weigh far more than the distance from the centre. Or the proof that there is no point.
        """
        finder, p, row = self._finders[k], self.problem, self.staged.rows[k].start
        q = finder.problem
        q.G[: q.soft.start], q.G[q.soft.start : q.n_rows] = p.G[: p.soft.start], p.G[row : p.n_rows]
        bounded = slice(0, p.item(p.range.stop))
        q.lower[bounded], q.upper[bounded] = p.lower[bounded], p.upper[bounded]
        kept = self._places[self._kept != 0.0]
        q.lower[kept] = q.upper[kept] = p.value[kept]
        q.metric[:], q.centre[:], q.scale[:] = p.metric, p.centre, p.scale
        # Of the rows in y alone, u = −X y, before what of the two parts cancels: rows may have nothing but u.
        along, X = q.G[q.soft, : p.n], np.linalg.solve(q.G[: p.n_u, : p.n_u], q.G[: p.n_u, p.n_u : p.n])
        parts = along[:, p.n_u :], along[:, : p.n_u] @ X
        longest = float(sum(np.vecdot(part, part) for part in parts).max(initial=0.0)) or 1.0
        for heavy in _HEAVY:
            q.weights[:] = heavy / longest * self._weighs[k] ** 2
            q.version += 1
            status = finder.solve()
            self.iterations += finder.iterations
            if status is Status.INACCURATE and finder.certificate.primal <= _ENOUGH:
                status = Status.SOLVED  # any point will do
            if status.ok or status is Status.INFEASIBLE:
                break
        self._side.fill(0.0)
        items, side = finder.working_set()
        self._side[np.searchsorted(self._places, items)] = side
        return status, q.x[p.n_u :]

    def _read(self, k: int, *, begins: bool) -> None:
        rows, sizes = self.staged.rows[k], self._sizes
        own = rows.stop - rows.start
        sizes[OWN], sizes[FIRST], sizes[STEPS] = own, rows.start, 0
        sizes[LAST], sizes[INSIDE] = k == len(self.staged.stages) - 1, not begins
        self._weigh[:own] = self._weighs[k]
        sizes[ROWS] = own + self._damp(k, own)

    def _damp(self, k: int, own: int) -> int:
        """Write the rows that damp level k, behind its own; how many there are."""
        pull = self._pulls[k]
        if pull is None:
            return 0
        on = np.flatnonzero(pull.weights)
        scale = self.problem.scale[self.problem.n_u :][pull.columns][on]
        self._which[: len(on)], self._toward[: len(on)] = pull.columns.start + on, pull.wanted[on] / scale
        self._weigh[own : own + len(on)] = np.sqrt(pull.share * pull.weights[on] / self._units[k]) * scale
        return len(on)

    def first_damped(self) -> int:
        """The first level that is damped now, or the last one: those above it may all be met at once."""
        damped = (k for k, pull in enumerate(self._pulls) if pull is not None and pull.weights.any())
        return next(damped, len(self._pulls) - 1)

    def _keeps(self, k: int) -> bool:
        """Whether the levels above still have what they came to."""
        p, first = self.problem, self.staged.rows[k].stop
        above = p.value[p.item(first) : p.item(p.n_rows)].copy()
        for rows, weights, residual in self._unmet:
            own = above[rows.start - first : rows.stop - first]
            now, before = residual + own, sqrt(float((weights * residual).dot(residual)))
            if sqrt(float((weights * now).dot(now))) - before > _LITTLE * (before + 1.0):
                return False
            own[:] = 0.0
        return float(np.abs(above).max(initial=0.0)) <= _ENOUGH

    def hold(self, k: int) -> Vec:
        """From here on level k keeps what it has; its residual (rows of the level,)."""
        search.finish(self._at)
        residual = self.staged.hold(k)
        is_damped = self._sizes[ROWS] > self._sizes[OWN]
        if float(np.abs(residual).max(initial=0.0)) > MET and not is_damped:
            self._unmet.append((self.staged.rows[k], self.staged.weights[k], residual))
        return residual

    # ---- what it is worth
    def met(self, k: int, residual: Vec) -> Certificate:
        """The certificate of a level with next to no residual: no level has less than none."""
        return self._found(k, np.abs(residual), float(np.abs(residual).max(initial=0.0)))

    def certificate(self, k: int) -> Certificate:
        """The certificate of level k, which was solved last."""
        if not self._one_by_one:
            return self.core.certificate
        proof.certify(self._at)
        _, primal, rho, slope, gap, under = self._proof.tolist()
        off = sqrt(rho * rho + slope * slope) + sqrt(gap) if self._sizes[LAST] else rho + sqrt(under)
        weigh = self._weighs[k]
        with np.errstate(divide="ignore"):
            return self._found(k, np.where(weigh > 0.0, off / weigh, 0.0), primal)

    def _found(self, k: int, reach: Vec, primal: float) -> Certificate:
        staged = self.staged
        asked = np.abs(staged.problem.G[staged.rows[k], staged.problem.n])
        bounds: Mapping[str, float] = {
            name: float(reach[place].max(initial=0.0)) for name, place in staged.parts[k].items()
        }
        return Certificate(primal, 0.0, 0.0, distance=float((reach / (1.0 + asked)).max(initial=0.0)), bounds=bounds)

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
        for memory in self._memories:
            memory[:] = [found.get(item, 0.0) for item in self._places.tolist()]

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
        found = np.linalg.lstsq((columns / length[:, None]).T, -pull, rcond=1e-12)[0] / length
        force[kept] = found[qp.n_eq :]
        return found[: qp.n_eq], force[: p.n_range], force[p.n_range :]


def _alone(p: RowProblem, rows: slice) -> RowProblem:
    """Memory for one level's rows as a weighted sum, where those above it hold."""
    return RowProblem(
        p.n_u, p.n_y, n_range=p.n_range, n_soft=rows.stop - rows.start, n_law=p.n_rows - rows.stop,
        rows=[*p.rows[: p.soft.start], *p.rows[rows.start :]], regularisation=0.0,
    )  # fmt: skip
