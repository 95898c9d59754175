"""Running and timing a workload, and the row of figures that comes out.

What is timed in a tick: from references and state in arrays (or in poses already made) to the answer in arrays. A
second run over the same states, with clocks on the controller's parts, says where the time goes; it does not disturb
the first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter_ns as now
from time import sleep
from typing import Any, final

import numpy as np
import pinocchio as pin
from threadpoolctl import threadpool_limits

import wbc
from wbc import checks
from wbc.control.controller import Controller
from wbc.errors import InvalidInput
from wbc.qp.problem import QP
from wbc.stack.hierarchy import Hierarchy, Scaled, Strict, Weighted
from wbc.stack.plan import Plan
from wbc.types import Vec

from .robots import MadeRobot
from .workload import ClosedLoop, Problem, Progress, Record

HIERARCHIES: Mapping[str, Hierarchy] = {"weighted": Weighted(), "strict": Strict(), "scaled": Scaled()}
WARM_UP = 100
_REPORT_EVERY = 250
_PARTS = ("update", "fill", "solve", "decode")
_SOLVE = _PARTS.index("solve")


class Workload(ClosedLoop):
    """A benchmark by name. Calling it runs it and gives one row of figures; see ``docs/benchmark.md``."""

    @final
    def __call__(
        self, ticks: int | None = None, repeats: int = 5, progress: Progress | None = None, *, solver: str = "pdas",
        hierarchy: str = "weighted", pause: float = 0.0,
    ) -> dict[str, Any]:  # fmt: skip
        """Run the workload and measure it.

        ``ticks``: how many, all by default. ``repeats``: closed loops of which each tick's least time counts.
        ``progress(done, total)`` is called now and then, outside what is timed. ``hierarchy``: "weighted", "strict" or
        "scaled". ``pause``: time [s] to sleep before each tick, as a robot's loop does; memory is then cold.

        Raises:
            InvalidInput: ``ticks`` or ``repeats`` below 1, a negative pause, no such hierarchy.
            ModelError: the extra ``robots`` is not installed.
            UnknownSolver, SolverMissing, NotSupported: a solver that cannot do it.
        """
        ticks = int(checks.number("ticks", self.ticks if ticks is None else ticks, low=1))
        repeats = int(checks.number("repeats", repeats, low=1))
        if hierarchy not in HIERARCHIES:
            raise InvalidInput(f"hierarchy is {hierarchy!r}; it must be one of {', '.join(HIERARCHIES)}")
        pause = checks.number("pause", pause, low=0.0)
        return measure(self, ticks, repeats, progress, solver=solver, hierarchy=hierarchy, pause=pause)

    def __repr__(self) -> str:
        return f"{self.name} {self.title}"


def measure(
    workload: Workload,
    ticks: int,
    repeats: int,
    progress: Progress | None,
    *,
    solver: str,
    hierarchy: str,
    pause: float,
) -> dict[str, Any]:
    """The row of one workload: time, where it goes, what came out of it."""
    steps = _Steps(progress, 3 * repeats * ticks)
    with workload.recipe.made() as made, threadpool_limits(1):
        setting = _Setting(workload, made, workload.problem(made, ticks), ticks, solver, HIERARCHIES[hierarchy], pause)
        timed = []
        for _ in range(repeats):
            controller = setting.controller()
            timed.append(_closed_loop(setting, controller, steps))
        record = timed[-1]
        splits = [_split_loop(setting, record, steps) for _ in range(repeats)]
        bare = [_bare_pinocchio(setting, record, steps) for _ in range(repeats)]

    total = _microseconds([run.nanoseconds for run in timed])
    raw = min((_microseconds([run.nanoseconds]) for run in timed), key=np.median)
    split = {part: _median(_microseconds([run[:, i] for run, _ in splits])) for i, part in enumerate(_PARTS)}
    pinocchio_us = _median(_microseconds(bare))
    return {
        "peer": "wbc",
        "version": f"{wbc.__version__}/pin{pin.__version__}",
        "variant": f"{workload.level.name}, {hierarchy}, {controller.solver.name}, {controller.form}"
        + (f", after {1e3 * pause:g} ms of sleep" if pause else ""),
        "workload": workload.name,
        "ticks": ticks,
        "repeats": repeats,
        "total_us": _statistics(total),
        "raw_us": _statistics(raw),
        "split_us": split | {"rest": round(_median(total) - sum(split.values()), 2)},
        "pinocchio_us": pinocchio_us,
        "total_over_pinocchio": round(_median(total) / pinocchio_us, 2),
        "qp": _sizes(controller.qp),
        "solver_failures": splits[-1][1],
        "certified": float(record.solved.mean()),
        "counts": {
            "first": controller.counts.first,
            "repaired": controller.counts.repaired,
            "fallback": controller.counts.fallback,
        },
        "quality": setting.problem.judge(record),
    }


@final
@dataclass(frozen=True)
class _Setting:
    """Everything a run is made of but its memory."""

    workload: Workload
    made: MadeRobot
    problem: Problem
    ticks: int
    solver: str
    hierarchy: Hierarchy
    pause: float

    def controller(self) -> Controller:
        workload = self.workload
        stack = self.problem.stack
        return Controller(
            self.made.robot, stack, level=workload.level, hierarchy=self.hierarchy, solver=self.solver, dt=workload.dt
        )


def _closed_loop(setting: _Setting, controller: Controller, steps: _Steps) -> Record:
    contacts, ticks = setting.problem.stack.contacts, setting.ticks
    record = Record.empty(setting.made, ticks, len(contacts), max((c.dim for c in contacts), default=0))
    tick, dt, order, dynamics = controller.tick, controller.dt, controller.level.order, controller.level.dynamics
    for k in range(ticks):
        t, q, v = k * dt, record.q[k], record.v[k]
        if setting.pause:
            sleep(setting.pause)
        if order == 1:
            start = now()
            command = tick(t, q, v)
            answer = command.v
            end = now()
        else:
            start = now()
            command = tick(t, q, v)
            answer, torque = command.a, command.tau
            end = now()
            record.a[k] = answer
            record.tau[k] = torque
        record.nanoseconds[k] = end - start
        record.solved[k] = command.status.ok
        record.q[k + 1], record.v[k + 1] = command.q, command.v
        if dynamics:
            for i, contact in enumerate(contacts):
                record.forces[k, i] = command.f[contact.name]
        steps.done()
    return record


def _split_loop(setting: _Setting, record: Record, steps: _Steps) -> tuple[Any, int]:
    """Ticks on the same states with clocks on the controller's parts: nanoseconds (ticks, parts), and how many the
    solver failed."""
    controller = setting.controller()
    controller.mode.in_one_call = False  # so that there are parts
    owners = controller.state, controller.plan, controller.mode.solver, controller
    clocks = [_Clock(getattr(owner, part)) for owner, part in zip(owners, _PARTS, strict=True)]
    nanoseconds, failures = np.zeros((record.ticks, len(_PARTS)), np.int64), 0
    # Plans and controllers take no attribute that they have not: their clocks stand in the classes meanwhile.
    fill = Plan.fill
    for owner, part, clock in zip((owners[0], Plan, owners[2], Controller), _PARTS, clocks, strict=True):
        setattr(owner, part, clock)
    try:
        for k in range(record.ticks):
            if setting.pause:
                sleep(setting.pause)
            command = controller.tick(k * controller.dt, record.q[k], record.v[k])
            nanoseconds[k] = [clock.nanoseconds for clock in clocks]
            failures += not clocks[_SOLVE].gave.ok
            # What the timed loop does between its ticks: without it, memory would be warmer here than there.
            _ = command.q, command.f
            steps.done()
    finally:
        Plan.fill = fill  # type: ignore[method-assign]
        delattr(Controller, _PARTS[-1])
    return nanoseconds, failures


@final
class _Clock:
    """Takes the place of a method; knows how long its last call took, and what it gave."""

    def __init__(self, method: Any) -> None:
        self._call = method
        self.nanoseconds = 0
        self.gave: Any = None

    def __call__(self, *arguments: Any) -> Any:
        start = now()
        self.gave = gave = self._call(*arguments)
        self.nanoseconds = now() - start
        return gave


def _bare_pinocchio(setting: _Setting, record: Record, steps: _Steps) -> Any:
    """The model calls as one would write them down, on the states of the run: nanoseconds (ticks,)."""
    model, floating = setting.made.reference, setting.made.robot.nb > 0
    data, still = model.createData(), np.zeros(model.nv)
    frames = [model.getFrameId(frame) for frame in setting.problem.frames]
    world = pin.LOCAL_WORLD_ALIGNED

    def velocities(q: Vec, v: Vec) -> None:
        del v
        if floating:
            pin.jacobianCenterOfMass(model, data, q, False)
        else:
            pin.computeJointJacobians(model, data, q)
        for frame in frames:
            pin.updateFramePlacement(model, data, frame)
            pin.getFrameJacobian(model, data, frame, world)

    def dynamics(q: Vec, v: Vec) -> None:
        pin.crba(model, data, q, pin.Convention.WORLD)
        pin.nonLinearEffects(model, data, q, v)
        if floating:
            pin.centerOfMass(model, data, q, v, still)
        else:
            pin.forwardKinematics(model, data, q, v, still)
        for frame in frames:
            pin.updateFramePlacement(model, data, frame)
            pin.getFrameJacobian(model, data, frame, world)
            pin.getFrameClassicalAcceleration(model, data, frame, world)

    ask = dynamics if setting.workload.level.dynamics else velocities
    nanoseconds = np.zeros(record.ticks, np.int64)
    for k in range(record.ticks):
        q, v = record.q[k], record.v[k]
        start = now()
        ask(q, v)
        nanoseconds[k] = now() - start
        steps.done()
    return nanoseconds


def _sizes(qp: QP) -> dict[str, int]:
    bounded = np.isfinite(qp.lb) | np.isfinite(qp.ub)
    return {"nvar": qp.shape.n, "neq": qp.shape.n_eq, "nin_two_sided": qp.shape.n_in + int(bounded.sum())}


def _microseconds(runs: Sequence[Any]) -> Vec:
    """The least time of each tick over the runs, without the first ticks, which find cold memory."""
    least = np.min(np.stack(runs), axis=0) / 1e3
    return np.asarray(least[WARM_UP:] if len(least) > WARM_UP else least)


def _median(microseconds: Vec) -> float:
    return round(float(np.median(microseconds)), 2)


def _statistics(microseconds: Vec) -> dict[str, float]:
    return {
        "median": _median(microseconds),
        "mean": round(float(microseconds.mean()), 2),
        "p99": round(float(np.percentile(microseconds, 99)), 2),
        "max": round(float(microseconds.max()), 2),
    }


@final
class _Steps:
    """Counts ticks, and tells about it now and then."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress, self._total, self._count = progress, total, 0

    def done(self) -> None:
        self._count += 1
        if self._progress is not None and (self._count % _REPORT_EVERY == 0 or self._count == self._total):
            self._progress(self._count, self._total)
