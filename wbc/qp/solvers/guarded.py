"""Guarded: any solver in a process of its own, under a time limit.

A back end that hangs in C cannot be stopped from the process it hangs in. Here it runs in another one: numbers go there
and back as bytes through a pipe, an answer that is not there in time is none, and the process is ended and replaced.
"""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import WbcError
from wbc.qp.problem import QP, Shape
from wbc.qp.solver import Answer, Session, Solver
from wbc.types import Status, Vec

_STATUSES = tuple(Status)


@final
@dataclass(frozen=True)
class Guarded(Solver):
    """``solver`` in a process of its own. Costs a tenth of a millisecond; opening it takes the start of a process.

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

    solver: Solver
    seconds: float = 1e-2
    name: str = field(init=False)

    def __post_init__(self) -> None:
        checks.number("seconds", self.seconds, low=0.0, strict=True)
        for attribute in ("requires", "package", "tolerance", "semidefinite", "repeatable", "offline"):
            object.__setattr__(self, attribute, getattr(self.solver, attribute))
        object.__setattr__(self, "name", f"guarded {self.solver.name}")

    def open(self, shape: Shape) -> GuardedSession:
        self.require()
        return GuardedSession(self, shape)


@final
class GuardedSession(Session):
    """The process and the pipe to it. ``ended`` counts the processes that did not answer in time."""

    def __init__(self, solver: Guarded, shape: Shape) -> None:
        super().__init__(solver, shape)
        self._inner, self._seconds = solver.solver, solver.seconds
        self._context = multiprocessing.get_context("spawn")
        self._ready = False
        self.ended = 0
        self._start()
        self._pipe.poll(60.0)  # while building there is time; in a solve nobody waits for a process to start

    def _start(self) -> None:
        self._pipe, other = self._context.Pipe()
        self._process = self._context.Process(target=_serve, args=(other, self._inner, self.shape), daemon=True)
        self._process.start()
        other.close()
        self._ready = False

    def _stands_ready(self) -> bool:
        if not self._ready and self._pipe.poll():
            self._ready = self._pipe.recv_bytes() == b"ready"
        return self._ready

    def _solve(self, qp: QP) -> Answer:
        try:
            if self._stands_ready():
                self._pipe.send_bytes(_numbers(qp).tobytes())
                if self._pipe.poll(self._seconds):
                    return self._answer(np.frombuffer(self._pipe.recv_bytes()))
            elif self._process.is_alive():
                return Answer.none(self.shape, Status.FAILED)
        except (OSError, EOFError):  # it died
            pass
        self.ended += 1
        self.close()
        self._start()
        return Answer.none(self.shape, Status.FAILED)

    def _answer(self, numbers: Vec) -> Answer:
        n, n_eq, n_in = self.shape
        x, y, z, z_box = np.split(numbers[2:].copy(), np.cumsum([n, n_eq, n_in]))
        return Answer(_STATUSES[int(numbers[0])], x, y, z, z_box, int(numbers[1]))

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self._pipe.close()

    def __del__(self) -> None:
        if getattr(self, "_process", None) is not None and self._process.is_alive():
            self.close()


def _numbers(qp: QP) -> Vec:
    return np.concatenate([part.ravel() for part in (qp.H, qp.g, qp.matrix, qp.lower, qp.upper, qp.lb, qp.ub)])


def _serve(pipe: Connection[Any, Any], solver: Solver, shape: Shape) -> None:
    """Answer one problem after the other until the pipe ends."""
    session, qp = solver.open(shape), QP.empty(shape)
    parts = (qp.H, qp.g, qp.matrix, qp.lower, qp.upper, qp.lb, qp.ub)
    ends = np.cumsum([part.size for part in parts])
    pipe.send_bytes(b"ready")
    while True:
        try:
            numbers = np.frombuffer(pipe.recv_bytes())
        except EOFError:
            return
        for part, values in zip(parts, np.split(numbers, ends[:-1]), strict=True):
            part.flat[:] = values
        try:
            found = session.solve(qp)
        except (WbcError, ValueError, ArithmeticError):
            empty = Answer.none(shape, Status.FAILED)
            status, iterations, vectors = Status.FAILED, 0, [empty.x, empty.y, empty.z, empty.z_box]
        else:
            status, iterations, vectors = found.status, found.iterations, [found.x, found.y, found.z, found.z_box]
        head = [float(_STATUSES.index(status)), float(iterations)]
        pipe.send_bytes(np.concatenate([head, *vectors]).tobytes())
