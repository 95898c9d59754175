"""Guarded: any solver in a process of its own, under a time limit.

A back end that hangs in C cannot be stopped from the process it hangs in. Here it runs in the one worker of a pool: an
answer that is not there in time is none, and the pool is ended and replaced.
"""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass, field
from multiprocessing.pool import AsyncResult
from typing import Any, final

from wbc import checks
from wbc.qp.problem import QP, Shape
from wbc.qp.solver import Answer, Session, Solver
from wbc.types import Mat, Status, Vec

#: In the worker: its session, and the problem whose numbers arrive.
_HERE: dict[str, Any] = {}


@final
class GuardedSession(Session):
    """The pool of one worker. ``ended`` counts the processes that did not answer in time."""

    def __init__(self, solver: Guarded, shape: Shape) -> None:
        super().__init__(solver, shape)
        self._inner, self._seconds = solver.solver, solver.seconds
        self.ended = 0
        self._start()
        self._ready.wait(60.0)  # while building there is time; in a solve nobody waits for a process to start

    def _start(self) -> None:
        self._pool = multiprocessing.get_context("spawn").Pool(1, _open, (self._inner, self.shape))
        self._ready: AsyncResult[int] = self._pool.apply_async(len, ((),))

    def _solve(self, qp: QP) -> Answer:
        if self._ready.ready():
            try:
                return self._pool.apply_async(_answered, _numbers(qp)).get(self._seconds)
            except multiprocessing.TimeoutError:  # it hangs, or it died
                self.ended += 1
                self.close()
                self._start()
            except Exception:  # whatever the back end raises, there is no answer
                pass
        return Answer.none(self.shape, Status.FAILED)

    def close(self) -> None:
        """End the process."""
        self._pool.terminate()
        self._pool.join()

    def __del__(self) -> None:
        if hasattr(self, "_pool"):
            self._pool.terminate()


@final
@dataclass(frozen=True)
class Guarded(Solver):
    """``solver`` in a process of its own. Costs some tenths of a millisecond; opening it takes the start of a process.

    Args:
        solver: what to run there.
        seconds: time for one solve. What is not answered by then is FAILED, and so is every solve until another
            process stands ready.

    Raises:
        InvalidInput: ``seconds`` is not positive.

    Example:
        >>> from wbc.qp.solvers import Guarded, by_name
        >>> Guarded(by_name("proxqp"), seconds=2e-3).name
        'guarded proxqp'
    """

    session = GuardedSession

    solver: Solver
    seconds: float = 1e-2
    name: str = field(init=False)

    def __post_init__(self) -> None:
        checks.number("seconds", self.seconds, low=0.0, strict=True)
        same = ("requires", "tolerance", "semidefinite", "repeatable", "offline")
        self._set(name=f"guarded {self.solver.name}", **{name: getattr(self.solver, name) for name in same})


def _numbers(qp: QP) -> tuple[Mat | Vec, ...]:
    return qp.H, qp.g, qp.matrix, qp.sides


def _open(solver: Solver, shape: Shape) -> None:
    """What the worker begins with."""
    _HERE.update(session=solver.open(shape), qp=QP.empty(shape))


def _answered(*numbers: Mat | Vec) -> Answer:
    """The worker's answer to the problem of these numbers."""
    qp = _HERE["qp"]
    for part, values in zip(_numbers(qp), numbers, strict=True):
        part[:] = values
    found = _HERE["session"].solve(qp)
    return Answer(found.status, found.x, found.y, found.z, found.z_box, found.iterations)
