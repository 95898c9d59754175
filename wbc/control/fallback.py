"""Fallback: bounded velocities, accelerations and torques for a tick without an answer.

    hold     what the last certified command decided
    brake    every velocity to zero at a constant deceleration B, the one that the limits count on:
             v⁺ = v − clip(v, ±B dt),  a = (v⁺ − v) / dt,  at rest after max|v| / B and two ticks
             torques are those that this braking takes; on legs v decays with a time constant, feet held

Either is cut to what the limits on position, velocity, acceleration and torque allow from the state that is believed:
the measured one, or where that makes no sense the one that the last command was to reach.
"""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.errors import InvalidProblem
from wbc.models.model import RobotState
from wbc.qp.solvers import by_name
from wbc.stack.interval import BRAKING
from wbc.stack.plan import Plan
from wbc.types import Vec

#: Time constant with which a robot on legs is braked [s].
BRAKE_TIME = 0.05
_EPSILON = 1e-5


@final
class Fallback:
    """Bounded velocities, accelerations and torques for one plan."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._slowly = max(BRAKE_TIME, plan.dt)

    def velocity(self, state: RobotState, held: Vec | None, last: Vec) -> Vec:
        """(nv,) of a velocity level: the held one, or ``last`` braked; joints within their limits."""
        v = last - np.clip(last, -self._most(), self._most()) if held is None else held.copy()
        return self._within(state, v)

    def acceleration(self, state: RobotState, held: Vec | None) -> Vec:
        """(nv,): the held one, or braking; joints within their limits."""
        a = -np.clip(state.v, -self._most(), self._most()) / self._plan.dt if held is None else held.copy()
        return self._within(state, a)

    def torque(self, state: RobotState, a: Vec, held: Vec | None, carrying: Vec | None) -> Vec:
        """(nj,) for the motors: the held command, or one that brakes; the torques it gives are cut to their bounds.

        Fixed base: τ = M a + h. On legs τ of the QP  minimise ½ ‖a + v / T‖² + ½ ε ‖f‖²  under the constraints of the
        stack (contacts, friction, torques), solved by the default solver, whatever solver failed. Where neither is a
        number: ``carrying``, the command that last carried the robot, less damping. Motors, loads and bounds are those
        that components said last.
        """
        motors = self._plan.applied.actuators
        if held is not None:
            torque = motors.torque(held)
        else:
            torque = self._standing(state) if self._plan.layout.nf else self._inverse_dynamics(state, a)
            if not np.isfinite(torque).all():
                torque = np.zeros(len(torque)) if carrying is None else motors.torque(carrying)
                damping = state.M.diagonal()[self._plan.model.nb :] / self._slowly * state.v_joints
                torque = torque - np.nan_to_num(damping)
        return motors.command(np.clip(torque, *self._torque_bounds(state)))

    def _torque_bounds(self, state: RobotState) -> tuple[Vec, Vec]:
        """Bounds on torques (nj,) in this state; those at any speed where users' code leaves none that are sound."""
        low, high = self._plan.torque_bounds
        try:
            lower, upper = self._plan.torques_at(state)
        except Exception:  # it raised in the fill, too, which told of it
            return low, high
        sound = (lower < np.inf) & (upper > -np.inf)  # they lie within those at any speed, or are NaN
        return np.where(sound, lower, low), np.where(sound, upper, high)

    def _most(self) -> Vec:
        """By how much a velocity (nv,) may fall in a tick."""
        plan = self._plan
        braking = np.full(plan.model.nv, BRAKING)
        braking[plan.model.nb :] = plan.intervals.braking
        most: Vec = braking * plan.dt
        return most

    def _inverse_dynamics(self, state: RobotState, a: Vec) -> Vec:
        """Without contacts; a floating base accelerates as it must."""
        nb, applied = self._plan.model.nb, self._plan.applied
        M = state.M if applied.inertia is None else state.M + applied.inertia
        h = state.h + applied.bias
        if nb and np.isfinite(M).all():
            a = a.copy()
            a[:nb] = -np.linalg.lstsq(M[:nb, :nb], M[:nb, nb:] @ a[nb:] + h[:nb])[0]  # links may have no mass
        return np.asarray((M @ a + h)[nb:])

    def _standing(self, state: RobotState) -> Vec:
        plan, p = self._plan, self._plan.problem
        nb, nv = plan.model.nb, plan.model.nv
        qp = plan.qp.copy()
        qp.H[:] = np.diag(np.where(np.arange(qp.n) < nv, 1.0, _EPSILON))
        qp.g[:] = 0.0
        qp.g[:nv] = state.v / self._slowly
        qp.lb[nb:nv], qp.ub[nb:nv] = np.multiply(plan.joint_bounds(state), p.scale[nb:nv])
        try:
            solution = by_name("pdas").solve(qp)
        except InvalidProblem:
            return np.full(nv - nb, np.nan)
        return np.asarray(p.G[nb:nv] @ np.append(solution.x / p.scale, 1.0))

    def _within(self, state: RobotState, decided: Vec) -> Vec:
        nb = self._plan.model.nb
        np.clip(decided[nb:], *self._plan.joint_bounds(state), out=decided[nb:])
        return decided
