"""Constraints that may be broken: as long as none has to be, levels are decided without their slacks.

The slacks of constraints are the first stage. A stage whose residual can be zero is decided by that alone: with all
slacks at zero the stages below have the same answer. A humanoid has hundreds of pairs of bodies that may not touch,
each with a slack, and fifty other unknowns; what dense factors cost grows with the cube of the unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import final

from wbc.qp.certificate import Bounds, Certificate
from wbc.qp.lexicographic.parts import Pull, Stage
from wbc.qp.lexicographic.solver import LexicographicSolver
from wbc.qp.rows import Outcome, RowProblem, RowSolver
from wbc.types import Index, Status, Vec


@final
class UnbrokenSolver(RowSolver):
    """Ranked stages, of which the first is about the last unknowns, and wants them to be zero: slacks.

    Where no point keeps all constraints, all stages are decided; in the next ticks, too, until no slack is needed.
    """

    form = "levels"
    is_compiled = True

    def __init__(
        self, source: RowProblem, stages: Sequence[Stage], *, budget: int, leave: RowSolver,
        pulls: Sequence[Pull | None] = (),
    ) -> None:  # fmt: skip
        super().__init__(source)
        slack, *others = stages
        without = sum(part.task.dim for part in slack)
        self._names = tuple(str(part) for part in slack)
        self._unbroken = LexicographicSolver(source, others, budget=budget, pulls=pulls[1:], without=without)
        self._broken = LexicographicSolver(source, stages, budget=budget, leave=leave, pulls=pulls)
        self._broken.count_with(self._unbroken)
        self.counts, self.kernel = self._unbroken.counts, self._unbroken.kernel
        self.reset()

    def reset(self) -> None:
        self._last, self._is_broken = self._unbroken, False
        self._unbroken.reset()
        self._broken.reset()

    def solve(self) -> Status:
        return self._all() if self._is_broken else self._judged(self._unbroken.solve())

    def concluded(self, code: int) -> Status:
        return self._all() if self._is_broken else self._judged(self._unbroken.concluded(code))

    def _judged(self, status: Status) -> Status:
        """What the stages below came to without slacks; where that is no answer, all stages."""
        solver = self._unbroken
        if not (status.ok or (solver.shortfall and solver.is_spent)):
            return self._all()
        self._last = solver
        self.shortfall, self.iterations = solver.shortfall, solver.iterations
        self.proof = partial(_proven, self._names, solver.proof)
        self.report = partial(_ranked, self._names, solver.report)
        return status

    def _all(self) -> Status:
        self._last = solver = self._broken
        status = solver.solve()
        self._is_broken = not (status.ok and solver.first_is_met)
        self._unbroken.wait(self._is_broken)
        self.shortfall, self.iterations = solver.shortfall, solver.iterations
        self.proof, self.report = solver.proof, solver.report
        return status

    # ---- what others read
    @property
    def answered(self) -> RowProblem:
        return self._last.answered

    @property
    def shared(self) -> int:
        return self._last.shared

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return self._last.multipliers()

    def working_set(self) -> tuple[Index, Vec]:
        return self._last.working_set()

    def guess(self, items: Index, side: Vec) -> None:
        self._unbroken.guess(items, side)
        self._broken.guess(items, side)


def _proven(names: Sequence[str], proof: Callable[[], Certificate]) -> Certificate:
    """The certificate of the stages below, with the bounds of slacks that are zero."""
    found = proof()
    return found._replace(bounds=Bounds(lambda: {**dict.fromkeys(names, 0.0), **found.bounds}))


def _ranked(names: tuple[str, ...], report: Callable[[], tuple[Outcome, ...]]) -> tuple[Outcome, ...]:
    """How all stages came out, the first one met."""
    proof = Certificate(0.0, 0.0, 0.0, distance=0.0, bounds=dict.fromkeys(names, 0.0))
    return Outcome(names, "met", 0.0, proof), *report()
