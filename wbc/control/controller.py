"""Controller: from a state to a command, at every tick, whatever happens.

    state → components.before → plan.fill → solve → certificate → command → components.after

A tick raises only for programming errors (a wrong type or shape). Numbers that are not finite and solves that fail give
a bounded command all the same, from the next fallback level (:mod:`wbc.control.recovery`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import deepcopy
from functools import partial, wraps
from pathlib import Path
from threading import RLock
from time import perf_counter
from typing import Any, TypeVar, cast, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments, tells_arguments
from wbc.control.command import Command
from wbc.control.explain import explain, reproducer
from wbc.control.measured import Measured
from wbc.control.recovery import FallbackSequence, Recovery
from wbc.control.solving import Solving
from wbc.control.watchdog import Watch, Watchdog
from wbc.errors import InvalidInput, MemberFailed, NotSupported, WbcError
from wbc.models import plausible
from wbc.models.model import RobotModel
from wbc.qp.solver import Solver
from wbc.qp.solvers import by_name
from wbc.stack.component import Component
from wbc.stack.formulation import Formulation
from wbc.stack.hierarchy import Hierarchy, Weighted
from wbc.stack.overrides import Overrides
from wbc.stack.plan import Plan
from wbc.stack.plans import Plans
from wbc.stack.stack import Stack
from wbc.tolerances import MET
from wbc.types import Status, Vec

#: What is said to have raised where that has no name of its own: a member's property, or this library.
UNNAMED = "the tick"
#: A member of an Enum is slow to look up, and a tick asks for this one.
_SOLVED = Status.SOLVED
_F = TypeVar("_F", bound=Callable[..., Any])
_WITHIN = "{} was called within a tick of the same controller, or a replace"


def _in_turn(method: _F) -> _F:
    """One call at a time: another thread waits, and what runs within a call is refused, as a member that ticks."""

    @wraps(method)
    def call(self: Controller, *given: Any, **named: Any) -> Any:
        with self._turn:
            if self._busy:
                raise InvalidInput(_WITHIN.format(method.__name__))
            self._busy = True
            try:
                return method(self, *given, **named)
            finally:
                self._busy = False

    return cast(_F, call)


@final
class Controller(Solving, metaclass=TellsArguments):
    """Decides the command of each tick for a robot and a stack.

    Args:
        robot: from :func:`wbc.load`.
        stack: the tasks, contacts, constraints and components.
        level: ``VelocityLevel()``, ``AccelerationLevel()`` or ``InverseDynamics()``.
        hierarchy: ``Weighted()``, the default, ``Strict()`` or ``Scaled()``: how conflicts are resolved.
        solver: a solver's name or its settings.
        dt: time between ticks [s].
        recovery: settings of the fallback sequence for ticks without a certified solution.
        watchdog: settings for stale states and for late and long ticks; ``watch`` counts them.

    Raises:
        NotSupported: several robots, a member the level cannot carry, or a solver that cannot keep limits at this rate.
        InvalidInput, UnknownFrame, UnknownSolver: an argument that makes no sense, by name.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointVelocityLimits, Position
        >>> robot = wbc.load("arm")
        >>> reach = Position("tool", target=[0.4, 0.2, 0.5])
        >>> stack = wbc.Stack([reach], subject_to=[JointVelocityLimits()])
        >>> controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=1e-3)
        >>> command = controller.tick(0.0, robot.q0, robot.q0 * 0)
        >>> command.status.name
        'SOLVED'
    """

    __slots__ = (
        "_acceleration", "_busy", "_former", "_kept", "_solved", "_started", "_turn", "components", "fallbacks",
        "measured", "watch",
    )  # fmt: skip

    #: The plan that the tick before was solved with.
    _solved: Plan | None
    #: The plans and components of the stack that the last tick was made with, until the first tick with another.
    _former: Plans | None
    #: The last acceleration (nj,) with that stack.
    _acceleration: Vec
    _started: bool
    _kept: Sequence[Component]
    #: What the last tick was given.
    measured: Measured

    def __init__(
        self,
        robot: RobotModel,
        stack: Stack,
        *,
        level: Formulation,
        hierarchy: Hierarchy | None = None,
        solver: str | Solver = "pdas",
        dt: float = 1e-3,
        recovery: Recovery | None = None,
        watchdog: Watchdog | None = None,
    ) -> None:
        if isinstance(robot, list | tuple):
            raise NotSupported(
                f"robot is {len(robot)} robots, and a controller has one: give each free robot its own controller; "
                "robots bolted to one world may be one tree of one file"
            )
        robot = checks.instance("robot", robot, RobotModel, "a robot from wbc.load(...)")
        stack = checks.instance("stack", stack, Stack, "a wbc.Stack")
        checks.instance("level", level, Formulation, "VelocityLevel(), AccelerationLevel() or InverseDynamics()")
        dt = checks.number("dt", dt, low=0.0, strict=True)
        plausible.period(dt)
        self.fallbacks = FallbackSequence(self, recovery)
        watchdog = Watchdog() if watchdog is None else watchdog
        self.watch = Watch(checks.instance("watchdog", watchdog, Watchdog, "wbc.Watchdog(...)"), dt)
        hierarchy = Weighted() if hierarchy is None else hierarchy
        checks.instance("hierarchy", hierarchy, Hierarchy, "Weighted(), Strict() or Scaled()")
        self._turn, self._busy = RLock(), False
        solver = by_name(solver)
        if solver.offline:
            raise NotSupported(
                f"solver {solver.name!r} cannot keep limits to {MET:g} in a control loop; it is for offline use"
            )
        super().__init__(robot, stack, level, hierarchy=hierarchy, solver=solver, dt=dt)
        plan = self.plans.whole.plan
        if level.dynamics:
            plausible.torques(robot, *plan.torque_bounds)
            if not stack.components:  # they may know of other forces
                plausible.held(robot, [contact.force_weight for contact in stack.contacts])
        self.measured = Measured(robot)
        self.components = stack.components
        self.reset()

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy, or a pickle, is a controller made anew from the same settings: it remembers nothing."""
        settings: dict[str, Any] = {
            "level": self.level, "hierarchy": self.hierarchy, "solver": self.solver, "dt": self.dt,
            "recovery": self.fallbacks.recovery, "watchdog": self.watch.settings,
        }  # fmt: skip
        return partial(Controller, **settings), (self.model, self.stack)

    def __copy__(self) -> Controller:
        """The same as ``copy.deepcopy``: components have memory, so a copy has its own, and its own members."""
        return deepcopy(self)

    @tells_arguments
    @_in_turn
    def replace(self, stack: Stack) -> None:
        """Replace the stack from the next tick on; call it between ticks. In another thread it delays the next tick.

        This compiles the stack, which takes some milliseconds for a humanoid. docs/changing.md says what continues from
        the old stack and what starts anew. If a tick fails before one of the new stack was solved, the controller
        brakes; it does not hold a command of the old stack.

        Raises:
            InvalidInput, NotSupported, UnknownFrame, Infeasible: as when a controller is made; then this one goes on
                with the stack that it has. InvalidInput, too, where a member calls it within a tick.

        Example:
            >>> import numpy as np, wbc
            >>> from wbc.tasks import JointAccelerationLimits, JointVelocityLimits, Position, Posture
            >>> robot = wbc.load("arm")
            >>> limits = [JointVelocityLimits(), JointAccelerationLimits(10.0)]
            >>> controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)], subject_to=limits),
            ...                             level=wbc.VelocityLevel())
            >>> command = controller.tick(0.0, robot.q0, np.zeros(robot.nv))
            >>> controller.replace(wbc.Stack([Position("tool", target=[0.4, 0.2, 0.5])], subject_to=limits))
            >>> command = controller.tick(1e-3, command.q, command.v)
            >>> command.status.name, bool(np.abs(command.v).max() <= 10.0 * controller.dt + 1e-9)
            ('SOLVED', True)
        """
        checks.instance("stack", stack, Stack, "a wbc.Stack")
        if self._started:  # else no tick was made with the stack that is replaced now
            self._former, self._kept = self.plans, self.components
        try:
            state, former = self.compile(stack, prepared=self._kept), self.state
        except Exception:
            for component in self._kept:  # some have looked at the plan that is refused
                component.check(self.plans.whole.plan)
            raise
        state.update(former.t, former.q, former.v)
        self.state = state
        if self._started and self.last is not None:
            self._acceleration = self._accelerated(self.last)
        if self._solved is self.plan:
            self.plan.observe()
        self.components = stack.components
        self._started, self._solved, self.fallbacks.good = False, None, None
        self.is_new = True
        self.use(self.plans.whole)

    def __repr__(self) -> str:
        return f"Controller({self.model.name}, {self.level.name}, {self.hierarchy}, {self.solver.name}, dt={self.dt:g})"

    @_in_turn
    def reset(self) -> None:
        """Forget everything: contacts are made anew at the next tick, components and bounds start again."""
        self.ticks, self.is_new = 0, True
        self.why = ""
        self.last = None
        self.status = Status.FAILED
        self._solved = None
        self.fallbacks.reset()
        self.watch.reset()
        self._started = False
        self._former, self._kept = None, ()
        self.plans.reset()
        self.use(self.plans.whole)

    # ---- the tick
    def tick(self, t: float, q: Vec, v: Vec) -> Command:
        """Decide the command for time t [s], configuration q (nq,) and velocity v (nv,).

        Raises:
            InvalidInput: q or v has another shape, an argument is not real numbers, or it is called within a tick.
                Nothing else is raised.
        """
        with self._turn:  # written out: in every tick a decorator costs more than this
            if self._busy:
                raise InvalidInput(_WITHIN.format("tick"))
            self._busy = True
            try:
                watch = self.watch
                start = perf_counter() if watch.timed else 0.0
                measured = self.measured
                t, q, v = measured.read(t, q, v)
                self.ticks += 1
                self.serial += 1
                self.is_new, self.has_problem = False, True
                odd = watch.seen(t)
                self.why = measured.take(t, q, v) or odd
                if self.why:
                    command = self.fallbacks.unposed(Status.INVALID_STATE)
                else:
                    decide = self._decide if self.mode.is_compiled else self._decide_in_silence
                    try:
                        command = decide(t, measured.moment)
                    except Exception as cause:  # members are users' code, and may raise anything anywhere
                        self.why = str(cause if isinstance(cause, WbcError) else MemberFailed(UNNAMED, cause))
                        command = self.fallbacks.unposed(Status.FAILED, measured.moment)
                intervals = self.plan.intervals
                if intervals.remembers:
                    accuracy = MET if self._level.order == 2 else MET / self._dt
                    jerks = intervals.remember(self._accelerated(command), accuracy=accuracy)
                    if jerks and command.status.ok:
                        self.why = f"{self.why}; {jerks}" if self.why else jerks
                for component in filter(self._has, self.components):
                    self._tell(component, command)
                self.last = command
                if watch.timed and (why := watch.took(start)):
                    self.fallbacks.write_down(command, why)
                return command
            finally:
                self._busy = False

    def _accelerated(self, command: Command) -> Vec:
        """The joint accelerations (nj,) of a command that was decided in the present state."""
        joints: Vec = (command.v - self.state.v)[self.model.nb :] / self.dt
        return joints

    def _has(self, component: Component) -> bool:
        return component.serves is self.plans.whole.plan

    def _tell(self, component: Component, command: Command) -> None:
        """Show a component what was decided. If it raises, what was decided stands, and the status says that it did."""
        try:
            component.after(self.state, command)
        except Exception as cause:
            self.fallbacks.spoilt(command, str(MemberFailed(f"{component.name}.after", cause)))

    def _decide(self, t: float, moment: Vec) -> Command:
        state = self.state
        state.move(t, moment)
        if self.mode.in_one_call and self._started and not self.components:
            observes, self._solved = self._solved is self.plan, None
            self.answering = solver = self.mode.solver
            status = self.plan.answer(state, solver, observes=observes)
        else:
            self._ask_members()
            status = self.solve_with(self.mode.solver)
        self.status, plan = status, self.plan
        if status is not _SOLVED:
            command = self.fallbacks.descend(status, moment)
            self._solved = plan if command.status is _SOLVED else None  # by another solver: damped as by the own one
            return command
        if plan.intervals.recovering:
            self.why = plan.intervals.recovery(state.q_joints)
        if plan.barriers:
            self.why = "; ".join(filter(None, [self.why, *(block.says.note for block in plan.barriers)]))
        self._solved = plan
        command = self.decode(moment)
        if self.fallbacks.failures:
            return self.fallbacks.resume(command, moment)
        self.fallbacks.good = command
        return command

    # What overflows has a status: where warnings are errors, a tick raises none. Compiled code never warns.
    _decide_in_silence = np.errstate(all="ignore")(_decide)

    def _ask_members(self) -> None:
        """What members say of this tick: schedule, components, then the rows of tasks, constraints and contacts.

        Raises:
            WbcError: one of them raised, or gave what makes no sense; the message names it.
        """
        if not self._started:
            self._start()
        elif (taken := next((one for one in self.components if not self._has(one)), None)) is not None:
            raise NotSupported(
                f"{taken.name} serves another controller, made or started later; make one for each, or use copy.copy"
            )
        elif self.plans.schedule is not None:
            self._choose_contacts(self.last)
        if self.components:
            said = self._overrides()
            try:
                self.plan.applied.apply(said)
                self.plan.applied.refuse_no_inertia(self.state)
            except WbcError:
                raise
            except Exception as cause:  # what was given may raise whatever it likes when it is looked at
                raise MemberFailed(f"overrides of {', '.join(name for name, _ in said)}", cause) from cause
        if self._solved is self.plan:
            self.plan.observe()
        self._solved = None
        self.plan.fill(self.state)
        self.plan.refuse_not_finite()

    def _overrides(self) -> list[tuple[str, Overrides]]:
        said = []
        for component in self.components:
            try:
                overrides = component.before(self.state, self.last, self.plan)
                if overrides is not None and type(overrides) is not Overrides:
                    raise InvalidInput(
                        f"it returned {checks.shown(overrides)}; it must return wbc.Overrides(...) or None"
                    )
            except Exception as cause:
                raise MemberFailed(f"{component.name}.before", cause) from cause
            if overrides is not None:
                said.append((component.name, overrides))
        return said

    def _choose_contacts(self, last: Command | None) -> None:
        schedule = self.plans.schedule
        assert schedule is not None, "there is one"
        try:
            mode = self.plans.choose(schedule.contacts(self.state, last), self.state)
        except MemberFailed:  # a contact, whose name it says
            raise
        except Exception as cause:
            raise MemberFailed(f"{schedule.name}.contacts", cause) from cause
        if mode is not self.mode:
            self.use(mode)

    def _start(self) -> None:
        with suppress(plausible.ImplausibleUnit):  # where warnings are errors: a tick raises none
            plausible.joints(self.model, "q", self.state.q_joints)
            plausible.upright(self.model, "q", self.state.q)
        for component in self.components:
            component.serves = self.plans.whole.plan
            if any(component is one for one in self._kept):
                continue
            try:
                component.reset(self.state)
            except Exception as cause:
                raise MemberFailed(f"{component.name}.reset", cause) from cause
        if self.plans.schedule is not None:
            self._choose_contacts(self.last if any(self.plans.schedule is one for one in self._kept) else None)
        self.plan.start(self.state)
        if self._former is not None:
            self.plans.go_on_from(self._former)
            self.plan.intervals.remember(self._acceleration)
        self._former, self._kept, self._started = None, (), True

    @_in_turn
    def compile_waiting(self) -> int:
        """Compile plans for sets of contacts that the schedule needed and had not announced.

        To be called between ticks, when there is time: until then the plan before holds. Returns how many there were;
        ``plans.unplanned`` counts them all. ``simulate`` does it after every tick.
        """
        return self.plans.compile_waiting()

    @tells_arguments
    def explain(self, *, save: str | Path | None = None) -> str:
        """The last tick in words and units: tasks with residual and share of the cost, active rows with multipliers.

        After an infeasible tick: the rows that cannot hold together, and how far each would have to move. ``save`` is a
        file for the QP of that tick; ``wbc explain FILE`` says the same of it.

        Raises:
            InvalidInput: the file cannot be written, or there is no QP: no tick yet with this stack, a tick in an
                invalid state, or one in which a member failed.
        """
        none = "no tick yet" + " with the stack that replaced the one before" * (self.ticks > 0)
        if save is not None:
            if self.is_new or not self.has_problem:
                of = "state of the last tick is invalid" if self.status is Status.INVALID_STATE else "last tick failed"
                why = f"there is {none}" if self.is_new else f"the {of}: {self.why}"
                raise InvalidInput(f"there is no problem that could be saved: {why}")
            reproducer(self).save(save)
        return none if self.is_new else explain(self)
