"""Twin: ticks of a controller that have no effect on it, to have processor caches warm when the real one comes.

After half a millisecond of sleep a tick takes two to four times as long as after another tick: code and memory have
left the caches. A twin is a second controller of the same settings with memory of its own; what they share is the code
and the robot's model, and that is what most of the time goes for.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, final

from wbc.control.controller import Controller
from wbc.control.watchdog import Watchdog
from wbc.stack.member import Binding, Member
from wbc.stack.stack import Stack


@final
class Twin:
    """Calling it ticks a twin of ``controller`` at the state of its last tick, before the first at its reference.

    The controller, its components, its warm start and what records it do not notice: the twin has no components, and
    copies of all members that nobody else has. What a component sets in each tick stays as its user made it. Targets
    and obstacles stay what they were at t = 0: no function that was given for one is called, neither by a dry tick nor
    where the twin is made, but once there if it was assigned since the last tick. Tasks, constraints and contacts of
    one's own are, on the copies, as in every tick.

    Example:
        >>> import wbc
        >>> from wbc.control.twin import Twin
        >>> from wbc.tasks import Posture
        >>> robot = wbc.load("arm")
        >>> controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.AccelerationLevel())
        >>> command, warm = controller.tick(0.0, robot.q0, robot.q0 * 0), Twin(controller)
        >>> warm()
        >>> controller.ticks
        1
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        make, (model, stack) = controller.__reduce__()
        first = {id(one.function): one.first for one in controller.plan.binding.followed() if one.function is not None}
        own = Binding().own
        levels, subject_to, contacts = (
            _still(own(part), first) for part in (stack.levels, stack.subject_to, stack.contacts)
        )
        still = Stack(levels, subject_to=subject_to, contacts=contacts)
        self._twin: Controller = make(model, still, watchdog=Watchdog())

    def __call__(self) -> None:
        """A dry tick."""
        state = self._controller.state
        self._twin.tick(state.t, state.q, state.v)


def _still(value: Any, first: Mapping[int, Any]) -> Any:
    """``value`` of which nothing moves by a function; ``first`` is what functions, by their id, gave for t = 0.

    Members, which are the twin's own, are changed: what a component sets in each tick, they have to themselves.
    """
    if id(value) in first:
        return partial(_constant, first[id(value)])
    if isinstance(value, Member):
        value.__dict__.update({name: _still(inner, first) for name, inner in value.__dict__.items()}, set_by=None)
        return value
    if type(value) in (list, tuple):
        return type(value)(_still(one, first) for one in value)
    return value.still() if hasattr(type(value), "still") else value


def _constant(value: Any, _: float) -> Any:
    return value
