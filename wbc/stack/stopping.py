"""Stopping: whether motors can bring joints to rest within their position limits, whatever a tick decides.

A bound on each joint's acceleration says nothing about torques, which joints share through M(q) and the bias h(q, v).
So each decision is tried out: from the state that it leads to, a braking policy is followed to rest through the
dynamics.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, final

import numpy as np

from wbc.models.model import RobotModel, RobotState
from wbc.stack.filled import Filled
from wbc.stack.interval import JointIntervals
from wbc.tolerances import HUGE, NEAR, SAME
from wbc.types import Mat, Vec

#: Share of the torque range that the way to rest leaves free on either side: it is computed in few moments.
_MARGIN = 0.05
#: Share of that margin that may be used by what changes from one moment to the next.
_BETWEEN = 0.1
#: Braking policies that are tried, by how gently joints far from their limits stop: the time in which they do, in
#: stopping times of the joint that needs longest.
_GENTLE = (0.1, 1.0, 3.0)
#: Moments that a way to rest has at least, and at most.
_MOMENTS, _MOST_MOMENTS = 10, 80
#: What a joint moves [rad, m] between two of them at most.
_TURN = 0.1
#: Configurations that bounds of inertia and bias are taken from, and what these are raised by.
_SAMPLES, _RAISED = 300, 1.25
#: Shares of the way from braking to what was wanted below which a tick just brakes.
_LEAST_SHARE = 0.02


class _Load(NamedTuple):
    """What motors can do in this tick, and what they carry beside the robot: τ = (M + inertia) a + h + bias."""

    lower: Vec
    upper: Vec
    bias: Vec
    inertia: Mat | None

    def push(self, M: Mat, a: Vec) -> Vec:
        """Torques (nv,) of accelerations."""
        push: Vec = M @ a
        return push if self.inertia is None else push + self.inertia @ a


class _Way(NamedTuple):
    """A way to rest: from when on [s], the time between its moments [s], and the decelerations (nv,) of each."""

    start: float
    step: float
    sizes: list[Vec]


@final
class Stopping:
    """Braking policies, and what a tick has to leave them.

    A policy is a_i = −β D_i sign(v_i) with one β in [0, 1] for all joints, the largest with which
    M(q) a + h(q, v) is within the torque limits, and

        D_i = min(B_i, |v_i| / dt, max(|v_i| / T, v_i² / 2 s_i)).

    B_i is the deceleration that position limits count on, s_i the room to the limit ahead, T a time that is the same
    for all joints. A state is safe where one of the policies comes to rest with no joint past its limit, and the
    torques hold the robot there, with the margin ``_MARGIN`` or as much of it as is left now. The next tick can then
    do what the policy does, so positions, velocities and torques can be kept together for ever. A decision that leads
    to a state that is not safe is taken back: accelerations are bounded by a box around those of a way to rest, a
    quarter as large each time, and the tick is solved again. Where the torques do not allow the last box, each joint
    is left the decelerations that still stop it at its limit. Where these contradict each other, too, the limits are
    relaxed; on a robot with joints that nothing limits the first decision stands.

    A joint that is outside its limit and moves on, or that is too fast to be stopped there, brakes with B. In that tick
    its limit counts as being where B stops it, so that the other joints have a way to rest.

    It holds for robots on a fixed base without contacts, whose model, torque limits and states are what they are
    thought to be. The way to rest is computed with ``_MARGIN`` of the torques in hand. Other rows of the stack that
    are exact are not looked at. Del Prete, IEEE RA-L 2018, has the same for one joint with a constant B.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks import JointLimits, Posture
        >>> robot = wbc.load("arm")
        >>> stack = wbc.Stack([Posture(robot.q0)], subject_to=[JointLimits()])
        >>> stopping = wbc.InverseDynamics().compile(robot, stack, dt=1e-3).stopping
        >>> [stopping.is_safe(0.0, robot.q0, np.full(robot.nv, speed)) for speed in (0.0, 50.0)]
        [True, False]
    """

    @classmethod
    def of(cls, plan: Filled) -> Stopping | None:
        """The one of a plan; None where torques or positions have no limits, or the robot has a base or contacts."""
        layout, limits = plan.layout, plan.intervals
        if not layout.torque_limits or plan.model.nb or layout.nf:
            return None
        bounded = np.isfinite(limits.bounds("position")).any()
        return cls(plan.model, limits, plan.torque_range, plan.dt) if bounded else None

    def __init__(self, model: RobotModel, intervals: JointIntervals, torques: tuple[Vec, Vec], dt: float) -> None:
        self._model, self._intervals, self._dt = model, intervals, dt
        self._first = model.nq - model.nj
        self._state = model.state(drifts=False)
        fast = model.limits.v_max
        self._fast = np.where(np.isfinite(fast) & (fast > 0.0), fast, 1.0)
        self._per_fast, self._half_dt = 1.0 / self._fast, 0.5 * dt
        self._load = _Load(*torques, np.zeros(model.nv), None)
        self._in_time = np.zeros(model.nj)
        self._sample()
        self.reset()

    def reset(self) -> None:
        """Nothing was decided yet."""
        self._gentle, self._share = _GENTLE[0], 1.0
        #: The last way to rest that was found; None where decelerations that torques surely allow are enough.
        self._way: _Way | None = None
        #: How far beyond its limit B stops each joint in this tick (nj,), signed as its velocity.
        self._late = self._in_time

    def _sample(self) -> None:
        """Bounds of |M|, of |h| at rest and of what moving at the velocity limits adds, over the position limits."""
        model, rng, state = self._model, np.random.default_rng(0), self._state
        low, high = model.limits.q_min, model.limits.q_max
        finite = np.isfinite(low) & np.isfinite(high)
        nv = model.nv
        self._inertia, self._weight, self._moving = np.zeros((nv, nv)), np.zeros(nv), np.zeros(nv)
        for k in range(_SAMPLES):
            q = model.random_configuration(rng)
            if k % 3 == 0:  # a corner
                q = np.where(finite, np.where(rng.random(model.nj) < 0.5, low, high), q)
            sides = rng.choice(np.array([-1.0, 1.0]), nv)
            state.update(0.0, q, np.zeros(nv))
            np.maximum(self._inertia, np.abs(state.M), out=self._inertia)
            at_rest = state.h.copy()
            np.maximum(self._weight, np.abs(at_rest), out=self._weight)
            state.update(0.0, q, self._fast * (sides if k % 2 else sides * rng.random(nv)))
            np.maximum(self._moving, np.abs(state.h - at_rest), out=self._moving)
        for bound in (self._inertia, self._weight, self._moving):
            bound *= _RAISED

    # ---- is a state safe?
    def is_safe(self, t: float, q: Vec, v: Vec) -> bool:
        """Whether a policy comes to rest from q (nq,), v (nv,) at time t [s], with the torques of this tick.

        The way to rest is then kept, for ticks that find nothing better than to follow it.
        """
        if self._load.inertia is None and self._surely(q, v):
            self._way = None
            return True
        for gentle in dict.fromkeys((self._gentle, *_GENTLE)):
            way = self._way_to_rest(t, q, v, gentle)
            if way is not None:
                self._gentle, self._way = gentle, way
                return True
        return False

    def _needed(self, q: Vec, v: Vec) -> tuple[Vec, Vec, Vec]:
        """B (nj,), the room ahead (nj,) that stopping in ticks leaves, and the deceleration v² / 2 s (nj,)."""
        B, ahead = self._intervals.ahead(q[self._first :], v)
        speed = np.abs(v)
        if self._late.any():
            ahead += np.maximum(self._late * np.sign(v), 0.0)
        room = np.minimum(ahead - 0.5 * self._dt * speed, HUGE)  # no limit ahead is one that is out of reach
        return B, room, speed * speed / (2.0 * np.maximum(room, SAME))

    def _surely(self, q: Vec, v: Vec) -> bool:
        """Braking just enough for the nearer limit takes less than the motors have in any configuration."""
        speed, load = np.abs(v), self._load
        room = self._intervals.nearest(q[self._first :])
        room -= self._half_dt * speed
        np.maximum(room, SAME, out=room)
        needed = speed * speed
        needed /= room
        needed *= 0.5
        if (needed > self._intervals.braking).any():
            return False
        speed *= self._per_fast
        need = np.dot(self._inertia, needed)
        need += speed.max() ** 2 * self._moving
        need += self._weight
        if load.bias.any():
            need += np.abs(load.bias)
        return bool((need <= load.upper).all() and (need <= -load.lower).all())

    def _way_to_rest(self, t: float, q: Vec, v: Vec, gentle: float) -> _Way | None:
        dt, step = self._dt, 0.0
        sizes: list[Vec] = []
        last = kept = np.zeros(len(v))
        for _ in range(_MOST_MOMENTS):
            B, room, needed = self._needed(q, v)
            speed = np.abs(v)
            distance = 0.5 * speed * speed
            if (distance > B * room + SAME).any():
                return None
            time = max(float((speed / np.maximum(B, SAME)).max(initial=0.0)) * gentle, dt)
            D = np.minimum(np.minimum(B, speed / dt), np.maximum(speed / time, needed)) * np.sign(v)
            a, spare = self._brake(q, v, D, last)
            if a is None:
                return None
            if not sizes:
                kept = np.minimum(_MARGIN * (self._load.upper - self._load.lower), spare)
            size = np.abs(a)
            sizes.append(size)
            if (speed <= 2.0 * dt * size).all() and (distance <= size * room + SAME).all():
                if ((spare > 0.0) & (spare >= kept - SAME)).all():
                    return _Way(t, max(step, dt), sizes)
            brakes = size > 0.0
            stop = np.divide(speed, size, out=speed + np.inf, where=brakes)
            if not step:
                longest, fastest = float(stop.max(where=brakes, initial=0.0)), float(speed.max())
                step = dt * max(1.0, np.floor(min(longest / _MOMENTS, _TURN / max(fastest, SAME)) / dt))
            last = np.where(stop < step, 0.0, a)
            stop = np.minimum(stop, step)
            turn = (v + 0.5 * a * stop) * stop
            if (np.abs(turn) > room + 0.5 * dt * speed + SAME).any():
                return None
            q, v = q + turn, v + a * stop
        return None

    def _brake(self, q: Vec, v: Vec, D: Vec, last: Vec) -> tuple[Vec | None, Vec]:
        """The acceleration −β D (nv,), and what the motors have left (nv,) where they hold the robot without any.

        None where the torques do not allow it, or no longer allow ``last``, the acceleration up to here.
        """
        state, load = self._state, self._load
        state.update(0.0, q, v)
        bias, push = state.h + load.bias, load.push(state.M, D)
        above, below = bias - load.lower, bias - load.upper
        left, free = np.minimum(above, -below), _MARGIN * (above - below)
        # In hand on either side; where holding the robot leaves less, half of what it leaves.
        free = np.where(np.isfinite(left), np.where(left > 0.0, np.minimum(free, 0.5 * left), free), 0.0)
        above, below, changed = above - free, below + free, _BETWEEN * free
        pushed = -load.push(state.M, last)
        if ((pushed > above + changed) | (pushed < below - changed)).any():
            return None, left
        # below <= β push <= above
        still = push == 0.0
        ends = np.array([np.where(still, np.inf, above), np.where(still, -np.inf, below)])
        ends /= np.where(still, 1.0, push)
        most, least = float(ends.max(axis=0).min(initial=1.0)), float(ends.min(axis=0).max(initial=0.0))
        if least > most or (still & ((above < 0.0) | (below > 0.0))).any():
            return None, left
        return -most * D, left

    # ---- what a tick may decide
    def keep(self, plan: Filled, state: RobotState, solve: Callable[[], bool]) -> bool:
        """Narrow the bounds of the accelerations, and ``solve`` again, until the decision in the plan's memory is safe.

        ``solve`` leaves a decision within the bounds there and says whether it could. The last bounds leave the first
        acceleration of a way to rest alone. It is looked for anew from this state, since the one found with an earlier
        decision was checked at its own moments only. While limits of a joint are lifted nothing is narrowed: that joint
        has no way to rest, and the others count on the constant B. False: not even the last decision is safe.
        """
        if any(overrides.lifted for _, overrides in plan.applied.said):
            return True
        self._load = _Load(*plan.torque_range, plan.extra_bias, plan.applied.inertia)
        self._late = self._in_time
        if self._is_safe_after(plan, state) or (self._find_late(state) and self._is_safe_after(plan, state)):
            self._share = 1.0
            return True
        lower, upper = plan.joint_bound_rows
        low, high = lower.copy(), upper.copy()
        wanted = plan.problem.value[plan.layout.motion_items].copy()
        self.is_safe(state.t, state.q, state.v)
        brake = np.clip(self._along_the_way(state), *self._intervals.bounds("acceleration"))
        if self._intervals.remembers and not self._intervals.recovering:  # limits on jerk are relaxed
            low, high = np.minimum(low, brake), np.maximum(high, brake)
        brake = np.clip(brake, low, high)
        B, _ = self._intervals.ahead(state.q_joints, state.v_joints)
        reach = float((np.abs(wanted - brake) / np.maximum(B, SAME)).max()) * B
        share = min(0.5, max(2.0 * self._share, _LEAST_SHARE))  # at rest it would stay there for ever with none
        while True:
            np.maximum(low, brake - share * reach - SAME, out=lower)
            np.minimum(high, brake + share * reach + SAME, out=upper)
            self._share = share
            if not solve():  # nor could it in a narrower box
                self._just_in_time(state, low, high, lower, upper)
                if not solve() and plan.unlimited_joints(low, high):  # nor is it relaxed
                    lower[:], upper[:] = low, high
                    solve()
                return False
            if self._is_safe_after(plan, state):
                return True
            if share == 0.0:
                return False
            share = 0.25 * share if share > _LEAST_SHARE else 0.0

    def _find_late(self, state: RobotState) -> bool:
        """Whether B stops some joint only beyond its limit. How far beyond counts as room ahead in this tick."""
        B, room, _ = self._needed(state.q, state.v)
        late = np.maximum(state.v**2 / (2.0 * np.maximum(B, SAME)) - room, 0.0)
        self._late = np.sign(state.v) * np.where(late > SAME, late, 0.0)
        return bool(self._late.any())

    def _just_in_time(self, state: RobotState, low: Vec, high: Vec, lower: Vec, upper: Vec) -> None:
        """Of the bounds ``low`` and ``high`` those decelerations, or more, that stop each joint at the limit ahead."""
        v = state.v
        _, _, needed = self._needed(state.q, v)
        np.clip(np.where(v < 0.0, needed, -np.inf), low, high, out=lower)
        np.clip(np.where(v > 0.0, -needed, np.inf), low, high, out=upper)

    def _is_safe_after(self, plan: Filled, state: RobotState) -> bool:
        """Whether the state that the accelerations in the plan's memory lead to is safe."""
        dt, a = self._dt, plan.problem.value[plan.layout.motion_items]
        v = state.v + dt * a
        return self.is_safe(state.t + dt, state.q + self._half_dt * (state.v + v), v)

    def _along_the_way(self, state: RobotState) -> Vec:
        """The acceleration (nv,) of the way to rest that was found last."""
        if self._way is None:
            _, _, size = self._needed(state.q, state.v)
        else:
            start, step, sizes = self._way
            at = int(np.clip((state.t - start) / step + NEAR, 0, len(sizes) - 1))
            size = sizes[at]
        brake: Vec = -np.sign(state.v) * np.minimum(size, np.abs(state.v) / self._dt)
        return brake
