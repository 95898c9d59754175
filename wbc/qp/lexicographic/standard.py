"""Stages in standard form: each is a QP that any solver can answer."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.qp.certificate import Certificate
from wbc.qp.lexicographic.stages import MET, StagedProblem
from wbc.qp.lexicographic.way import Way
from wbc.qp.rows import RowProblem
from wbc.qp.rows.standard import StandardSolver
from wbc.qp.solver import Counts, Solver
from wbc.qp.solvers import by_name
from wbc.types import Index, Status, Vec

#: The last stage's metric in a stage above it, as a share of the largest curvature there.
_DELTA = 1e-8
#: Proximal steps after the first at a stage above the last: each takes the trace's effect away by another factor.
_STEPS = 2
#: Multipliers above this share of the largest push.
_PUSHES = 1e-6
#: Who is asked where a solver does not find the points that are known to be there: a method that needs no vertex.
_PATIENT = "proxqp"
#: Room around the point that the stages above came to: what they hold may leave nothing but that point.
_ROOM = 1e-9
_NONE: Index = np.zeros(0, np.intp)


@final
class StandardStages(Way):
    """One session for each stage; equalities are what stands above it.

    A stage above the last is ½ Σ wᵢ rᵢ² + ½ ε ‖y − c‖²_D, where c is first the centre and then the answer before: the
    trace of the metric makes the answer one point, and no longer moves it.
    """

    form = "standard"

    def __init__(self, staged: StagedProblem, solver: Solver) -> None:
        self.staged, self.solver = staged, solver
        self.counts, self.iterations = Counts(), 0
        self._stages = [staged.at(k) for k in range(len(staged.stages))]
        self._solvers: dict[int, StandardSolver] = {}
        self._active = _NONE, np.zeros(0)
        self.begin()

    def begin_over(self) -> None:
        for solver in self._solvers.values():
            solver.reset()

    def begin(self) -> bool:
        self._held, self._held_at = _NONE, np.zeros(0)
        return True

    def guess(self, items: Index, side: Vec) -> None:
        """Sessions keep warm starts of their own."""

    def solve(self, k: int) -> Status:
        q = self._stages[k]
        self._bounds(q)
        if k < len(self._stages) - 1:
            self._prepare(q)
        status = self._run(k)
        self._active = self._answered.active(0.0)
        for _ in range(_STEPS if status.ok and k < len(self._stages) - 1 else 0):
            answer = q.value.copy()
            q.centre[:] = q.x[q.n_u :]
            if not self._run(k).ok:
                q.value[:] = answer
                break
        return status

    def _run(self, k: int) -> Status:
        if k not in self._solvers:
            self._solvers[k] = StandardSolver(self._stages[k], self.solver)
        self._answered = self._solvers[k]
        status = self._answered.solve()
        self.counts.fallback += self.solver.name == "daqp"
        if status is Status.INFEASIBLE and len(self._held):
            # It is feasible: the stages above hold at a point that is known. What they leave may be as thin as that.
            self._answered = StandardSolver(self._stages[k], by_name(_PATIENT))
            status = self._answered.solve()
        self.iterations += self._answered.iterations
        return status

    def _bounds(self, q: RowProblem) -> None:
        """Those of the problem, but the point that the stages above came to is never outside by a rounding."""
        p, n = self.staged.problem, self.staged.problem.item(self.staged.problem.soft.start)
        q.lower[:n], q.upper[:n] = p.lower[:n], p.upper[:n]
        if len(self._held):
            q.lower[self._held] = np.minimum(q.lower[self._held], self._held_at - _ROOM)
            q.upper[self._held] = np.maximum(q.upper[self._held], self._held_at + _ROOM)

    def _prepare(self, q: RowProblem) -> None:
        """Weigh the stage against a trace of the last stage's metric."""
        p = self.staged.problem
        rows = p.G[q.soft, p.n_u : p.n]
        curvature = float((q.weights * (rows * rows / p.metric).sum(axis=1)).max(initial=0.0)) or 1.0
        q.unit = _DELTA * curvature
        q.regularisation = p.regularisation * q.unit / p.unit
        q.centre[:] = p.centre

    def pushing(self) -> Index:
        """Items that held the last answer back."""
        q = self._answered.problem
        residual = q.value[q.item(q.soft.start) : q.item(q.soft.stop)]
        pull = np.abs((q.weights * residual) @ q.G[q.soft, : q.n]).max(initial=0.0)
        met = np.abs(residual).max(initial=0.0) <= MET
        return _NONE if met else self._answered.active(_PUSHES * float(pull))[0]

    def hold_at(self, held: Index, value: Vec) -> None:
        """Points that must stay within reach, found by somebody else."""
        self._held, self._held_at = held, value

    def hold(self, k: int) -> Vec:
        residual = self.staged.hold(k)
        p = self.staged.problem
        near = np.arange(p.item(p.soft.start))
        self.hold_at(near, p.value[near])
        return residual

    def active(self) -> tuple[Index, Vec]:
        return self._active

    def certificate(self) -> Certificate:
        return self._answered.certificate

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return self._answered.multipliers()
