"""Timing a scenario: its loop is closed again and again, and one row of figures comes out.

What is timed in a tick: from references and state in arrays (or in poses already made) to the answer in arrays. Other
runs, with clocks on the controller's parts, say where the time goes; they do not disturb the first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from time import perf_counter_ns, sleep
from typing import Any, final

import numpy as np
import pinocchio as pin
from threadpoolctl import threadpool_limits

from wbc import __version__, checks
from wbc.control.controller import Controller
from wbc.models.pinocchio_ import PinocchioModel
from wbc.qp.problem import QP
from wbc.sim.joining import joined
from wbc.sim.scenario import Parameters, Progress, Scenario, ScenarioResult, Settings, Setup, Trial, silent, trials
from wbc.stack.plan import Plan
from wbc.types import Mat, Status, Vec

#: The first ticks find cold memory, and no active set.
WARM_UP = 100
_PARTS = ("update", "fill", "solve", "decode")
_METHODS = ("move", "fill", "solve", "decode")
_OK = np.array([status.ok for status in Status])


def bench(
    scenario: Scenario, ticks: int | None = None, repeats: int = 5, *, solver: str = "pdas",
    hierarchy: str = "weighted", pause: float = 0.0, progress: Progress = silent,
) -> dict[str, Any]:  # fmt: skip
    """Time a scenario, the first of its cases: one row of figures that ``json`` can write; see ``docs/benchmark.md``.

    ``ticks``: how many, all by default. ``repeats``: closed loops of which each tick's least time counts.
    ``hierarchy``: one of the scenario's. ``pause``: time [s] to sleep before each tick, as a robot's loop does; memory
    is then cold. ``progress`` is told now and then, outside what is timed.

    Raises:
        InvalidInput: ``ticks`` or ``repeats`` below 1, a negative pause.
        UnknownHierarchy: the scenario does not know it.
        ModelError: the extra ``robots`` is not installed.
        UnknownSolver, SolverMissing, NotSupported: a solver that cannot do it.
    """
    checks.instance("scenario", scenario, Scenario, "a Scenario, such as wbc.sim.scenario.find(name) gives")
    repeats = int(checks.number("repeats", repeats, low=1))
    pause = checks.number("pause", pause, low=0.0)
    p = scenario.complete_parameters(hierarchy=hierarchy, solver=solver)
    if ticks is not None:
        duration = checks.number("ticks", ticks, low=1) * scenario.first_setup(p).plant.dt
        p = Parameters(p, replace(p.settings, duration=duration))
    steps = iter(trials(progress, range(2 * repeats + 2)))
    with threadpool_limits(1):
        timed = [_closed(_paused(scenario.first_setup(p), pause), p, next(steps)[1]) for _ in range(repeats)]
        split = [_split(_paused(scenario.first_setup(p), pause), p, next(steps)[1]) for _ in range(repeats)]
        judged = scenario.run(p, replace(p.settings, progress=next(steps)[1]))
        bare = _bare_pinocchio(timed[-1], judged, repeats)
    progress(1.0)
    row = _row(scenario, p, timed, split, judged)
    row["variant"] += f", after {1e3 * pause:g} ms of sleep" * bool(pause)
    if bare is not None:
        over = row["total_us"]["median"] / bare
        row |= {"pinocchio_us": _rounded(bare), "total_over_pinocchio": _rounded(over)}
    return row


def _paused(setup: Setup, pause: float) -> Setup:
    """The same with some sleep before each tick."""
    before = setup.before_tick

    def rest(t: float) -> None:
        sleep(pause)
        if before is not None:
            before(t)

    return replace(setup, before_tick=rest) if pause else setup


def _closed(setup: Setup, p: Parameters, step: Progress, controller: Controller | None = None) -> Trial:
    chosen: Settings = p.settings
    return setup.run(
        duration=chosen.duration, solver=chosen.solver, progress=step, controller=controller, recorder=False
    )


def _split(setup: Setup, p: Parameters, step: Progress) -> tuple[Vec, int]:
    """The same ticks with clocks on the controller's parts: nanoseconds (ticks, parts), and how many the solver
    failed."""
    controller, nanoseconds, failures = setup.controller(p.settings.solver), list[list[int]](), 0
    controller.mode.in_one_call = False  # so that there are parts

    def look(tick: int, ticks: int, controller: Controller) -> None:
        nonlocal failures
        nanoseconds.append([clock.nanoseconds for clock in clocks])
        failures += not clocks[_PARTS.index("solve")].gave.ok

    with _clocks(controller) as clocks, joined(look):
        _closed(setup, p, step, controller)
    return np.array(nanoseconds), failures


@final
class _Clock:
    """Takes the place of a method; knows how long its last call took, and what it gave."""

    def __init__(self, method: Any) -> None:
        self._call = method
        self.nanoseconds = 0
        self.gave: Any = None

    def __call__(self, *arguments: Any) -> Any:
        start = perf_counter_ns()
        self.gave = gave = self._call(*arguments)
        self.nanoseconds = perf_counter_ns() - start
        return gave


@contextmanager
def _clocks(controller: Controller) -> Iterator[list[_Clock]]:
    """A clock on each of the parts."""
    owners = controller.state, controller.plan, controller.mode.solver, controller
    clocks = [_Clock(getattr(owner, method)) for owner, method in zip(owners, _METHODS, strict=True)]
    # Plans and controllers take no attribute that they have not: their clocks stand in the classes meanwhile.
    fill = Plan.fill
    for owner, method, clock in zip((owners[0], Plan, owners[2], Controller), _METHODS, clocks, strict=True):
        setattr(owner, method, clock)
    try:
        yield clocks
    finally:
        Plan.fill = fill  # type: ignore[method-assign]
        delattr(Controller, _METHODS[-1])


def _row(
    scenario: Scenario, p: Parameters, timed: Sequence[Trial], split: Sequence[tuple[Vec, int]],
    judged: ScenarioResult,
) -> dict[str, Any]:  # fmt: skip
    controller, runs = timed[-1].controller, [trial.run["tick_us"] for trial in timed]
    total, raw = least(runs, WARM_UP), min((least([run], WARM_UP) for run in runs), key=np.median)
    parts = least([1e-3 * nanoseconds for nanoseconds, _ in split], WARM_UP)
    found = {part: _rounded(np.median(parts[:, i])) for i, part in enumerate(_PARTS)}
    return {
        "peer": "wbc",
        "version": f"{__version__}/pin{pin.__version__}",
        "variant": f"{controller.level.name}, {p.settings.hierarchy}, {controller.solver.name}, {controller.form}",
        "workload": scenario.name,
        "ticks": len(runs[0]),
        "repeats": len(runs),
        "total_us": _statistics(total),
        "raw_us": _statistics(raw),
        "split_us": found | {"rest": _rounded(np.median(total) - sum(found.values()))},
        "qp": _sizes(controller.qp),
        "solver_failures": split[-1][1],
        "certified": float(_OK[timed[-1].run["status"].astype(int)].mean()),
        "counts": {how: getattr(controller.counts, how) for how in ("first", "repaired", "fallback")},
        "quality": dict(judged.figures),
    }


def _bare_pinocchio(trial: Trial, judged: ScenarioResult, repeats: int) -> float | None:
    """Median time [µs] of the model calls as one would write them down, on the states of the run; None for models of
    another kind."""
    robot, stack, run = trial.robot, trial.setup.stack, judged.run
    if not isinstance(robot, PinocchioModel):
        return None
    members = (*stack.tasks, *stack.contacts)
    model, data, still = robot.pinocchio, robot.pinocchio.createData(), np.zeros(robot.nv)
    names = dict.fromkeys(name for one in members if isinstance(name := getattr(one, "frame", None), str))
    frames, world = [model.getFrameId(name) for name in names], pin.LOCAL_WORLD_ALIGNED

    def velocities(q: Vec, v: Vec) -> None:
        del v
        if robot.nb:
            pin.jacobianCenterOfMass(model, data, q, False)
        else:
            pin.computeJointJacobians(model, data, q)
        for frame in frames:
            pin.updateFramePlacement(model, data, frame)
            pin.getFrameJacobian(model, data, frame, world)

    def dynamics(q: Vec, v: Vec) -> None:
        pin.crba(model, data, q, pin.Convention.WORLD)
        pin.nonLinearEffects(model, data, q, v)
        if robot.nb:
            pin.centerOfMass(model, data, q, v, still)
        else:
            pin.forwardKinematics(model, data, q, v, still)
        for frame in frames:
            pin.updateFramePlacement(model, data, frame)
            pin.getFrameJacobian(model, data, frame, world)
            pin.getFrameClassicalAcceleration(model, data, frame, world)

    ask, times = dynamics if trial.controller.level.dynamics else velocities, np.empty((repeats, run.rows))
    for again in range(repeats):
        for k, (q, v) in enumerate(zip(run["q"], run["v"], strict=True)):
            start = perf_counter_ns()
            ask(q, v)
            times[again, k] = 1e-3 * (perf_counter_ns() - start)
    return float(np.median(least(times, WARM_UP)))


def _sizes(qp: QP) -> dict[str, int]:
    bounded = np.isfinite(qp.lb) | np.isfinite(qp.ub)
    return {"nvar": qp.shape.n, "neq": qp.shape.n_eq, "nin_two_sided": qp.shape.n_in + int(bounded.sum())}


def least(runs: Sequence[Vec] | Mat, warm_up: int) -> Vec:
    """The least time of each tick over the runs, without the first ``warm_up`` ticks where there are more."""
    found = np.min(runs, axis=0)
    return np.asarray(found[warm_up:] if len(found) > warm_up else found)


def _rounded(value: Any) -> float:
    return round(float(value), 2)


def _statistics(microseconds: Vec) -> dict[str, float]:
    return {
        "median": _rounded(np.median(microseconds)),
        "mean": _rounded(microseconds.mean()),
        "p99": _rounded(np.percentile(microseconds, 99)),
        "max": _rounded(microseconds.max()),
    }
