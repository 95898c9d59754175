"""Levels: the same states through every hierarchy there is, and through weights that imitate priorities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from sys import stderr
from time import perf_counter
from typing import Any, NamedTuple, final

import numpy as np

from wbc.control.controller import Controller
from wbc.errors import InvalidInput, WbcError
from wbc.qp.solver import Solver
from wbc.report.solvers.measure import plain
from wbc.sim.joining import joined
from wbc.sim.scenario import find, silent
from wbc.stack.hierarchy import Hierarchy, Weighted
from wbc.stack.stack import Stack
from wbc.types import Vec

#: Stretches of consecutive ticks that are kept of a run, and their length.
STRETCHES, LENGTH = 4, 25
#: What the weights of the first level are multiplied by.
FACTORS = (1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e8)


class _Moment(NamedTuple):
    """A state that a controller was asked about."""

    t: float
    q: Vec
    v: Vec


@final
class _States:
    """Keeps states of the first simulation it joins, and the controller that met them."""

    def __init__(self) -> None:
        self.controller: Controller | None = None
        self.stretches: list[list[_Moment]] = []
        self._next = -1

    def __call__(self, tick: int, ticks: int, controller: Controller) -> None:
        self.controller = self.controller or controller
        if controller is not self.controller:
            return
        starts = [round(i * max(ticks - LENGTH, 0) / (STRETCHES - 1)) for i in range(STRETCHES)]
        if not any(start <= tick < start + LENGTH for start in starts):
            return
        if tick != self._next:
            self.stretches.append([])
        self._next = tick + 1
        state = controller.state
        self.stretches[-1].append(_Moment(state.t, state.q.copy(), state.v.copy()))


def hierarchies() -> list[Hierarchy]:
    """One of each kind of this library, with its default settings."""
    return [kind() for kind in Hierarchy.__subclasses__() if kind.__module__.startswith("wbc.stack.")]


def levels(scenario: str, parameters: Mapping[str, Any], settings: Mapping[str, Any], solver: Solver) -> dict[str, Any]:
    """Record states of a scenario and put them to controllers that differ in their hierarchy, or in their weights.

    A stack of one level is taken as two: its first task, then the others.

    Raises:
        InvalidInput: the scenario never calls :func:`~wbc.sim.simulate.simulate`.
    """
    states, chosen = _States(), solver
    with joined(states), redirect_stdout(stderr):
        run: Any = find(scenario).run
        run(parameters, solver=chosen, progress=silent, **settings)
    if states.controller is None:
        raise InvalidInput(f"{scenario} ran no controller by wbc.sim.simulate.simulate")
    stack, note = _layered(states.controller.stack)
    found = [_measured(states, stack, hierarchy, solver) for hierarchy in hierarchies()]
    several = len(stack.levels) > 1
    return {
        "first": [task.name for task in stack.levels[0]],
        "others": [task.name for level in stack.levels[1:] for task in level],
        "note": note,
        "ticks": sum(map(len, states.stretches)),
        "hierarchies": found,
        "weights": list(_weighted(states, stack, solver)) if several else [],
    }


def _layered(stack: Stack) -> tuple[Stack, str]:
    if len(stack.levels) > 1 or len(stack.tasks) == 1:
        return stack, ""
    first, *others = stack.tasks
    layered = Stack(
        [[first], others], subject_to=stack.subject_to, contacts=stack.contacts, components=stack.components
    )
    return layered, "The stack has one level; here its first task stands above the others."


def _weighted(states: _States, stack: Stack, solver: Solver) -> Iterator[dict[str, Any]]:
    """The weighted hierarchy with the first level's weights multiplied; afterwards they are as they were."""
    tasks: Sequence[Any] = stack.levels[0]
    own = [task.weight for task in tasks]
    try:
        for factor in FACTORS:
            for task, weight in zip(tasks, own, strict=True):
                task.weight = factor * np.asarray(weight) if np.ndim(weight) else factor * weight
            yield {"factor": factor, **_measured(states, stack, Weighted(), solver)}
    finally:
        for task, weight in zip(tasks, own, strict=True):
            task.weight = weight


def _measured(states: _States, stack: Stack, hierarchy: Hierarchy, solver: Solver) -> dict[str, Any]:
    """All states through one controller: residuals, condition number, time."""
    old = states.controller
    assert old is not None
    name = str(hierarchy)
    try:
        controller = Controller(old.model, stack, level=old.level, hierarchy=hierarchy, solver=solver, dt=old.dt)
    except WbcError as refusal:
        return {"name": name, "error": str(refusal)}
    first, others, seconds, conditions = [], [], [], []
    for stretch in states.stretches:
        controller.reset()
        for moment in stretch:
            start = perf_counter()
            command = controller.tick(*moment)
            seconds.append(perf_counter() - start)
            if not command.status.ok:
                continue
            sizes = _residuals(controller)
            first.append(sizes[0])
            others.append(float(np.hypot.reduce(sizes[1:])) if len(sizes) > 1 else 0.0)
        if controller.status.ok:
            conditions.append(float(np.linalg.cond(controller.qp.H)))
    return {
        "name": name,
        "error": None,
        "solved": len(first),
        "first": [_middle(first), plain(max(first))] if first else [None, None],
        "others": _middle(others),
        "condition": _middle(conditions),
        "tick_us": _middle([1e6 * s for s in seconds]),
    }


def _residuals(controller: Controller) -> list[float]:
    """‖wanted − got‖ of each level of the last tick, all its rows together, in the units of the rows."""
    p = controller.plan.problem
    rows = p.G @ p.x1
    sizes = []
    for level in p.levels:
        parts = [
            rows[task.rows] if task.rows is not None else p.x[task.unknowns] - task.wanted for task in level
        ]  # fmt: skip
        sizes.append(float(np.linalg.norm(np.concatenate(parts))) if parts else 0.0)
    return sizes


def _middle(values: Sequence[float]) -> float | None:
    return plain(float(np.median(values))) if len(values) else None
