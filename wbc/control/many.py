"""run_many: many states through controllers, on several cores: for sweeps, tables and learning."""

from __future__ import annotations

import mmap
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from time import perf_counter
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.control.controller import Controller
from wbc.errors import InvalidInput, WbcError
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
    workers, model = min(workers, len(states)), controllers[0].model
    started = perf_counter()
    columns: list[Any] = [("a", float, (model.nv,)), ("v", float, (model.nv,)), ("tau", float, (model.nj,))]
    kind = np.dtype([*columns, ("status", np.int8), ("certified", np.bool_)], align=True)
    rows = np.frombuffer(mmap.mmap(-1, len(states) * kind.itemsize), kind)  # forks share it: each writes its own rows

    def tick(part: slice) -> None:
        for k in range(*part.indices(len(states))):
            if alone:
                controllers[k].reset()
            command = controllers[k].tick(*states[k])
            certified = command.status.ok or command.certificate.ok  # what is ok is certified
            rows[k] = command.a, command.v, command.tau, _CODES[command.status], certified

    if workers == 1:
        tick(slice(None))
    else:
        size = len(states) // (workers * _SHARES) + 1
        _TICKS.append(tick)
        try:
            with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("fork")) as pool:
                list(pool.map(_share, [slice(i, i + size) for i in range(0, len(states), size)]))
        except BrokenProcessPool as cause:
            raise WbcError(
                "a worker of run_many died; see its message, or the system's log if memory ran out"
            ) from cause
        finally:
            _TICKS.pop()
    a, v, tau, certified = (rows[name].copy() for name in ("a", "v", "tau", "certified"))
    status = tuple(_STATUSES[code] for code in rows["status"].tolist())
    return Batch(a, v, tau, status, certified, perf_counter() - started)


#: What forks inherit: controllers hold memory of Pinocchio that cannot be sent.
_TICKS: list[Callable[[slice], None]] = []


def _share(part: slice) -> None:
    _TICKS[-1](part)
