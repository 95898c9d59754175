"""Hierarchy: how the levels of a stack are weighted or ordered when a plan is solved."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, final

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.qp.lexicographic import Part, Pull, Stage
from wbc.qp.rows import RowProblem, RowSolver, RowTask, open_rows
from wbc.qp.solver import Solver


class Rank(NamedTuple):
    """How one level is decided: directions first, then what its tasks weigh, and what is left of it after that."""

    directions: tuple[Stage, ...]
    own: Stage
    after: tuple[Stage, ...]

    @property
    def stages(self) -> tuple[Stage, ...]:
        """All of them in their order."""
        return (*self.directions, self.own, *self.after)

    @property
    def tasks(self) -> list[RowTask]:
        """The tasks that are decided once ``own`` is."""
        parts = [part for stage in (*self.directions, self.own) for part in stage]
        return list({id(part.task): part.task for part in parts}.values())


class Hierarchy(metaclass=TellsArguments):
    """Frozen settings; ``open`` gives the solver with its memory."""

    #: QPs a tick at most, None: two for each stage and one.
    budget: int | None = None

    @abstractmethod
    def ranks(self, levels: Sequence[Sequence[RowTask]]) -> list[Rank]:
        """How the levels of a problem are decided, one above the other."""

    def open(
        self, problem: RowProblem, solver: Solver, pulls: Sequence[Pull | None] = (), *, may_break: bool = False
    ) -> RowSolver:
        """The solver of one plan; ``pulls`` says what damps each stage.

        ``may_break``: the first level is about the last unknowns, the slacks of constraints.
        """
        ranks = self.ranks(problem.levels)
        stages = [stage for rank in ranks for stage in rank.stages]
        weighted = open_rows(problem, solver)
        if len(stages) < 2:
            return weighted
        # Who ranks nothing need not wait for the kernels.
        from wbc.qp.lexicographic.solver import LexicographicSolver
        from wbc.qp.lexicographic.unbroken import UnbrokenSolver

        most = 3 * len(stages) + 1 if self.budget is None else self.budget
        # Slacks are decided before all else, not weighed beside other tasks.
        if may_break and ranks[0].tasks == [*problem.levels[0]]:
            return UnbrokenSolver(problem, stages, budget=most, leave=weighted, pulls=pulls)
        return LexicographicSolver(problem, stages, budget=most, leave=weighted, pulls=pulls)


@final
@dataclass(frozen=True)
class Weighted(Hierarchy):
    """One QP: the weighted sum of all tasks of all levels, ½ Σ wᵢ rᵢ², under the constraints and contacts.

    Of two tasks that contradict each other, with weight ratio r, the heavier keeps a relative error of about 1/r. Tasks
    that may be done in part (``task.scaled()``) keep their directions above everything else.
    """

    def ranks(self, levels: Sequence[Sequence[RowTask]]) -> list[Rank]:
        return [_keeping_directions([task for level in levels for task in level])]


@dataclass(frozen=True, kw_only=True)
class _Ranked(Hierarchy):
    """What decides level by level has a budget."""

    budget: int | None = None

    def __post_init__(self) -> None:
        if self.budget is not None:
            checks.number("budget", self.budget, low=1)


@final
@dataclass(frozen=True, kw_only=True)
class Strict(_Ranked):
    """Strict priorities: a lower level never degrades a higher one.

    Least squares of level 1 under the constraints and contacts; of level 2 among all that keep level 1 at its minimum;
    and so on. The last level is a weighted sum as under :class:`Weighted`, with postures, forces and regularisation.
    Weights count within a level. A soft constraint (``limit.softly()``) is an inequality at its level. A level that had
    a residual in the tick before is damped (``lm_damping``, :class:`~wbc.stack.damping.Damping`): its minimum is then
    that of the tasks with their damping, and the levels below are slowed.

    While all levels but the last can be met exactly this is one QP. Where one cannot, it and those below it are decided
    one by one: ``budget`` QPs a tick, by default three for each level and one. Levels that it does not reach are "not
    optimised": they stay where the level above left them. A tick without any strict answer minimises the weighted sum
    instead ("weighted fallback"). Neither is ``ok``. ``command.levels`` has the result of each level, with its own
    certificate.

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

    def ranks(self, levels: Sequence[Sequence[RowTask]]) -> list[Rank]:
        return [_keeping_directions(level) for level in levels]


@final
@dataclass(frozen=True, kw_only=True)
class Scaled(_Ranked):
    """Kinematic tasks keep their direction and are slowed where limits are active: saturation in the null space.

    Each task has a scale s in [0, 1] with J x + drift = s t, where t is the velocity or acceleration that its gains
    request. Each level first fixes the directions, in least squares where no scale can keep them, then maximises the
    scales: minimise ½ Σ w ‖t‖² (1 − s)². Tasks on the joints, linear tasks and soft constraints of the level follow;
    those of the last level come at the end with the forces and the regularisation. ``budget`` and damping are as under
    :class:`Strict`; directions get a thousandth of the damping. At the level of accelerations a scaled task brakes
    with its whole kd.

    Source: Flacco, De Luca, Khatib, IEEE T-RO 31(3), 2015; :mod:`wbc.methods.null_space_saturation` for one task.

    Example:
        >>> import wbc
        >>> wbc.Scaled()
        Scaled(budget=None)
    """

    def ranks(self, levels: Sequence[Sequence[RowTask]]) -> list[Rank]:
        ranks: list[Rank] = []
        for i, level in enumerate(levels):
            scaled = [task for task in level if task.kinematic or task.scaled]
            rest = [Part(task) for task in level if not (task.kinematic or task.scaled)]
            is_last = i == len(levels) - 1
            if scaled:
                directions, shares = ([Part(task, kind) for task in scaled] for kind in ("direction", "share"))
                ranks.append(Rank((directions,), shares, (rest,) if rest or is_last else ()))
            elif rest or is_last:
                ranks.append(Rank((), rest, ()))
        return ranks


def _keeping_directions(tasks: Sequence[RowTask]) -> Rank:
    """The directions of what may be done in part, where there is any, and then everything with its weights."""
    directions = [Part(task, "direction") for task in tasks if task.scaled]
    parts = [Part(task, "share" if task.scaled else "whole") for task in tasks]
    return Rank((directions,) if directions else (), parts, ())


#: What a scenario or a command names.
HIERARCHIES: Mapping[str, Hierarchy] = {"weighted": Weighted(), "strict": Strict(), "scaled": Scaled()}
