"""View: the loop's side of the view in the browser. It hands on the newest state 30 times a second, and never waits."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from math import nan
from multiprocessing.connection import Connection
from time import monotonic, perf_counter_ns, sleep
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np

from wbc import checks
from wbc.control.answer import active
from wbc.control.controller import Controller
from wbc.control.ticks import about, outcome
from wbc.errors import InvalidInput, NotSupported, WbcError, warn
from wbc.live.knobs import Knobs
from wbc.report.replay import BUDGET
from wbc.report.shapes import obstacle_parts, parts, thinned
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.control.command import Command
    from wbc.models.collision import Obstacle

PERIOD = 1.0 / 30.0  # between two pictures [s]
STARTS_WITHIN = 60.0  # [s]
MOST_ROWS = 12  # of the active rows are shown
LEAST_PUSH = 0.1  # [N]: less is a mouse that trembles
BEHIND = 0.1  # a loop that is so far behind its time [s] goes on from there

#: ``push(frame, force)`` lets a force (3,) [N] act on a link during the next step.
Push = Callable[[str, Vec], None]


@final
class View:
    """The robot of a controller in the browser while it runs: what it sees and decides, and sliders for its tasks.

    Call :meth:`update` after each tick, or :meth:`tick` in place of the controller's, which times it too. The view is
    another process; 30 times a second it is handed the newest state, and what was done in the browser is taken from it
    and done between two ticks: weights, gains and targets through the public attributes of the tasks. A view that is
    slow, or that was closed, never holds the loop up.

    Args:
        port: of the address, which is ``url``; the next one that is free.
        push: what pushes the robot, ``push(frame, force)`` for the next step; without it nothing can be pushed.
        frames: links that can be pushed; by default all that are drawn.
        pausing: whether the browser may stop the loop, and let it go slower: :meth:`update` then waits. Never for a
            real robot.
        obstacles: what stands in the world.

    Raises:
        NotSupported: viser is not installed, or the view does not start.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.live import View
        >>> from wbc.tasks import JointVelocityLimits, Position
        >>> robot = wbc.load("arm")
        >>> stack = wbc.Stack([Position("tool", target=[0.4, 0.2, 0.5])], subject_to=[JointVelocityLimits()])
        >>> controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel())
        >>> q = robot.q0
        >>> with View(controller) as view:  # open view.url in a browser
        ...     for k in range(100):
        ...         q = view.tick(1e-3 * k, q, np.zeros(robot.nv)).q
    """

    def __init__(
        self,
        controller: Controller,
        *,
        port: int = 8080,
        push: Push | None = None,
        frames: Sequence[str] | None = None,
        pausing: bool = False,
        obstacles: Sequence[Obstacle] = (),
    ) -> None:
        checks.instance("controller", controller, Controller, "a wbc.Controller")
        checks.packages("a view in the browser", "viser", extra="live")
        self.controller, self.paused = controller, False
        #: What was done in the browser, in words, with the time [s].
        self.done: list[str] = []
        self._push, self._pausing, self._speed = push, checks.truth("pausing", pausing), 1.0
        planned = controller.plans.whole.plan.stack.tasks
        self._knobs = Knobs(controller.stack.tasks, planned, controller.model)
        self._acting: dict[str, tuple[Vec, float]] = {}  # by frame: a force and until when
        self._due, self._ready, self._steps, self._worst, self.clients = 0.0, False, 0, nan, 0
        self._began: tuple[float, float] | None = None  # wall time and run time from which speed counts
        self._seen: tuple[float, float] | None = None
        solid = [*thinned(parts(controller.model), BUDGET), *obstacle_parts(obstacles)]
        pushed = list(dict.fromkeys(part.link for part in solid)) if frames is None else list(frames)
        self._start(
            {
                "robot": controller.model, "meta": about(controller), "solid": solid, "obstacles": list(obstacles),
                "knobs": self._knobs.all, "frames": pushed if push else [], "pausing": pausing,
                "port": int(checks.number("port", port, low=1, high=65535)), "period": PERIOD,
            }
        )  # fmt: skip

    def _start(self, setup: dict[str, Any]) -> None:
        ours, theirs = socket.socketpair()
        self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
            [sys.executable, "-m", "wbc.live.window", str(theirs.fileno())], pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        theirs.close()
        self._line: Any = Connection(ours.detach())
        try:
            self._line.send(setup)
            answer = self._line.recv() if self._line.poll(STARTS_WITHIN) else None
            self._ready = answer is not None
        except (OSError, EOFError):
            answer = None
        if answer is None:
            self.close()
            raise NotSupported("the view in the browser does not start; python -c 'import viser' may say why")
        #: Where the browser finds it.
        self.url: str = answer[1]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def closed(self) -> bool:
        """Whether nobody can look any more: closed, or its process has ended."""
        return bool(self._line.closed)

    def close(self, why: str = "the run has ended") -> None:
        """End the view; the page says ``why``."""
        process, self._process = self._process, None
        self.paused = False
        if process is None:
            return
        try:
            if not self.closed and (self._ready or self._line.poll(4 * PERIOD)):
                self._line.send({"ended": why})
        except OSError:
            pass
        self._line.close()
        try:
            process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def wait(self) -> None:
        """Wait until a browser shows the view."""
        while not self.clients and not self.closed:
            self._listen()
            sleep(PERIOD)

    def tick(self, t: float, q: Vec, v: Vec) -> Command:
        """``controller.tick(t, q, v)``, timed, and shown."""
        start = perf_counter_ns()
        command = self.controller.tick(t, q, v)
        self.update(command, microseconds=(perf_counter_ns() - start) * 1e-3)
        return command

    def update(self, command: Command, *, microseconds: float = nan, row: dict[str, Any] | None = None) -> None:
        """After a tick: show it if a picture is due, do what was done in the browser, and act with its pushes.

        ``microseconds``: what the tick took. ``row``: the columns of a record where they are known already.
        """
        if self.closed:
            return
        if not microseconds <= self._worst:  # or it is not a number yet
            self._worst = microseconds
        now, t = monotonic(), self.controller.state.t
        if now >= self._due or self.paused:
            self._due = now + PERIOD
            self._exchange(t, command, microseconds, row)
        if self._pausing:
            self._keep_time(t)
        for frame, (force, until) in list(self._acting.items()):
            if t < until and self._push is not None:
                self._push(frame, force)
            else:
                del self._acting[frame]

    def _exchange(self, t: float, command: Command, microseconds: float, row: dict[str, Any] | None) -> None:
        self._listen()
        shown = False
        while True:
            if self._ready and not shown and not self.closed:
                shown = True
                self._show(self._row(t, command, microseconds) | {k: x for k, x in (row or {}).items() if _drawn(k)})
            if not self.paused or self._steps or self.closed:
                break
            sleep(0.01)
            self._listen()
            self._began = self._seen = None
        self._steps = max(0, self._steps - 1)

    def _row(self, t: float, command: Command, microseconds: float) -> dict[str, Any]:
        """The columns of a record that are drawn: a tenth of the work of all of them."""
        controller = self.controller
        row = outcome(t, command, microseconds) | {"q": controller.state.q, "v": controller.state.v}
        if controller.level.dynamics:
            row["tau"] = command.tau
            row |= {f"f.{name}": wrench for name, wrench in command.f.items()}
        return row | {f"error.{name}": error for name, error in controller.plan.errors().items()}

    def _show(self, row: dict[str, Any]) -> None:
        """Hand a state on: less than what the line takes at once, so that sending never waits."""
        now, t = monotonic(), float(row["t"])
        speed = nan if self._seen is None or now <= self._seen[0] else (t - self._seen[1]) / (now - self._seen[0])
        rows = [
            (one.row.owner, one.row.label, one.row.unit, one.upper, one.bound, one.multiplier)
            for one in active(self.controller)[:MOST_ROWS]
        ]
        message = {
            "row": row, "active": rows, "count": self.controller.active_count, "worst": float(self._worst),
            "pushed": list(self._acting), "speed": speed, "status": str(self.controller.status), "paused": self.paused,
        }  # fmt: skip
        self._seen, self._worst, self._ready = (now, t), nan, False
        self._send(message)

    def _keep_time(self, t: float) -> None:
        """Wait until it is time for ``t`` at the chosen speed."""
        now = monotonic()
        if self._began is None:
            self._began = now, t
        ahead = (t - self._began[1]) / self._speed - (now - self._began[0])
        if ahead > 0.0:
            sleep(ahead)
        elif ahead < -BEHIND:
            self._began = now, t

    def _listen(self) -> None:
        """Do what was done in the browser since."""
        try:
            while not self.closed and self._line.poll(0):
                self._do(*self._line.recv())
        except (OSError, EOFError):
            self._lost()

    def _do(self, what: str, *more: Any) -> None:
        match what, more:
            case "next", ():
                self._ready = True
            case "clients", (count,):
                self.clients = count
            case "pause", (paused,) if self._pausing:
                self.paused, self._began = bool(paused), None
            case "step", () if self._pausing:
                self._steps, self.paused = self._steps + 1, True
            case "speed", (speed,) if self._pausing:
                self._speed, self._began = max(float(speed), 1e-3), None
            case "push", (frame, force, seconds):
                now = self.controller.state.t if self.controller.ticks else 0.0
                until = now + float(seconds) - 0.5 * self.controller.dt  # so that rounding adds no tick
                self._acting[frame] = np.array(force, dtype=np.float64), until
                if np.linalg.norm(force) > LEAST_PUSH:
                    self._note(f"push of ({', '.join(f'{x:.3g}' for x in force)}) N at {frame!r}")
            case "set", (number, value):
                try:
                    self._note(self._knobs.set(number, value))
                except (WbcError, ValueError, TypeError) as refused:
                    self._send({"refused": str(refused)})

    def _note(self, text: str) -> None:
        """A slider that is drawn along gives one line."""
        if self.done and " = " in text and self.done[-1].startswith(text.partition(" = ")[0] + " = "):
            self.done.pop()
        t = self.controller.state.t if self.controller.ticks else 0.0
        self.done.append(f"{text} from {t:.3f} s")

    def _send(self, message: dict[str, Any]) -> None:
        try:
            self._line.send(message)
        except OSError:
            self._lost()

    def _lost(self) -> None:
        """The view's process has ended: the loop goes on without it."""
        self._line.close()
        self.paused = False
        warn("the view in the browser has ended; the loop goes on")


def _drawn(column: str) -> bool:
    """Whether a column that only the plant knows is drawn."""
    return column == "push" or column.startswith(("plant.q", "plant.v", "plant.f."))


def required(port: int) -> None:
    """Check that a view can be shown, before any long work.

    Raises:
        NotSupported: viser is not installed.
        InvalidInput: ``port`` is none.
    """
    checks.packages("a view in the browser", "viser", extra="live")
    if not 0 < port < 65536:
        raise InvalidInput(f"port is {port}; it must be from 1 to 65535")
