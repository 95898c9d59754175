"""Fallback: bounded velocities, accelerations and torques for a tick without an answer.

    hold     what the last certified command decided
    brake    every velocity to zero at a constant deceleration B, the one that the limits count on:
             v⁺ = v − clip(v, ±B dt),  a = (v⁺ − v) / dt,  at rest after max|v| / B and two ticks
             torques are those that this braking takes; on legs v decays with a time constant, feet held

Either is cut to what the limits on position, velocity, acceleration and torque allow from the state that is believed:
the measured one, or where that makes no sense the one that the last command was to reach.
"""

from __future__ import annotations

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


def velocity(plan: Plan, state: RobotState, held: Vec | None, last: Vec) -> Vec:
    """(nv,) of a velocity level: the held one, or ``last`` braked; joints within their limits."""
    return _within(plan, state, last - _braked(plan, last) if held is None else held.copy())


def acceleration(plan: Plan, state: RobotState, held: Vec | None) -> Vec:
    """(nv,): the held one, or braking; joints within their limits."""
    return _within(plan, state, -_braked(plan, state.v) / plan.dt if held is None else held.copy())


def torque(plan: Plan, state: RobotState, a: Vec, held: Vec | None, carrying: Vec | None) -> Vec:
    """(nj,) for the motors: the held command, or one that brakes; the torques it gives are cut to their bounds.

    Fixed base: τ = M a + h. On legs τ of the QP  minimise ½ ‖a + v / T‖² + ½ ε ‖f‖²  under the constraints of the
    stack (contacts, friction, torques), solved by the default solver, whatever solver failed. Where neither is a
    number: ``carrying``, the command that last carried the robot, less damping. Motors, loads and bounds are those
    that components said last.
    """
    motors = plan.applied.actuators
    if held is not None:
        found = motors.torque(held)
    else:
        found = _standing(plan, state) if plan.layout.nf else _inverse_dynamics(plan, state, a)
        if not np.isfinite(found).all():
            found = np.zeros(len(found)) if carrying is None else motors.torque(carrying)
            damping = state.M.diagonal()[plan.model.nb :] / _brake_time(plan) * state.v_joints
            found = found - np.nan_to_num(damping)
    return motors.command(np.clip(found, *_torque_bounds(plan, state)))


def _torque_bounds(plan: Plan, state: RobotState) -> tuple[Vec, Vec]:
    """Bounds on torques (nj,) in this state; those at any speed where users' code leaves none that are sound."""
    low, high = plan.torque_bounds
    try:
        lower, upper = plan.torques_at(state)
    except Exception:  # it raised in the fill, too, which told of it
        return low, high
    sound = (lower < np.inf) & (upper > -np.inf)  # they lie within those at any speed, or are NaN
    return np.where(sound, lower, low), np.where(sound, upper, high)


def _braked(plan: Plan, v: Vec) -> Vec:
    """By how much velocities v (nv,) fall in a tick that brakes."""
    most = np.append(np.full(plan.model.nb, BRAKING), plan.intervals.braking) * plan.dt
    return np.clip(v, -most, most)


def _brake_time(plan: Plan) -> float:
    return max(BRAKE_TIME, plan.dt)


def _inverse_dynamics(plan: Plan, state: RobotState, a: Vec) -> Vec:
    """Without contacts; a floating base accelerates as it must."""
    nb, applied = plan.model.nb, plan.applied
    M = state.M if applied.inertia is None else state.M + applied.inertia
    h = state.h + applied.bias
    if nb and np.isfinite(M).all():
        a = a.copy()
        a[:nb] = -np.linalg.lstsq(M[:nb, :nb], M[:nb, nb:] @ a[nb:] + h[:nb])[0]  # links may have no mass
    return np.asarray((M @ a + h)[nb:])


def _standing(plan: Plan, state: RobotState) -> Vec:
    p, nb, nv = plan.problem, plan.model.nb, plan.model.nv
    qp = plan.qp.copy()
    qp.H[:] = np.diag(np.where(np.arange(qp.n) < nv, 1.0, _EPSILON))
    qp.g[:] = 0.0
    qp.g[:nv] = state.v / _brake_time(plan)
    qp.lb[nb:nv], qp.ub[nb:nv] = np.multiply(plan.joint_bounds(state), p.scale[nb:nv])
    try:
        solution = by_name("pdas").solve(qp)
    except InvalidProblem:
        return np.full(nv - nb, np.nan)
    return np.asarray(p.G[nb:nv] @ np.append(solution.x / p.scale, 1.0))


def _within(plan: Plan, state: RobotState, decided: Vec) -> Vec:
    nb = plan.model.nb
    np.clip(decided[nb:], *plan.joint_bounds(state), out=decided[nb:])
    return decided
