"""Beside: a view of every simulation that starts inside a block, whoever wrote its loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, final

import numpy as np

from wbc.errors import NotSupported, UnknownName
from wbc.live.view import View
from wbc.sim.disturbance import Disturbance, Effect
from wbc.sim.joining import joined

if TYPE_CHECKING:
    from wbc.control.controller import Controller
    from wbc.sim.plant import Plant


@contextmanager
def beside(port: int, told: Callable[[str], None]) -> Iterator[list[str]]:
    """Show every simulation of the block at ``port``, at the pace of real time, from when a browser is there to look.

    ``told`` is called with the address. What comes out is filled with what was done in the browser.
    """
    watched = _Watched(port, told)
    try:
        with joined(watched.watch, [watched], see=watched.see):
            yield watched.done
    finally:
        watched.end()


@final
class _Watched(Disturbance):
    """A view of one simulation after the other; its pushes are a disturbance of theirs."""

    def __init__(self, port: int, told: Callable[[str], None]) -> None:
        self._port, self._told, self._plant, self._view = port, told, None, None
        self._row: dict[str, Any] = {}
        self.done: list[str] = []

    _plant: Plant | None
    _view: View | None

    def begin(self, plant: Plant) -> Effect:
        self.end()
        self._plant = plant
        return Effect()

    def __str__(self) -> str:
        done = self.done if self._view is None else self._view.done
        return f"by hand, while watched: {'; '.join(done) or 'nothing'}"

    def see(self, row: dict[str, Any]) -> None:
        """Keep the row that was recorded of the tick."""
        self._row = row

    def watch(self, tick: int, ticks: int, controller: Controller) -> None:
        """Show the tick; the first one makes the view and waits for a browser."""
        del tick, ticks
        if self._view is None or self._view.controller is not controller:
            self._view = self._made(controller)
            self._told(self._view.url)
            self._update(controller)  # somebody who comes sees the robot
            self._view.wait()
        self._update(controller)

    def _update(self, controller: Controller) -> None:
        if self._view is not None and controller.last is not None:
            self._view.update(controller.last, microseconds=float(self._row.get("tick_us", np.nan)), row=self._row)

    def end(self) -> None:
        """Close the view that there is."""
        if self._view is not None:
            self.done += self._view.done
            self._view.close()
            self._view = None

    def _made(self, controller: Controller) -> View:
        plant = self._plant
        frames = [] if plant is None else [frame for frame in controller.model.frame_names if _pushes(plant, frame)]
        push = plant.push if plant is not None and frames else None
        return View(controller, port=self._port, push=push, frames=frames, pausing=True)


def _pushes(plant: Plant, frame: str) -> bool:
    """Whether the plant can push there."""
    try:
        plant.push(frame, np.zeros(3))
    except (NotSupported, UnknownName):
        return False
    return True
