"""The process in which one solver works: orders come in as lines of json, findings go out as lines of json.

A solver that hangs or crashes takes only this process with it, and no other solver's memory lies in its heap. Run as
``python -m wbc.report.solvers.worker`` by :mod:`wbc.report.solvers.process`.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO, final

from wbc.qp.problem import QP
from wbc.qp.solver import Solver
from wbc.report.solvers.problems import ProblemSet
from wbc.report.solvers.request import received


@final
class Worker:
    """One solver, and the problem sets it has read so far."""

    def __init__(self, solver: Solver, folder: Path) -> None:
        self._solver, self._folder = solver, folder
        self._sets: dict[str, ProblemSet] = {}

    def answers(self, order: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """Do what an order says: one finding each for "loop" and "torture", one a problem for "solve"."""
        tolerance = order["tolerance"]
        solver = self._solver if tolerance is None else self._solver.at(tolerance)
        match order["do"]:
            case "solve":
                from wbc.report.solvers.measure import solved

                yield from solved(solver, self._problems(order["file"]).qps, order["items"], warm=order["warm"])
            case "torture":
                from wbc.report.solvers.torture import tortured

                yield tortured(solver, order["case"], guarded=order["guarded"])
            case "loop":
                from wbc.report.solvers.loop import closed_loop

                yield closed_loop(order["scenario"], order["parameters"], order["settings"], solver)

    def warm_up(self) -> None:
        """Import what the solver needs, so that no problem pays for it."""
        self._solver.solve(QP([[1.0, 0.0], [0.0, 1.0]], [-1.0, -2.0], C=[[1.0, 1.0]], cu=[1.0]))

    def _problems(self, file: str) -> ProblemSet:
        if file not in self._sets:
            self._sets = {file: ProblemSet.load(self._folder / file)}  # one at a time: they may be large
        return self._sets[file]


def main() -> None:
    """Serve until the orders end. The first line says who works, where, and what can be imported."""
    _die_with_parent()
    out = _private_stdout()
    first = json.loads(sys.stdin.readline())
    sys.path[:] = first["path"]
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        worker = Worker(received(first["solver"]), Path(first["folder"]))
        worker.warm_up()
        _say(out, {"ready": True})
        gc.disable()
        for line in sys.stdin:
            for finding in worker.answers(json.loads(line)):
                _say(out, finding)
            _say(out, {"done": True})
            gc.collect()


def _die_with_parent() -> None:
    """A solver that hangs never reads that its orders have ended."""
    if sys.platform == "linux":
        kill_me_when_my_parent_dies = 1  # PR_SET_PDEATHSIG
        ctypes.CDLL(None).prctl(kill_me_when_my_parent_dies, int(signal.SIGKILL))


def _private_stdout() -> TextIO:
    """The channel to the parent; what a back end prints goes to stderr instead."""
    channel = os.dup(1)
    os.dup2(2, 1)
    return os.fdopen(channel, "w", encoding="utf-8")


def _say(out: TextIO, finding: dict[str, Any]) -> None:
    out.write(json.dumps(finding) + "\n")
    out.flush()


if __name__ == "__main__":
    main()
