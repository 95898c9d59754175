"""Guard: a process beside a loop that holds the robot when the loop ends, hangs or dies.

The loop tells it some fifty times a second which order holds the robot where it is. When the pipe between them ends,
which a killed process does not prevent, when it is silent for longer than ``silence``, or when it is told to, the guard
sends that order at the device's rate, where the system allows it with real-time priority, so that no other work of the
computer keeps it waiting. It goes on until it is dismissed, until ``hold_for`` is over, or for good:
a robot that is held does not fall.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from select import select
from typing import Any, final

from wbc.errors import WbcError
from wbc.robots.device import BadFrame, Order, Reading
from wbc.robots.port import Port

#: How long a guard may take to begin [s].
_BEGINNING = 60.0
#: How long one that was dismissed may take to end [s].
_ENDING = 2.0


@final
class Guard:
    """A guard of ``port``, seen from the loop. It is a process of its own session: Ctrl-C does not end it.

    Raises:
        WbcError: the process does not begin.
    """

    def __init__(self, port: Port, *, silence: float, hold_for: float) -> None:
        self._connection, end = Pipe()
        with end:
            words = [sys.executable, "-m", "wbc.robots.guard", str(end.fileno())]
            environment = os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}
            self.process = subprocess.Popen(
                words, pass_fds=[end.fileno()], start_new_session=True, env=environment, stdin=subprocess.DEVNULL
            )
        self._connection.send((port, silence, hold_for))
        if not self._connection.poll(_BEGINNING):
            self.process.kill()
            raise WbcError("the guard did not begin; run with guard=False to do without")
        self._connection.recv()

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self.process.poll() is None

    def tell(self, order: Order, reading: Reading, *, now: bool = False) -> None:
        """What holds the robot from here; ``now``: hold it. A guard that does not listen makes nobody wait."""
        self._send((order, reading, now))

    def dismiss(self) -> None:
        """The robot needs no guard any more: the process ends, or is ended where it does not listen."""
        self._send(None)
        try:
            self.process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def _send(self, message: object) -> None:
        try:
            if select([], [self._connection], [], 0.0)[1]:
                self._connection.send(message)
        except OSError:  # it is gone
            pass


def watch(connection: Connection) -> None:
    """What the process does."""
    with suppress(AttributeError, OSError):  # not every system has it, and not every user may
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    port, silence, hold_for = connection.recv()
    connection.send("ready")
    period = 1.0 / port.device.rate
    told: tuple[Order, Reading, bool] | None = None
    last, since, alone = time.monotonic(), 0.0, False
    while True:
        waiting = period if told is not None else silence
        if alone:
            time.sleep(period)
        elif connection.poll(waiting):
            try:
                message = connection.recv()
            except (EOFError, ConnectionResetError):
                alone = True
            else:
                if message is None:
                    return
                told, last = message, time.monotonic()
        if told is None:
            if alone:
                return  # nothing was ever sent to the robot
            continue
        order, _, now = told
        heard = _heard(port)
        if heard is not None:
            told = order, heard, now
        if alone or now or time.monotonic() - last > silence:
            since = since or time.monotonic()
            port.send(port.device.encode(order, told[1]))
            if time.monotonic() - since > hold_for:
                return
        else:
            since = 0.0


def _heard(port: Any) -> Reading | None:
    frame = port.receive()
    try:
        reading: Reading | None = None if frame is None else port.device.unpack(frame)
        return reading
    except BadFrame:
        return None


if __name__ == "__main__":
    watch(Connection(int(sys.argv[1])))
