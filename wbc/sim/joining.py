"""Joining: what comes to every simulation that starts inside a block, whoever wrote its loop.

A scenario makes its own controller and calls :func:`~wbc.sim.simulate.simulate` itself. Those who want to look at its
QPs, or to disturb it in a way it does not know of, join it from outside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

if TYPE_CHECKING:
    from wbc.control.controller import Controller
    from wbc.sim.disturbance import Disturbance


def _look_away(tick: int, ticks: int, controller: Controller) -> None:
    """Watches nothing."""


def _pass_by(row: dict[str, Any]) -> None:
    """Reads nothing."""


#: Called with what is recorded of each tick, the plant's truth too, before the tick is watched.
See = Callable[[dict[str, Any]], None]
#: Called after each tick, outside what is timed: which tick, of how many, and the controller that made it.
Watch = Callable[[int, int, "Controller"], None]


@final
@dataclass(frozen=True)
class Guest:
    """Somebody who looks on, and brings disturbances along."""

    watch: Watch = _look_away
    disturbances: Sequence[Disturbance] = ()
    see: See = _pass_by


_PRESENT: ContextVar[tuple[Guest, ...]] = ContextVar("guests of a simulation", default=())


@contextmanager
def joined(
    watch: Watch = _look_away, disturbances: Sequence[Disturbance] = (), *, see: See = _pass_by
) -> Iterator[None]:
    """Join every simulation that this thread starts inside the block.

    ``watch(tick, ticks, controller)`` is called after each tick and must leave the controller as it is;
    ``disturbances`` are added to the simulation's own. ``see(row)`` is called before it with the columns of the tick.

    Example:
        >>> import wbc
        >>> from wbc.tasks import Posture
        >>> from wbc.sim.joining import joined
        >>> from wbc.sim.plant import IntegratorPlant
        >>> from wbc.sim.simulate import simulate
        >>> robot, costs = wbc.load("arm"), []
        >>> controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel())
        >>> with joined(lambda tick, ticks, controller: costs.append(controller.qp.n)):
        ...     _ = simulate(controller, IntegratorPlant(robot, level="velocity"), duration=0.003)
        >>> costs
        [7, 7, 7]
    """
    token = _PRESENT.set((*_PRESENT.get(), Guest(watch, tuple(disturbances), see)))
    try:
        yield
    finally:
        _PRESENT.reset(token)


def guests() -> tuple[Guest, ...]:
    """Who has joined here."""
    return _PRESENT.get()
