"""Trial: one simulated run of a scenario. How it is set up, how a list of them is run, what is told meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput

if TYPE_CHECKING:
    from wbc.control.controller import Controller
    from wbc.control.recorder import Run
    from wbc.models.model import RobotModel
    from wbc.sim.disturbance import Disturbance
    from wbc.sim.plant import Plant
    from wbc.stack.formulation import Formulation
    from wbc.stack.hierarchy import Hierarchy
    from wbc.stack.stack import Stack
    from wbc.types import Vec

T = TypeVar("T")


class Progress(Protocol):
    """Called now and then by long work: ``done`` in [0, 1], ``text`` what is being done."""

    def __call__(self, done: float, text: str = "") -> None: ...


def silent(done: float, text: str = "") -> None:
    """A :class:`Progress` that says nothing."""


def trials(progress: Progress, items: Iterable[T]) -> Iterator[tuple[T, Progress]]:
    """Each of several trials with a progress of its own, which is a part of the whole: "7 of 16".

    Example:
        >>> from wbc.sim.scenario import trials
        >>> for name, one in trials(lambda done, text="": print(done, text), ["a", "b"]):
        ...     one(0.5, name)
        0.0 1 of 2
        0.25 1 of 2, a
        0.5 2 of 2
        0.75 2 of 2, b
    """
    whole = list(items)
    for i, item in enumerate(whole):

        def one(done: float, text: str = "", i: int = i) -> None:
            progress((i + done) / len(whole), f"{i + 1} of {len(whole)}{text and f', {text}'}")

        one(0.0)
        yield item, one


@final
@dataclass(frozen=True)
class Settings:
    """How a scenario is run: one of its ``plants`` and ``hierarchies``, for how long [s], by which QP solver."""

    plant: str
    hierarchy: str
    duration: float
    solver: str = "pdas"
    progress: Progress = silent


@final
class Parameters(dict[str, Any]):
    """The parameters of a scenario by name, all of them; ``settings`` says on which plant and for how long it runs.

    Example:
        >>> from wbc.sim.scenario import Parameters, Settings
        >>> p = Parameters({"mass": 2.0}, Settings("mujoco", "weighted", 4.0))
        >>> p["mass"], p.number("mass", low=0.0), p.settings.plant
        (2.0, 2.0, 'mujoco')
    """

    def __init__(self, values: Mapping[str, Any], settings: Settings) -> None:
        super().__init__(values)
        self.settings = settings

    def number(self, name: str, **bounds: Any) -> float:
        """A parameter that must be a number within ``bounds``, those of :func:`wbc.checks.number`.

        Raises:
            InvalidInput: it is not, by the parameter's name.
        """
        return checks.number(f"parameter {name!r}", self[name], **bounds)

    def count(self, name: str) -> int:
        """A parameter that must be at least 1, as a whole number."""
        return int(self.number(name, low=1))

    def lasts_beyond(self, end: float, why: str) -> None:
        """Check that the run is longer than ``end`` [s]; ``why``, in a few words, for the message.

        Raises:
            InvalidInput: it is not.
        """
        duration = self.settings.duration
        if duration <= end:
            raise InvalidInput(f"duration is {duration:g} s; it must be more than {end:g} s: {why}")


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Setup(metaclass=TellsArguments):
    """Everything that one run is made of: a stack at a level on a robot, a plant at its start, and what disturbs it.

    Args:
        stack: what the controller is to do, by ``level`` (inverse dynamics by default) and ``hierarchy`` (weighted).
        plant: what the commands act on, in the state from which the run starts. It also gives the period.
        robot: as the controller knows it; the plant's own by default.
        feedback: "measured" or "commanded" wraps the controller in a :class:`wbc.Setpoint`.
        disturbances: what happens to the robot.
        before_tick: called with the time before each tick, as by :func:`~wbc.sim.simulate.simulate`.
        duration: where it is not the requested one [s].
        meta: further metadata of the run.
        about: whatever ``judge`` has to know beside the run.
    """

    stack: Stack
    plant: Plant
    level: Formulation | None = None
    hierarchy: Hierarchy | None = None
    robot: RobotModel | None = None
    feedback: str = ""
    disturbances: Sequence[Disturbance] = ()
    before_tick: Callable[[float], None] | None = None
    duration: float | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    about: Any = None

    def controller(self, solver: str = "pdas") -> Controller:
        """A new controller for it."""
        from wbc.control.controller import Controller
        from wbc.stack.formulation import InverseDynamics
        from wbc.stack.hierarchy import Weighted

        return Controller(
            self.robot or self.plant.model, self.stack, level=self.level or InverseDynamics(),
            hierarchy=self.hierarchy or Weighted(), solver=solver, dt=self.plant.dt,
        )  # fmt: skip

    def run(
        self, name: str = "", *, duration: float, solver: str = "pdas", progress: Progress = silent,
        meta: Mapping[str, Any] | None = None, controller: Controller | None = None, recorder: bool = True,
    ) -> Trial:  # fmt: skip
        """Simulate it for its own ``duration``, or else this one [s]. It can be run once: the plant moves.

        ``controller``: one of :meth:`controller` that is there already. ``recorder`` False: only times are kept.

        Raises:
            WbcError: what :func:`~wbc.sim.simulate.simulate` raises.
        """
        from wbc.control.setpoint import Setpoint
        from wbc.sim.simulate import simulate

        controller = self.controller(solver) if controller is None else controller
        run = simulate(
            Setpoint(controller, feedback=self.feedback) if self.feedback else controller, self.plant,
            duration=duration if self.duration is None else self.duration, disturbances=self.disturbances,
            before_tick=self.before_tick, progress=progress, meta={**(meta or {}), **self.meta}, recorder=recorder,
        )  # fmt: skip
        return Trial(name, self, controller, run)


@final
@dataclass(frozen=True, eq=False)
class Trial:
    """One run of a scenario: the ``name`` of its case, how it was set up, what was recorded."""

    name: str
    setup: Setup
    controller: Controller
    run: Run

    @property
    def robot(self) -> Any:
        """The robot of the plant."""
        return self.setup.plant.model

    @property
    def about(self) -> Any:
        """What ``build`` wanted ``judge`` to know."""
        return self.setup.about

    def error(self, task: str) -> Vec:
        """Length (N,) of the error of the first task whose name begins so, in the task's unit.

        Raises:
            UnknownColumn: no task's name begins so.
        """
        column = f"error.{task}"
        name = next((name for name in self.run.columns if name.startswith(column)), column)
        return np.asarray(np.linalg.norm(self.run[name], axis=1))
