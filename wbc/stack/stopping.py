"""Stopping: whether motors can bring joints to rest within their position limits, whatever a tick decides.

A bound on each joint's acceleration says nothing about torques, which joints share through M(q) and the bias h(q, v).
So each decision is tried out: from the state that it leads to, a braking policy is followed to rest through the
dynamics.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.models.limits import finite_interval
from wbc.models.model import RobotModel, RobotState
from wbc.stack.compiled import stopping_kernel
from wbc.stack.filled import Filled
from wbc.stack.interval import JointIntervals
from wbc.tolerances import NEAR, SAME
from wbc.types import Mat, Vec

#: Braking policies that are tried, by how gently joints far from their limits stop: the time in which they do, in
#: stopping times of the joint that needs longest.
_GENTLE = (0.1, 1.0, 3.0)
#: Moments that a way to rest has at most.
_MOST_MOMENTS = 80
#: Configurations that bounds of inertia and bias are taken from, and what these are raised by.
_SAMPLES, _RAISED = 300, 1.25
#: Shares of the way from braking to what was wanted below which a tick just brakes.
_LEAST_SHARE = 0.02


@final
class Stopping:
    """Braking policies, and what a tick has to leave them.

    A policy is a_i = −β D_i sign(v_i) with one β in [0, 1] for all joints, the largest with which
    M(q) a + h(q, v) is within the torque limits, and

        D_i = min(B_i, |v_i| / dt, max(|v_i| / T, v_i² / 2 s_i)).

    B_i is the deceleration that position limits count on, s_i the room to the limit ahead, T a time that is the same
    for all joints. A state is safe where one of the policies comes to rest with no joint past its limit, and the
    torques hold the robot there, with a margin of a twentieth of the torque range or as much of it as is left now. The
    next tick can then do what the policy does, so positions, velocities and torques can be kept together for ever. A
    decision that leads to a state that is not safe is taken back: accelerations are bounded by a box around those of a
    way to rest, a quarter as large each time, and the tick is solved again. Where the torques do not allow the last
    box, each joint is left the decelerations that still stop it at its limit. Where these contradict each other, too,
    the limits are relaxed; on a robot with joints that nothing limits the first decision stands.

    A joint that is outside its limit and moves on, or that is too fast to be stopped there, brakes with B. In that tick
    its limit counts as being where B stops it, so that the other joints have a way to rest.

    It holds for robots on a fixed base without contacts, whose model, torque limits and states are what they are
    thought to be. The way to rest is computed with that margin in hand. Other rows of the stack that are exact are not
    looked at. Del Prete, IEEE RA-L 2018, has the same for one joint with a constant B.

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
        return cls(plan.model, limits, plan.torque_range, plan.extra_bias, plan.dt) if bounded else None

    def __init__(
        self, model: RobotModel, intervals: JointIntervals, torques: tuple[Vec, Vec], bias: Vec, dt: float
    ) -> None:
        self._intervals, self._dt, self._state = intervals, dt, model.state(drifts=False)
        fast = model.limits.v_max
        fast = np.where(np.isfinite(fast) & (fast > 0.0), fast, 1.0)
        inertia, weight, moving = _sampled(model, fast)
        self._memory = stopping_kernel.LAYOUT.arrays(
            np.array([model.nj, _MOST_MOMENTS, 0]), numbers=np.array([dt, 0.0, 0.0]), limits=intervals.memory[1],
            lower=torques[0], upper=torques[1], bias=bias, M=self._state.M.T, h=self._state.h, inertia=inertia,
            weight=weight, moving=moving, fast=fast,
        )  # fmt: skip
        self._kept = Memory(*self._memory)
        self._at = self._kept.address
        self._carries = False
        self.reset()

    def reset(self) -> None:
        """Nothing was decided yet."""
        self._gentle, self._share = _GENTLE[0], 1.0
        #: The last way to rest that was found: from when on [s], the time between its moments [s] and the decelerations
        #: (nv,) of each; None where decelerations that torques surely allow are enough.
        self._way: tuple[float, float, Mat] | None = None
        self._memory.late[:] = 0.0

    # ---- is a state safe?
    def is_safe(self, t: float, q: Vec, v: Vec) -> bool:
        """Whether a policy comes to rest from q (nq,), v (nv,) at time t [s], with the torques of this tick.

        The way to rest is then kept, for ticks that find nothing better than to follow it.
        """
        now = self._memory.now
        now[0], now[1] = q, v
        if not self._carries and stopping_kernel.surely(self._at):
            self._way = None
            return True
        for gentle in dict.fromkeys((self._gentle, *_GENTLE)):
            way = self._way_to_rest(t, q, v, gentle)
            if way is not None:
                self._gentle, self._way = gentle, way
                return True
        return False

    def _needed(self, q: Vec, v: Vec) -> Mat:
        """B (nj,), the room ahead (nj,) that stopping in ticks leaves, and the deceleration v² / 2 s (nj,)."""
        now = self._memory.now
        now[0], now[1] = q, v
        stopping_kernel.look(self._at)
        return self._memory.ahead

    def _way_to_rest(self, t: float, q: Vec, v: Vec, gentle: float) -> tuple[float, float, Mat] | None:
        memory, moment = self._memory, self._memory.now.ravel()
        memory.now[0], memory.now[1], memory.last[:] = q, v, 0.0
        memory.sizes[2], memory.numbers[1:] = 0, (gentle, 0.0)
        for _ in range(_MOST_MOMENTS):
            self._state.move(0.0, moment)
            count = stopping_kernel.brake(self._at)
            if count:
                return (t, max(memory.numbers.item(2), self._dt), memory.way[:count].copy()) if count > 0 else None
        return None

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
        inertia = plan.applied.inertia
        self._carries = inertia is not None
        self._memory.carried[:], self._memory.late[:] = 0.0 if inertia is None else inertia, 0.0
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
        B, *_ = self._needed(state.q, state.v)
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
        self._memory.late[:] = np.sign(state.v) * np.where(late > SAME, late, 0.0)
        return bool(self._memory.late.any())

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
        return self.is_safe(state.t + dt, state.q + 0.5 * dt * (state.v + v), v)

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


def _sampled(model: RobotModel, fast: Vec) -> tuple[Mat, Vec, Vec]:
    """Bounds of |M|, of |g| and of |C v|, which moving at the speeds ``fast`` adds, over the position limits."""
    limits, state, rng, n = model.limits, model.state(drifts=False), np.random.default_rng(0), (_SAMPLES, model.nj)
    low, high = finite_interval(limits, np.full(model.nj, np.pi))
    ends, share = np.isfinite(limits.q_min) & np.isfinite(limits.q_max), rng.random(n)
    share[::3, ends] = np.rint(share[::3, ends])  # a corner
    v = fast * rng.choice([-1.0, 1.0], n)
    v[::2] *= rng.random(n)[::2]
    found = []
    for moment in np.hstack([low + share * (high - low), v]):
        state.move(0.0, moment)
        found.append((state.M.copy(), state.g.copy(), state.h - state.g))
    inertia, weight, moving = (_RAISED * np.abs(one).max(axis=0) for one in zip(*found, strict=True))
    return inertia, weight, moving
