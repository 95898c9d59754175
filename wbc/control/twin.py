"""Twin: ticks of a controller that have no effect on it, to have processor caches warm when the real one comes.

After half a millisecond of sleep a tick takes two to four times as long as after another tick: code and memory have
left the caches. A twin is a second controller of the same settings with memory of its own; what they share is the code
and the robot's model, and that is what most of the time goes for.
"""

from __future__ import annotations

from typing import Any, final

from wbc.control.controller import Controller
from wbc.control.watchdog import Watchdog
from wbc.stack.member import Binding, Member
from wbc.stack.stack import Stack
from wbc.stack.target import Target


@final
class Twin:
    """Calling it ticks a twin of ``controller`` at the state of its last tick, before the first at its reference.

    The controller, its components, its warm start and what records it do not notice: the twin has no components, and
    copies of all members that nobody else has. Targets stay what they were at t = 0, so that functions given as targets
    are not called. Tasks, constraints and contacts of one's own are, on the copies, as in every tick.

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
        own = Binding().own
        copied = Stack(own(stack.levels), subject_to=own(stack.subject_to), contacts=own(stack.contacts))
        self._twin: Controller = make(model, copied, watchdog=Watchdog())
        planned = self._twin.plan.stack
        _hold((planned.levels, planned.subject_to, planned.contacts))

    def __call__(self) -> None:
        """A dry tick."""
        state = self._controller.state
        self._twin.tick(state.t, state.q, state.v)


def _hold(value: Any) -> None:
    """Let the targets of a member stand still."""
    if isinstance(value, Target):
        value.function = None
    elif isinstance(value, Member):
        for inner in value.__dict__.values():
            _hold(inner)
    elif type(value) in (list, tuple):
        for one in value:
            _hold(one)
