"""Fallback: bounded velocities, accelerations and torques for a tick without an answer.

    hold     what the last certified command decided
    brake    every velocity to zero at a constant deceleration B, the one that the limits count on:
             v⁺ = v − clip(v, ±B dt),  a = (v⁺ − v) / dt,  at rest after max|v| / B and two ticks
             torques are those that this braking takes: τ = M a + h − Jᵀf

Either is cut to what the limits on position, velocity, acceleration and torque allow from the state that is believed:
the measured one, or where that makes no sense the one that the last command was to reach.
"""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.models.model import RobotState
from wbc.stack.interval import BRAKING
from wbc.stack.plan import Plan
from wbc.types import Vec


@final
class Fallback:
    """Bounded velocities, accelerations and torques for one plan."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def velocity(self, state: RobotState, held: Vec | None, last: Vec) -> Vec:
        """(nv,) of a velocity level: the held one, or ``last`` braked; joints within their limits."""
        v = last - np.clip(last, -self._most(), self._most()) if held is None else held.copy()
        return self._within(state, v)

    def acceleration(self, state: RobotState, held: Vec | None) -> Vec:
        """(nv,): the held one, or braking; joints within their limits."""
        a = -np.clip(state.v, -self._most(), self._most()) / self._plan.dt if held is None else held.copy()
        return self._within(state, a)

    def torque(self, state: RobotState, a: Vec, held: Vec | None, carrying: Vec | None) -> Vec:
        """(nj,): the held one, or τ = S (M a + h − Jᵀf), cut to the bounds of this tick.

        On legs f are the forces of least norm at the contacts that give the base its part of a; in the air the base
        accelerates as it must. Where that is not a number: ``carrying``, the torques that last carried the robot.
        """
        low, high = self._plan.torque_range
        if held is None:
            held = self._inverse_dynamics(state, a)
            if not np.isfinite(held).all():
                held = np.zeros(len(low)) if carrying is None else carrying
        torque: Vec = np.clip(held, low, high)
        return torque

    def _most(self) -> Vec:
        """By how much a velocity (nv,) may fall in a tick."""
        plan = self._plan
        braking = np.full(plan.model.nv, BRAKING)
        if plan.intervals is not None:
            braking[plan.model.nb :] = plan.intervals.braking
        most: Vec = braking * plan.dt
        return most

    def _inverse_dynamics(self, state: RobotState, a: Vec) -> Vec:
        nb, nv, p = self._plan.model.nb, self._plan.model.nv, self._plan.problem
        M, h = state.M, state.h
        if nb:
            forces = p.G[:nv, nv : nv + self._plan.layout.nf]  # −Jᵀ of the contacts, as of the last tick
            missing = M[:nb] @ a + h[:nb]
            if not np.isfinite(missing).all() or not np.isfinite(forces).all():
                return np.full(nv - nb, np.nan)
            if forces.shape[1]:
                f, *_ = np.linalg.lstsq(forces[:nb], -missing, rcond=1e-10)
                return np.asarray(M[nb:] @ a + h[nb:] + forces[nb:] @ f)
            a = a - np.concatenate([np.linalg.solve(M[:nb, :nb], missing), np.zeros(nv - nb)])
        return np.asarray(M[nb:] @ a + h[nb:])

    def _within(self, state: RobotState, decided: Vec) -> Vec:
        bounds = self._plan.joint_bounds(state)
        if bounds is not None:
            nb = self._plan.model.nb
            np.clip(decided[nb:], *bounds, out=decided[nb:])
        return decided
