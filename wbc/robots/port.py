"""Port: what a loop talks to. Frames go out and come in; time passes as the port's own clock says."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Protocol, final, runtime_checkable

from wbc.arguments import TellsArguments
from wbc.errors import WbcError
from wbc.robots.device import Device

if TYPE_CHECKING:
    from wbc.robots.motor_board import MotorBoard

#: No frame of a robot is larger [bytes].
_LARGEST = 65_000


class DeviceSilent(WbcError):
    """A robot that sends no state, or no longer does."""


@runtime_checkable
class Port(Protocol):
    """A connection to one robot. ``shared``: a copy of it, pickled, reaches the same robot from another process."""

    shared: bool

    @property
    def device(self) -> Device:
        """Whose frames these are."""

    def receive(self) -> Any | None:
        """The newest frame that has not been received yet, or None."""

    def send(self, frame: Any) -> None:
        """Send a frame; it may be lost."""

    def clock(self) -> float:
        """Time [s], which never goes back."""

    def sleep(self, seconds: float) -> None:
        """Wait for about so long."""


@final
class Udp(metaclass=TellsArguments):
    """Frames that are bytes, as datagrams: to a :func:`serve` in another process, on this machine or beside it.

    No robot uses this; it is for dry runs in which scripts are killed. Raises OSError as sockets do.
    """

    shared = True

    def __init__(self, device: Device, address: tuple[str, int]) -> None:
        self.device, self.address = device, address
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.send(b"")  # from now on the server knows where states are wanted

    def __reduce__(self) -> tuple[Any, ...]:
        return Udp, (self.device, self.address)

    def receive(self) -> bytes | None:
        """The newest frame, or None."""
        return newest(self._socket)

    def send(self, frame: bytes) -> None:
        """Send a frame."""
        self._socket.sendto(frame, self.address)

    clock = staticmethod(time.monotonic)
    sleep = staticmethod(time.sleep)


def serve(board: MotorBoard, server: socket.socket, stopped: Callable[[], bool]) -> None:
    """Let ``board`` run in real time until it is ``stopped``, behind a UDP socket; who wrote to it is sent the states.

    It never hurries to make up for what the machine was late: its time stands still meanwhile.
    """
    server.setblocking(False)
    listeners: list[Any] = []
    due = time.monotonic()
    while not stopped():
        for frame, sender in _datagrams(server):
            if sender not in listeners:
                listeners.append(sender)
            if frame:
                board.send(frame)
        board.sleep(board.plant.dt)
        if (state := board.receive()) is not None:
            for listener in listeners:
                server.sendto(state, listener)
        due += board.plant.dt
        if (now := time.monotonic()) < due:
            time.sleep(due - now)
        else:
            due = now


def newest(end: socket.socket) -> bytes | None:
    """The last datagram that came, or None; those before it are dropped."""
    last = None
    for frame, _ in _datagrams(end):
        last = frame
    return last


def _datagrams(end: socket.socket) -> Iterator[tuple[bytes, Any]]:
    while True:
        try:
            yield end.recvfrom(_LARGEST)
        except (BlockingIOError, ConnectionRefusedError):
            return
