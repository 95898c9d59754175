"""The loop: measure, tick, deliver, step, record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from time import perf_counter_ns
from typing import Any, final

from threadpoolctl import threadpool_limits

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.control.command import Command
from wbc.control.controller import Controller
from wbc.control.metadata import with_more
from wbc.control.recorder import Recorder, Run
from wbc.control.setpoint import Setpoint
from wbc.control.ticks import Ticks, about, outcome
from wbc.errors import InvalidInput, SimulationError, WbcError, warn
from wbc.models.model import RobotModel
from wbc.sim.disturbance import Delay, Disturbance, Effect, SensorNoise, listed
from wbc.sim.joining import guests
from wbc.sim.plant import Plant
from wbc.sim.provenance import machine, versions
from wbc.types import Vec


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a simulation. ``run`` holds all ticks up to it, ``robot`` is the controller's model."""

    def __init__(self, run: Run, robot: RobotModel) -> None:
        self.run, self.robot = run, robot
        super().__init__(str(run.meta["ended"]))

    __reduce__ = WbcError.__reduce__


class MissingContact(UserWarning):
    """A plant without a contact of the stack: nothing there pushes on the robot."""


class NoAnswer(UserWarning):
    """A run in which no tick was solved: the robot moved by fallback commands alone."""


@tells_arguments
def simulate(
    controller: Controller | Setpoint,
    plant: Plant,
    *,
    duration: float,
    disturbances: Iterable[Disturbance] = (),
    recorder: bool = True,
    before_tick: Callable[[float], None] | None = None,
    progress: Callable[[float], None] | None = None,
    meta: Mapping[str, Any] | None = None,
) -> Run:
    """Let ``controller`` drive ``plant`` from its present state for ``duration`` seconds.

    The controller starts anew; the plant does not: call ``plant.reset(q, v)`` yourself. A controller decides from the
    measured state in every tick; a :class:`~wbc.Setpoint` in its place says from which (``run.meta["feedback"]``,
    "measured" or "commanded"). Ticks are timed one by one with one BLAS thread. ``before_tick(t)`` runs first in each
    tick and may assign targets and weights, or replace the stack. ``progress(done)`` is called with a number in [0, 1],
    a hundred times. With ``recorder`` False only ``t``, ``status`` and ``tick_us`` are kept. ``meta`` is added to the
    metadata that the loop knows, of which it may replace the robot's name alone.

    Of the first tick without an answer, ``run.meta["failure"]`` says when and why and ``run.failed`` is the QP. A run
    in which no tick had one is warned about (:class:`NoAnswer`).

    A plant that has not all contacts of the stack is warned about (:class:`MissingContact`).

    Observers that joined (:mod:`wbc.sim.joining`) see the run and may add disturbances.

    The run ends early when the robot has fallen, or when the plant diverges or is given a command that is not finite:
    ``run.meta["ended"]`` says which ("complete" otherwise).

    Raises:
        Interrupted: Ctrl-C; a KeyboardInterrupt whose ``run`` holds the ticks so far, "interrupted at t = ... s".
        InvalidInput: different periods or joints of controller and plant, or a duration shorter than one tick; a
            setpoint that is commanded to a plant that takes torques, which are those of the setpoint.
        UnknownFrame, NotSupported: a disturbance this plant cannot have.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointVelocityLimits, Position
        >>> from wbc.sim.plant import IntegratorPlant
        >>> from wbc.sim.simulate import simulate
        >>> robot = wbc.load("arm")
        >>> stack = wbc.Stack([Position("tool", target=[0.4, 0.2, 0.5])], subject_to=[JointVelocityLimits()])
        >>> controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel())
        >>> run = simulate(controller, IntegratorPlant(robot, level="velocity"), duration=0.1)
        >>> run.rows, run.meta["ended"]
        (100, 'complete')
    """
    driver = controller
    controller = driver.controller if isinstance(driver, Setpoint) else driver
    checks.instance("controller", controller, Controller, "a wbc.Controller or wbc.Setpoint")
    checks.instance("plant", plant, Plant, "a plant, such as wbc.sim.plant.IntegratorPlant")
    for name, called in (("before_tick", before_tick), ("progress", progress)):
        if called is not None:
            checks.function(name, called, "a function of a number")
    meta = {} if meta is None else checks.instance("meta", meta, Mapping, "a mapping of names")
    recorder = checks.truth("recorder", recorder)
    disturbances = listed(disturbances)
    check_fit(controller, plant)
    ticks = _ticks(plant, duration)
    feedback = driver.feedback if isinstance(driver, Setpoint) else "measured"
    if feedback == "commanded" and plant.takes == "torque":
        raise InvalidInput(
            f"{type(plant).__name__} takes torques, and those of a setpoint with feedback='commanded' do not depend on "
            "the robot: give it drives that follow positions, or feedback='measured'"
        )
    present = guests()
    disturbances = [*disturbances, *(disturbance for guest in present for disturbance in guest.disturbances)]
    # What becomes of a command at the motors becomes of the one that arrived, whichever of the two was listed first.
    effects = [one.begin(plant) for one in sorted(disturbances, key=lambda one: not isinstance(one, Delay))]
    watched = Ticks(controller)
    told = {**about(controller), **_about(plant, disturbances, duration), **watched.found(), "silent": {}}
    with_more({**told, "feedback": "", "ended": "", "fallen": False}, meta)  # refused before the run, not after it
    columns = _Columns(watched, plant) if recorder else _FewColumns()
    record = Recorder(ticks)
    every = max(1, ticks // 100)
    ended = "complete"
    driver.reset()
    interrupted = False
    try:
        with threadpool_limits(1):
            for k in range(ticks):
                if progress is not None and k % every == 0:
                    progress(k / ticks)
                row, problem = _tick(driver, plant, effects, before_tick, columns)
                record.append(row)
                watched.watch(row["t"])
                for guest in present:
                    guest.see(row)
                    guest.watch(k, ticks, controller)
                if problem is not None:
                    ended = problem
                    break
                controller.compile_waiting()
                if plant.fallen:
                    ended = f"fallen at t = {plant.t:.3f} s"
                    break
        if progress is not None:
            progress(1.0)
    except KeyboardInterrupt:
        if not record.rows:
            raise
        interrupted, ended = True, f"interrupted at t = {plant.t:.3f} s"
    told = {**about(controller), **_about(plant, disturbances, duration), "feedback": feedback}
    told |= {"ended": ended, "fallen": plant.fallen, **watched.found()}
    run = record.run({**told, **meta})
    run.failed = watched.failed
    if watched.failure is not None and run["status"].all():  # SOLVED is number 0
        warn(f"no tick of this run was solved. {watched.failure['why']}", NoAnswer)
    if interrupted:
        raise Interrupted(run, controller.model) from None
    return run


def _tick(
    driver: Controller | Setpoint,
    plant: Plant,
    effects: list[Effect],
    before_tick: Callable[[float], None] | None,
    columns: _FewColumns,
) -> tuple[dict[str, Any], str | None]:
    """One turn of the loop: the row to record, and why there can be no other one."""
    t = plant.t
    if before_tick is not None:
        before_tick(t)
    q, v = plant.q, plant.v
    for effect in effects:
        effect.push(t)
        q, v = effect.measure(q, v)
    start = perf_counter_ns()
    command = driver.tick(t, q, v)
    microseconds = (perf_counter_ns() - start) * 1e-3
    row = columns.row(t, q, v, command, microseconds)
    delivered: Any = command
    for effect in effects:
        delivered = effect.deliver(delivered)
    try:
        plant.step(delivered)
    except SimulationError as error:
        return row, str(error)
    columns.add_truth(row)
    return row, None


class _FewColumns:
    """What is kept when nothing is to be recorded."""

    def row(self, t: float, q: Vec, v: Vec, command: Command, microseconds: float) -> dict[str, Any]:
        del q, v
        return outcome(t, command, microseconds)

    def add_truth(self, row: dict[str, Any]) -> None:
        """Nothing of the plant is kept."""


@final
class _Columns(_FewColumns):
    """Everything: what the controller was told, decided and saw, and what the plant knows."""

    def __init__(self, ticks: Ticks, plant: Plant) -> None:
        self._ticks, self._plant = ticks, plant

    def row(self, t: float, q: Vec, v: Vec, command: Command, microseconds: float) -> dict[str, Any]:
        plant = self._plant
        row = self._ticks.row(t, q, v, command, microseconds)
        row |= {"plant.q": plant.q, "plant.v": plant.v, "push": plant.pushed}
        if plant.takes == "position":
            row["q_cmd"] = command.q
        return row

    def add_truth(self, row: dict[str, Any]) -> None:
        truth = self._plant.truth()
        if taken := row.keys() & truth.keys():
            name = f"{type(self._plant).__name__}.truth()"
            raise InvalidInput(f"{name} gives {min(taken)!r}, a column that the record has; give it another name")
        row |= truth


def _ticks(plant: Plant, duration: float) -> int:
    checks.number("duration", duration, low=0.0, strict=True)
    ticks = round(duration / plant.dt)
    if ticks < 1:
        raise InvalidInput(f"duration is {duration:g} s, shorter than one tick of {plant.dt:g} s")
    return ticks


def check_fit(controller: Controller, plant: Plant) -> None:
    """Whether what a controller decides can move a plant; :class:`MissingContact` warns where the stack's contacts are
    not there.

    Raises:
        InvalidInput: different periods or joints, or a plant that takes what the level does not decide.
    """
    if abs(controller.dt - plant.dt) > 1e-12:
        raise InvalidInput(f"the controller ticks every {controller.dt:g} s, the plant steps {plant.dt:g} s")
    if controller.model.joint_names != plant.model.joint_names or controller.model.nb != plant.model.nb:
        raise InvalidInput(f"the controller drives {controller.model.name}, the plant is {plant.model.name}")
    level = controller.level
    if plant.takes not in level.carries | {"position"}:
        raise InvalidInput(
            f"{type(plant).__name__} takes {plant.takes}s, which the {level.name} does not decide; "
            f"use IntegratorPlant(robot, level='{'velocity' if level.order == 1 else 'acceleration'}')"
        )
    if missing := plant.missing(controller.plans.whole.plan.stack.contacts):
        warn(
            f"this {type(plant).__name__} lacks contacts of the stack, {', '.join(missing)}: nothing there pushes on "
            "the robot. Write MujocoPlant(robot, contacts=stack.contacts)",
            MissingContact,
        )


def _about(plant: Plant, disturbances: list[Disturbance], duration: float) -> dict[str, Any]:
    """Metadata that the loop knows by itself, beside those of the controller."""
    return {
        "duration": duration,
        "plant": plant.settings(),
        "disturbances": [str(disturbance) for disturbance in disturbances],
        "seed": next((d.seed for d in disturbances if isinstance(d, SensorNoise)), None),
        "versions": versions(),
        "machine": machine(),
    }
