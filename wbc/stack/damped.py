"""Levels that rank above others, damped where they cannot be met: out of reach leads to rest under any hierarchy."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from itertools import accumulate
from typing import TYPE_CHECKING, final

import numpy as np

from wbc.qp.lexicographic import LexicographicSolver, Stage
from wbc.qp.lexicographic.solver import worst
from wbc.qp.rows import Outcome, RowProblem, RowSolver, Wish
from wbc.qp.solver import Solver
from wbc.stack.damping import ResidualDamping
from wbc.stack.hierarchy import Hierarchy, Rank
from wbc.types import Index, Status, Vec

if TYPE_CHECKING:
    from wbc.stack.plan import Plan

#: What each share has in the metric, which has a one for it, beside the heaviest joint: more than rounding.
_SHARES = 1e-3
#: What directions feel of the damping: they are kept to about this share of what is asked.
_SIDEWAYS = 1e-3


def open_plan(plan: Plan, hierarchy: Hierarchy, solver: Solver) -> RowSolver:
    """The solver of a plan whose levels mean what ``hierarchy`` says, each damped by what was left of it.

    The last stage has its damping in the metric. Levels with kinematic tasks that are decided before it are damped
    apart (:class:`DampedLevels`).
    """
    whole, damping = hierarchy.open(plan.problem, solver), plan.damping
    ranks = hierarchy.ranks(plan.problem.levels)
    stops = list(accumulate(len(rank.stages) for rank in ranks))
    stages = [stage for rank in ranks for stage in rank.stages]
    upper: list[tuple[Rank, list[Stage]]] = []
    for rank, stop in zip(ranks, stops, strict=True):
        decided = stages[: stop - len(rank.after)]
        if len(decided) < len(stages) and any(wish.kinematic for wish in rank.wishes):
            upper.append((rank, decided))
    if not upper or not damping.factor:
        return whole
    if not damping.of_levels:
        sizes = [sum(wish.kinematic for wish in rank.wishes) for rank, _ in upper]
        ends = list(accumulate(sizes))
        damping.divide(
            [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)],
            slice(ends[-1], len(plan.layout.kinematic)),
        )
    levels = [_Level(plan, rank, decided, own) for (rank, decided), own in zip(upper, damping.of_levels, strict=True)]
    return DampedLevels(plan.problem, whole, levels)


@final
class _Alone:
    """Stages by themselves, the last of them with the damping of a level.

    The problem shares all rows, bounds and values with that of the plan, and has a cost of its own: the tasks of the
    last stage, ``share`` of the damping, and the regularisation on every unknown.
    """

    def __init__(self, plan: Plan, stages: Sequence[Stage], damping: ResidualDamping, *, share: float = 1.0) -> None:
        source = plan.problem
        self._damping, self._share, self._v = damping, share, plan.damping.v
        self._least = plan.level.regularisation
        wishes = [part.wish for part in stages[-1] if part.kind == "whole"]
        self._pulls = [(_behind(source, wish), wish) for wish in wishes if wish.rows is None]
        self._problem = p = copy.copy(source)
        p.metric, p.centre = np.ones(p.n_y), np.zeros(p.n_y)
        self._weight = np.ones(p.n_y)
        self.refresh()
        self.solver = LexicographicSolver(p, stages, budget=2 * len(stages) + 1)

    def refresh(self) -> None:
        """Read the weights of the tasks and the damping."""
        p, weight, damping = self._problem, self._weight, self._damping
        weight[:] = self._least
        for at, wish in self._pulls:
            weight[at] += wish.weights
        self.base = weight[damping.columns].copy()
        weight[damping.columns] += self._share * damping.applied
        p.unit = max(self._least, _SHARES * float(weight[damping.columns].max()))
        np.multiply(weight / p.unit, p.scale[p.n_u :] ** 2, out=p.metric)
        p.version += 1

    def solve(self) -> Status:
        """The least of the last stage, damped, under the others."""
        self.refresh()
        p, damping, pull = self._problem, self._damping, np.zeros(self._problem.n_y)
        for at, wish in self._pulls:
            pull[at] += wish.weights * wish.wanted
        pull[damping.columns] -= self._share * damping.applied * damping.rate * self._v[-len(damping.rate) :]
        np.divide(pull / self._weight, p.scale[p.n_u :], out=p.centre)
        return self.solver.solve()


def _behind(problem: RowProblem, wish: Wish) -> slice:
    """Which of y the unknowns of a task are."""
    assert wish.unknowns is not None
    return slice(wish.unknowns.start - problem.n_u, wish.unknowns.stop - problem.n_u)


@final
class _Level:
    """A level that ranks above others: what it comes to by itself, damped, under those above it."""

    def __init__(self, plan: Plan, rank: Rank, stages: Sequence[Stage], damping: ResidualDamping) -> None:
        self.damping, self.wishes, self._p, self._v = damping, rank.wishes, plan.problem, plan.damping.v
        #: Where its stages stand among all.
        self.places = slice(len(stages) - len(rank.directions) - 1, len(stages))
        self._own = _Alone(plan, stages, damping)
        self._turning = _Alone(plan, stages[:-1], damping, share=_SIDEWAYS) if rank.directions else None
        self._turned = [part.wish for stage in rank.directions for part in stage]
        #: What a task does in part it brakes with all of its kd: tasks and where their kd is.
        self._braking: list[tuple[Wish, slice, Vec]] = []
        for wish in self._turned if plan.level.order > 1 else ():
            if wish.kinematic and wish.rows is not None:
                first, last = wish.rows.start - plan.layout.motion_row, wish.rows.stop - plan.layout.motion_row
                self._braking.append((wish, wish.rows, plan.motion.kd[first:last]))
        self.refresh()

    def refresh(self) -> None:
        """Read the weights of its tasks."""
        self._own.refresh()
        self.damping.base[:] = self._own.base

    def solve(self) -> Status:
        """Its least, damped: first directions, where it has any, and then all of it."""
        p = self._p
        if self._turning is not None:
            for wish, rows, kd in self._braking:
                wish.drift[:] += kd * (p.G[rows, : len(self._v)] @ self._v)
            status = self._turning.solve()
            if not status.ok:
                return status
            self._turn()
        return self._own.solve()

    def _turn(self) -> None:
        """Directions are missed by what they were just missed by: J x + drift − s t."""
        p = self._p
        for wish in self._turned:
            asked = wish.wanted + wish.drift
            came = self._came(wish) + wish.drift
            square = float((wish.weights * asked).dot(asked))
            share = min(max(float((wish.weights * asked).dot(came)) / square, 0.0), 1.0) if square else 0.0
            beside = came - share * asked
            wish.wanted[:] += beside
            wish.drift[:] -= beside
            if wish.rows is not None:
                p.G[wish.rows, p.n] -= beside

    def _came(self, wish: Wish) -> Vec:
        """What the rows or unknowns of a task have come to: J x."""
        p = self._p
        came: Vec = p.x[wish.unknowns] * p.scale[wish.unknowns] if wish.rows is None else p.G[wish.rows, : p.n] @ p.x
        return came

    def take(self) -> None:
        """From now on its tasks ask for what they have come to."""
        p = self._p
        for wish in self.wishes:
            if wish.rows is None:
                wish.wanted[:] = self._came(wish)
            else:
                residual = p.G[wish.rows] @ p.x1
                wish.wanted[:] += residual
                p.G[wish.rows, p.n] -= residual

    def outcomes(self) -> Sequence[Outcome]:
        """How its stages came out."""
        return self._own.solver.outcomes[self.places]

    def reset(self) -> None:
        """Forget the warm start."""
        for alone in (self._own, self._turning):
            if alone is not None:
                alone.solver.reset()


@final
class DampedLevels(RowSolver):
    """Strict levels, each damped where the tick before left something of it.

    A strict level is at its least, whatever joint speed that takes, and where an arm is stretched out that is any
    speed. So a level with damping (:class:`~wbc.stack.damping.ResidualDamping`) is solved by itself first, under what
    ranks above it,

        minimise ½ Σ wᵢ (Jᵢ x − tᵢ)² + ½ Σ dⱼ (xⱼ − cⱼ)²

    and then asks for what it came to, t := J x, which can be met. The levels below have what J leaves, slowed
    (:class:`~wbc.stack.damping.Damping`). Where no level is damped this is the strict solver and nothing else.

    Source: Chiaverini, IEEE T-RA 13(3), 1997 (damped least squares above an undamped null space); the residual as
    under ``Weighted``.
    """

    def __init__(self, problem: RowProblem, whole: RowSolver, levels: Sequence[_Level]) -> None:
        super().__init__(problem)
        self.form, self._whole, self._levels = whole.form, whole, levels
        self.counts = whole.counts
        self._version = problem.version

    def solve(self) -> Status:
        p = self.problem
        if p.version != self._version:
            self._version = p.version
            for level in self._levels:
                level.refresh()
        damped = [level for level in self._levels if level.damping.is_on]
        status = self._damped(damped) if damped else Status.FAILED
        if not status.ok:
            status = self._whole.solve()
            self.outcomes, self.certificate = self._whole.outcomes, self._whole.certificate
        self.shortfall, self.iterations = self._whole.shortfall, self._whole.iterations
        return status

    def _damped(self, levels: Sequence[_Level]) -> Status:
        """Every level that is damped by itself, and then all together."""
        p = self.problem
        wishes = [wish for level in levels for wish in level.wishes]
        wanted = [p.G[:, p.n], *(wish.wanted for wish in wishes), *(wish.drift for wish in wishes)]
        before = [values.copy() for values in wanted]
        found: list[tuple[slice, Sequence[Outcome]]] = []
        try:
            for level in levels:
                status = level.solve()
                if not status.ok:
                    return status
                found.append((level.places, level.outcomes()))
                level.take()
            status = self._whole.solve()
        finally:
            for values, former in zip(wanted, before, strict=True):
                values[:] = former
        if not status.ok:
            return status
        soft = slice(p.soft.start, p.soft.stop)
        p.value[p.item(soft.start) : p.item(soft.stop)] = p.G[soft] @ p.x1
        outcomes = list(self._whole.outcomes)
        for places, own in found:
            outcomes[places] = own
        self.outcomes = tuple(outcomes)
        self.certificate = worst(outcome.certificate for outcome in outcomes)
        return Status.SOLVED if self.certificate.ok else Status.INACCURATE

    def reset(self) -> None:
        self._whole.reset()
        for level in self._levels:
            level.reset()

    # ---- what others read
    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return self._whole.multipliers()

    def working_set(self) -> tuple[Index, Vec]:
        return self._whole.working_set()

    def guess(self, items: Index, side: Vec) -> None:
        self._whole.guess(items, side)

    @property
    def active_count(self) -> int:
        return self._whole.active_count

    @property
    def answered(self) -> RowProblem:
        return self._whole.answered
