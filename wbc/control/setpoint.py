"""Setpoint: the positions and velocities that drives are sent, and the state that a controller decides from.

    measured    the controller decides from (q, v) as measured: feedback runs through the whole controller.
                What is sent starts from the robot in every tick: one that sags under its load is sent one step from
                where it hangs; drives see no more than that step, and do not lift it. For torque-controlled robots,
                and for drives that follow without error.
    commanded   the controller decides from its own last setpoint, q ⊕ dt (v + ½ a dt) or q ⊕ dt v, tick after tick.
                What is sent is smooth, free of sensor noise and does not depend on the robot; keeping to it is the
                business of the drives. Torques are those of the setpoint, to be added to what the drives do.

Drift is what separates the two, difference(q measured, setpoint). With "commanded", a component that exceeds
``max_drift``, as where a joint is blocked, is dragged along at that distance and takes the measured velocity: pushing
on does not wind up, and a robot that comes free moves by ``max_drift`` and what the tick decides, not more.

After a tick without an answer the setpoint follows what the fallback levels (:mod:`wbc.control.recovery`) decided,
whichever it was: it goes on for a few ticks, then brakes to rest, and stays; with the first solved tick it goes on
from there. It is not set back to the measured state, which would be a step; ``reset`` does that. A measurement that
is not to be believed is judged as everywhere, its tick has the status INVALID_STATE, and drags nothing.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.control.command import Command
from wbc.control.controller import Controller
from wbc.types import Vec

#: From which state a controller may decide.
FEEDBACK = ("measured", "commanded")


@final
class Setpoint(metaclass=TellsArguments):
    """Runs a controller on the measured state, or on the one it commanded itself.

    ``q`` (nq,) and ``v`` (nv,) are the setpoint, joints last: what to send after a tick. Both are NaN before the first
    valid measurement, at which the setpoint starts. ``drift`` (nv,) [m, rad] is by how much the setpoint was ahead of
    the last such measurement, before it was limited; ``dragged`` counts the ticks that limited it.

    A floating base is part of the state: with "commanded" it is integrated like the joints, and what the estimator
    says of it only bounds the drift. Where it drags the base, feet move with it in the setpoint, and their contacts
    pull them back with the gains that they have. Components see the state that the controller decides from; those that
    watch the robot itself, such as a ``MomentumObserver``, need "measured".

    Args:
        controller: at any level; its ``tick`` must not be called by others meanwhile.
        feedback: "measured" or "commanded", as above.
        max_drift: bound on each component of the drift, one for all or (nv,) [m, rad]; ``inf`` for none. Only for
            "commanded".

    Raises:
        InvalidInput: another feedback, something that is not a controller, a bound that is not positive.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks import JointVelocityLimits, Position
        >>> robot = wbc.load("arm")
        >>> stack = wbc.Stack([Position("tool", target=[0.4, 0.2, 0.5])], subject_to=[JointVelocityLimits()])
        >>> controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel())
        >>> setpoint = wbc.Setpoint(controller, feedback="commanded", max_drift=0.1)
        >>> for k in range(100):  # the arm is blocked: it is measured where it was
        ...     command = setpoint.tick(1e-3 * k, robot.q0, np.zeros(robot.nv))
        >>> command.status.ok, bool(np.abs(setpoint.drift).max() < 0.11)
        (True, True)
    """

    __slots__ = ("_begun", "controller", "dragged", "drift", "feedback", "max_drift", "q", "v")

    def __init__(self, controller: Controller, *, feedback: str = "commanded", max_drift: Any = 0.1) -> None:
        self.controller = checks.instance("controller", controller, Controller, "a wbc.Controller")
        self.feedback = checks.one_of("feedback", feedback, FEEDBACK)
        self.max_drift = checks.limit("max_drift", max_drift, controller.model.nv)
        self._forget()

    def reset(self) -> None:
        """Begin anew, the controller too: the next measurement is where the setpoint starts."""
        self.controller.reset()
        self._forget()

    def _forget(self) -> None:
        model = self.controller.model
        self.q, self.v = np.full(model.nq, np.nan), np.full(model.nv, np.nan)
        self.drift = np.zeros(model.nv)
        self.dragged = 0
        self._begun = False

    def tick(self, t: float, q: Vec, v: Vec) -> Command:
        """Decide at time t [s], with q (nq,) and v (nv,) as measured, and move the setpoint.

        Raises:
            InvalidInput: q or v has another shape, or is not numbers.
        """
        controller, measured = self.controller, self.controller.measured
        t, q, v = measured.read(t, q, v)
        if not measured.take(t, q, v):
            q, v = self._chosen(measured.q.copy(), measured.v.copy())
        command = controller.tick(t, q, v)
        if self._begun:
            self.q, self.v = command.q, command.v
        return command

    def _chosen(self, q: Vec, v: Vec) -> tuple[Vec, Vec]:
        """The state to decide from, where (q, v) is measured and can be believed."""
        if not self._begun:
            self._begun = True
            return q, v
        model, most = self.controller.model, self.max_drift
        self.drift = model.difference(q, self.q)
        if self.feedback == "measured":
            return q, v
        beyond = np.abs(self.drift) > most
        if not beyond.any():
            return self.q, self.v
        self.dragged += 1
        return model.integrate(q, np.clip(self.drift, -most, most)), np.where(beyond, v, self.v)
