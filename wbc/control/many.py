"""run_many: many states through controllers, on several cores: for sweeps, tables and learning."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.control.controller import Controller
from wbc.errors import InvalidInput
from wbc.types import Status, Vec

_Part = tuple[Vec, Vec, Vec, list[Status], Any]

# Pieces of work for each worker: enough to even out what takes longer.
_SHARES = 4


@final
@dataclass(frozen=True)
class Batch:
    """Answers of N ticks: a (N, nv), v (N, nv), tau (N, nj), ``status`` and ``certified`` (N,), and ``seconds`` in all.

    What a level does not decide is NaN.
    """

    a: Vec
    v: Vec
    tau: Vec
    status: tuple[Status, ...]
    certified: Any
    seconds: float

    @property
    def ticks_per_second(self) -> float:
        """Of all workers together."""
        return len(self.status) / self.seconds


def run_many(
    plans: Controller | Sequence[Controller], states: Sequence[tuple[float, Any, Any]], *, workers: int = 1,
    alone: bool = True,
) -> Batch:  # fmt: skip
    """One tick of a controller for each state (t, q, v), on ``workers`` processes.

    ``plans``: one controller for all states, or one for each, as where stacks differ. ``alone``: the controller is
    reset before each state, so that an answer depends on its state alone: contacts are made there, and nothing is
    remembered. False: it goes on from state to state, which is about twice as fast. Then it keeps contacts where
    the first state made them, the last acceleration for limits on jerk, the memory of components, and the residual by
    which its level damps joints; which states follow one another depends on ``workers``.

    Workers are forks of this process: each has controllers of its own, and those given are left as they are.
    ``workers`` = 1 runs here, on the controllers given.

    Raises:
        InvalidInput: another number of controllers than of states, controllers of robots with other joints, ``workers``
            below 1, ``alone`` neither true nor false, states that ``tick`` refuses.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks import Posture
        >>> robot = wbc.load("arm")
        >>> controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.AccelerationLevel())
        >>> states = [(0.0, robot.q0 + 0.1 * i, np.zeros(robot.nv)) for i in range(4)]
        >>> wbc.run_many(controller, states).a.shape
        (4, 7)
    """
    workers = int(checks.number("workers", workers, low=1))
    alone = checks.truth("alone", alone)
    states = checks.moments("states", states)
    if not isinstance(plans, Controller):
        if not isinstance(plans, list | tuple) or not all(isinstance(one, Controller) for one in plans):
            raise InvalidInput(f"plans is {checks.shown(plans)}; it must be a Controller, or one for each state")
    controllers = [plans] * len(states) if isinstance(plans, Controller) else list(plans)
    if len(controllers) != len(states):
        raise InvalidInput(f"there are {len(controllers)} controllers for {len(states)} states; give one, or one each")
    if not states:
        raise InvalidInput("states is empty; give at least one (t, q, v)")
    if len({(one.model.nv, one.model.joint_names) for one in controllers}) > 1:
        raise InvalidInput("plans are of robots with other joints; run those of each robot by themselves")
    workers = min(workers, len(states))
    started = perf_counter()
    if workers == 1:
        parts = [_ticks(controllers, states, alone)]
    else:
        size = len(states) // (workers * _SHARES) + 1
        shares = [slice(i, i + size) for i in range(0, len(states), size)]
        _WORK.append([(controllers[share], states[share], alone) for share in shares])
        try:
            with multiprocessing.get_context("fork").Pool(workers) as pool:
                parts = pool.map(_share, range(len(shares)), chunksize=1)
        finally:
            _WORK.pop()
    a, v, tau, status, certified = zip(*parts, strict=True)
    statuses = tuple(one for part in status for one in part)
    seconds = perf_counter() - started
    return Batch(np.vstack(a), np.vstack(v), np.vstack(tau), statuses, np.concatenate(certified), seconds)


# What forks inherit: controllers hold memory of Pinocchio that cannot be sent.
_WORK: list[list[tuple[list[Controller], Sequence[tuple[float, Any, Any]], bool]]] = []


def _share(index: int) -> _Part:
    return _ticks(*_WORK[-1][index])


def _ticks(controllers: Sequence[Controller], states: Sequence[tuple[float, Any, Any]], alone: bool) -> _Part:
    n, model = len(states), controllers[0].model
    a, v, tau = np.empty((n, model.nv)), np.empty((n, model.nv)), np.empty((n, model.nj))
    status, certified = [], np.zeros(n, dtype=bool)
    for k, (controller, (t, q, qd)) in enumerate(zip(controllers, states, strict=True)):
        if alone:
            controller.reset()
        command = controller.tick(t, q, qd)
        a[k], v[k], tau[k] = command.a, command.v, command.tau
        status.append(command.status)
        certified[k] = command.certificate.ok
    return a, v, tau, status, certified
