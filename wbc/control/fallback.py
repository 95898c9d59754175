"""Fallback: what a controller says when it cannot solve.

    hold     the last certified command, for at most ``hold_ticks`` ticks in a row
    damped   brake: velocities decay with a time constant; torques are gravity (on legs: those that last carried the
             robot) less damping

Either is cut to what the limits on position, velocity, acceleration and torque allow from the state that is believed:
the measured one, or where that makes no sense the one that the last command was to reach.
"""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.models.model import RobotState
from wbc.stack.plan import Plan
from wbc.types import Vec

#: Time constant with which a damped stop takes the velocity out [s]; never less than a tick.
BRAKE_TIME = 0.05


@final
class Fallback:
    """Bounded velocities, accelerations and torques for one plan."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._time = max(BRAKE_TIME, plan.dt)

    def velocity(self, state: RobotState, held: Vec | None, last: Vec) -> Vec:
        """(nv,) of a velocity level: the held one, or ``last`` decaying; joints within their limits."""
        v = last * (1.0 - self._plan.dt / self._time) if held is None else held.copy()
        return self._within(state, v)

    def acceleration(self, state: RobotState, held: Vec | None) -> Vec:
        """(nv,): the held one, or braking; joints within their limits."""
        a = -state.v / self._time if held is None else held.copy()
        return self._within(state, a)

    def torque(self, state: RobotState, held: Vec | None, carrying: Vec | None) -> Vec:
        """(nj,): the held one, or τ_ref − D v with D = diag(M)/T, cut to the bounds of this tick.

        τ_ref is gravity on a fixed base, ``carrying`` on a floating one.
        """
        low, high = self._plan.torque_bounds
        if held is None:
            nb = self._plan.model.nb
            reference = state.g[nb:] if nb == 0 or carrying is None else carrying
            held = reference - state.M.diagonal()[nb:] / self._time * state.v_joints
            if not np.isfinite(held).all():
                held = np.zeros(len(low)) if carrying is None else carrying
        torque: Vec = np.clip(held, low, high)
        return torque

    def _within(self, state: RobotState, decided: Vec) -> Vec:
        bounds = self._plan.joint_bounds(state)
        if bounds is not None:
            nb = self._plan.model.nb
            np.clip(decided[nb:], *bounds, out=decided[nb:])
        return decided
