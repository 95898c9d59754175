"""run_many: many states through controllers, on several cores: for sweeps, tables and learning."""

from __future__ import annotations

import math
import mmap
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple, final

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.control.controller import Controller
from wbc.errors import InvalidInput, WbcError
from wbc.models.model import RobotModel
from wbc.types import Status, Vec

_STATUSES = tuple(Status)
_CODES = {status: code for code, status in enumerate(_STATUSES)}

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


@tells_arguments
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
        WbcError: a worker died, as where memory runs out.

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
    if len({(one.model.nv, one.model.joint_names) for one in controllers}) > 1:
        raise InvalidInput("plans are of robots with other joints; run those of each robot by themselves")
    workers = min(workers, len(states))
    started = perf_counter()
    work = _Work(controllers, states, alone, _Columns.of(controllers[0].model, len(states)))
    if workers == 1:
        _tick(work, slice(None))
    else:
        size = len(states) // (workers * _SHARES) + 1
        _WORK.append(work)
        try:
            with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("fork")) as pool:
                list(pool.map(_share, [slice(i, i + size) for i in range(0, len(states), size)]))
        except BrokenProcessPool as cause:
            raise WbcError(
                "a worker of run_many died; see its message, or the system's log if memory ran out"
            ) from cause
        finally:
            _WORK.pop()
    a, v, tau, codes, certified = work.columns
    status = tuple(_STATUSES[code] for code in codes.tolist())
    return Batch(a, v, tau, status, certified, perf_counter() - started)


@final
class _Columns(NamedTuple):
    """Answers of all states, in memory that forks share: each worker writes its own rows."""

    a: Vec
    v: Vec
    tau: Vec
    status: Any
    certified: Any

    @classmethod
    def of(cls, model: RobotModel, n: int) -> _Columns:
        def shared(kind: type, *shape: int) -> Any:
            dtype = np.dtype(kind)
            memory = mmap.mmap(-1, max(1, math.prod(shape) * dtype.itemsize))
            return np.frombuffer(memory, dtype, math.prod(shape)).reshape(shape)

        nv, nj = model.nv, model.nj
        motion = shared(float, n, nv), shared(float, n, nv), shared(float, n, nj)
        return cls(*motion, shared(np.int8, n), shared(np.bool_, n))


@final
class _Work(NamedTuple):
    """What forks inherit: controllers hold memory of Pinocchio that cannot be sent."""

    controllers: Sequence[Controller]
    states: Sequence[tuple[float, Any, Any]]
    alone: bool
    columns: _Columns


_WORK: list[_Work] = []


def _share(part: slice) -> None:
    _tick(_WORK[-1], part)


def _tick(work: _Work, part: slice) -> None:
    a, v, tau, status, certified = work.columns
    for k in range(*part.indices(len(work.states))):
        controller = work.controllers[k]
        if work.alone:
            controller.reset()
        command = controller.tick(*work.states[k])
        a[k], v[k], tau[k] = command.a, command.v, command.tau
        status[k] = _CODES[command.status]
        certified[k] = command.status.ok or command.certificate.ok  # what is ok is certified
