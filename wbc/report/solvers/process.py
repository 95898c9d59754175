"""A solver's own process, seen from outside: orders, findings, limits of time, and what became of it."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import monotonic
from typing import Any, final

from wbc.qp.solver import Solver
from wbc.report.solvers.request import encoded

#: Every BLAS and every OpenMP gets one thread, before it is loaded.
THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}
#: To import everything on a machine that is busy with something else [s].
START_LIMIT = 600.0


class Lost(Exception):
    """The process gave no finding: it was too slow and was killed, or it died. Its text says which."""


@final
class SolverProcess:
    """Starts the process when it is first asked, and again after it was lost. Use it as a context manager."""

    def __init__(self, solver: Solver, folder: Path) -> None:
        self._solver = encoded(solver)
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None
        self._rest = b""
        self._broken = ""

    def __enter__(self) -> SolverProcess:
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    def ask(self, order: dict[str, Any], limit: float) -> Iterator[dict[str, Any]]:
        """The findings of an order, each at most ``limit`` seconds after the one before.

        Raises:
            Lost: there will be no more; what came so far stands.
        """
        if self._broken:
            raise Lost(self._broken)
        if self._process is None:
            try:
                self._start()
            except Lost as loss:  # it cannot even do the smallest problem: there is no use in trying again
                self._broken = f"did not start ({loss})"
                raise Lost(self._broken) from None
        self._write(order)
        while True:
            finding = self._read(limit)
            if "done" in finding:
                return
            yield finding

    def _start(self) -> None:
        self._rest = b""
        # Its stderr is where back ends print; nobody reads it, and a full pipe would stop them.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "wbc.report.solvers.worker"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            start_new_session=True,  # an interrupt from the keyboard is for us
            env={**os.environ, **THREADS, "PYTHONPATH": os.pathsep.join(entry or os.getcwd() for entry in sys.path)},
        )  # fmt: skip
        path = [entry or os.getcwd() for entry in sys.path]
        self._write({"solver": self._solver, "folder": str(self._folder.resolve()), "path": path})
        self._read(START_LIMIT)

    def _write(self, order: dict[str, Any]) -> None:
        assert self._process is not None and self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(order).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            raise Lost(self._death()) from None

    def _read(self, limit: float) -> dict[str, Any]:
        assert self._process is not None and self._process.stdout is not None
        file, end = self._process.stdout.fileno(), monotonic() + limit
        while b"\n" not in self._rest:
            left = end - monotonic()
            if left <= 0.0 or not select.select([file], [], [], left)[0]:
                self._end()
                raise Lost(f"no answer within {limit:g} s")
            read = os.read(file, 1 << 16)
            if not read:
                raise Lost(self._death())
            self._rest += read
        line, _, self._rest = self._rest.partition(b"\n")
        finding: dict[str, Any] = json.loads(line)
        return finding

    def _death(self) -> str:
        assert self._process is not None
        code = self._process.wait()
        self._end()
        return f"crashed: {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            try:
                pipe.close()
            except OSError:  # what was still to be written has no reader
                pass
        process.wait()
