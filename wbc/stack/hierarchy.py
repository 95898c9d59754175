"""Hierarchy: what the levels of a stack mean, and so how a plan is solved."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from wbc import checks
from wbc.qp.lexicographic import LexicographicSolver, Part, Stage
from wbc.qp.rows import RowProblem, RowSolver, Wish, open_rows
from wbc.qp.solver import Solver


class Hierarchy(ABC):
    """Frozen settings; ``open`` gives the solver with its memory."""

    @abstractmethod
    def open(self, problem: RowProblem, solver: Solver) -> RowSolver:
        """The solver of one plan."""


@final
@dataclass(frozen=True)
class Weighted(Hierarchy):
    """One QP: the weighted sum of all tasks of all levels, ½ Σ wᵢ rᵢ², under the constraints and contacts.

    Of two tasks that contradict each other, with weight ratio r, the heavier keeps a relative error of about 1/r. Tasks
    that may be done in part (``task.scaled()``) keep their directions above everything else.
    """

    def open(self, problem: RowProblem, solver: Solver) -> RowSolver:
        tasks = [task for level in problem.levels for task in level]
        return _ranked(problem, solver, _keeping_directions(tasks), budget=None)


@final
@dataclass(frozen=True, kw_only=True)
class Strict(Hierarchy):
    """Strict priorities: a lower level never degrades a higher one.

    Least squares of level 1 under the constraints and contacts; of level 2 among all that keep level 1 at its least;
    and so on. The last level is a weighted sum as under :class:`Weighted`, with postures, forces and regularisation.
    Weights count within a level. A soft constraint (``limit.softly()``) is an inequality at its level.

    While all levels but the last can be met exactly this is one QP. Where one cannot, it and those below it are decided
    one by one: ``budget`` QPs a tick, by default two for each level and one. Levels that the budget does not reach are
    "not optimised": they stay where the level above left them. A tick without any strict answer minimises the weighted
    sum instead ("weighted fallback"). Neither is ``ok``. ``command.levels`` says how each level came out, with a
    certificate of its own.

    Source: Kanoun, Lamiraux, Wieber, IEEE T-RO 27(4), 2011; Escande, Mansard, Wieber, IJRR 33(7), 2014.

    Raises:
        InvalidInput: a budget below 1.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointVelocityLimits, Position, Posture
        >>> robot = wbc.load("arm")
        >>> stack = wbc.Stack([[Position("tool", target=[3.0, 0.0, 0.5])], [Posture(robot.q0)]],
        ...                   subject_to=[JointVelocityLimits()])
        >>> controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), hierarchy=wbc.Strict())
        >>> [level.how for level in controller.tick(0.0, robot.q0, 0 * robot.q0).levels]
        ['optimal', 'optimal']
    """

    budget: int | None = None

    def __post_init__(self) -> None:
        _check_budget(self.budget)

    def open(self, problem: RowProblem, solver: Solver) -> RowSolver:
        stages: list[Stage] = []
        for level in problem.levels:
            stages += _keeping_directions(level)
        return _ranked(problem, solver, stages, budget=self.budget)


@final
@dataclass(frozen=True, kw_only=True)
class Scaled(Hierarchy):
    """Every kinematic task is done as a whole or in part, never sideways: saturation in the null space, in a stack.

    Each task has a scale s in [0, 1], J x + drift = s t with t what its gains ask for. Level by level: first the
    directions (in least squares where no scale can keep them), then all scales as near to 1 as can be,
    ½ Σ w ‖t‖² (1 − s)². Tasks on the joints, linear tasks and soft constraints are decided after that at their level;
    those of the last level, with forces and regularisation, at the end. ``budget`` as under :class:`Strict`.

    Source: Flacco, De Luca, Khatib, IEEE T-RO 31(3), 2015; :mod:`wbc.methods.null_space_saturation` for one task.

    Example:
        >>> import wbc
        >>> wbc.Scaled()
        Scaled(budget=None)
    """

    budget: int | None = None

    def __post_init__(self) -> None:
        _check_budget(self.budget)

    def open(self, problem: RowProblem, solver: Solver) -> RowSolver:
        stages: list[Stage] = []
        rest: list[Part] = []
        for i, level in enumerate(problem.levels):
            scaled = [task for task in level if task.kinematic or task.scaled]
            rest = [Part(task) for task in level if not (task.kinematic or task.scaled)]
            if scaled:
                stages.append([Part(task, "direction") for task in scaled])
                stages.append([Part(task, "share") for task in scaled])
            if rest and i < len(problem.levels) - 1:
                stages.append(rest)
        return _ranked(problem, solver, [*stages, rest], budget=self.budget)


def _check_budget(budget: int | None) -> None:
    if budget is not None:
        checks.number("budget", budget, low=1)


def _keeping_directions(tasks: Sequence[Wish]) -> list[Stage]:
    """The directions of what may be done in part, where there is any, and then everything with its weights."""
    directions = [Part(task, "direction") for task in tasks if task.scaled]
    parts = [Part(task, "share" if task.scaled else "whole") for task in tasks]
    return [directions, parts] if directions else [parts]


def _ranked(problem: RowProblem, solver: Solver, stages: Sequence[Stage], *, budget: int | None) -> RowSolver:
    """One weighted QP where nothing is ranked, else stage after stage."""
    weighted = open_rows(problem, solver)
    if len(stages) < 2:
        return weighted
    most = 2 * len(stages) + 1 if budget is None else budget
    return LexicographicSolver(problem, stages, solver, budget=most, leave=weighted)
