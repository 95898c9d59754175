"""JointIntervals: position, velocity, acceleration and jerk limits as one interval per joint, never empty."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Self, final

import numpy as np
from scipy.linalg.blas import daxpy, dcopy, ddot

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.constraint import JointInterval
from wbc.stack.jerk import JerkLimits
from wbc.types import Vec

#: Deceleration counted on where no acceleration limit says otherwise [rad/s², m/s²]: a joint at 2 rad/s stops within
#: 0.1 s and 0.1 rad, which drives of arms and legs can do with their load; small enough not to fight contacts.
BRAKING = 20.0
#: Speed of the way back into position limits, for joints without a velocity limit [rad/s, m/s].
RETURN_SPEED = 1.0
#: Distances from a limit [rad, m] that are none.
_ROUNDING = 1e-9
_QUANTITIES = ("position", "velocity", "acceleration", "jerk")
# What the formulas are made of, in the order in which compiled code reads it.
_CONSTANTS = ("position", "velocity", "acceleration", "−B", "2 B", "B dt", "(B dt)²", "return speed")
_WORK = ("value", "room", "reach", "wanted", "free", "bound")


@final
class JointIntervals:
    """What a joint may do next so that all its limits hold now and can hold for ever after.

    Position limits need room to brake. With d the distance to a limit and B the deceleration counted on (the
    acceleration limit, at most ``braking`` of the law on positions; 20 where nothing is said), the velocity u towards
    the limit at the end of the tick is bounded by

    ``acceleration``: q⁺ = q + v dt + ½ a dt², v⁺ = v + a dt.   u <= −B dt + √((B dt)² + 2 B s), s = d − ½ v dt
    ``velocity``:     q⁺ = q + v dt.   u <= d / dt; with an acceleration limit u <= −B dt + √((B dt)² + 2 B d)

    beside the velocity and acceleration limits. It can then brake with B or stop within the tick, and the same holds
    at the next tick, so the interval is never empty. Whether motors can give B is the matter of
    :class:`~wbc.stack.stopping.Stopping`. States that can keep their limits are those with
    d >= u² / 2B + u dt / 2 at the level of accelerations, d >= u² / 2B at that of velocities.

    Outside (noise, a push, limits that shrank) the bounds ask for the way back and are still an interval: back inside
    within the tick if that can be, else as fast as the velocity limit (1 where there is none), B, and braking before
    the opposite limit allow. A bound on acceleration thus never asks for more than B. This is the recovery mode:
    ``recovering`` is then true, and ``recovery`` says which joint is outside by how much.

    With jerk limits the interval of accelerations is narrowed to what keeps them too, from the acceleration
    commanded last, which is ``remember``-ed; see :class:`~wbc.stack.jerk.JerkLimits`.

    With velocity limits alone the acceleration bounds are (±v_max − v) / dt as long as |v| <= v_max.

    Raises:
        InvalidInput: two laws that leave a joint nothing, by joint name; velocity or acceleration bounds without 0.

    Source: Del Prete, IEEE RA-L 2018 (viability in continuous time; here stopping within a tick needs no reversal).

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks import JointVelocityLimits
        >>> from wbc.stack.interval import JointIntervals
        >>> robot = wbc.load("arm")
        >>> intervals = JointIntervals.compose([JointVelocityLimits(2.0)], robot, dt=0.01)
        >>> lower, upper = np.empty(robot.nj), np.empty(robot.nj)
        >>> intervals.acceleration(np.zeros(robot.nj), np.full(robot.nj, 1.5), lower, upper)
        >>> lower[0].round(6), upper[0].round(6)
        (np.float64(-350.0), np.float64(50.0))
    """

    # Arrays hold both sides, one behind the other: the upper limit, and the lower one seen in a mirror, so that one
    # formula does for both: limit − value >= 0 on either. Their memory never moves: compiled code reads it too.

    def __init__(self, joint_names: tuple[str, ...], dt: float, *, braking: float | None = None) -> None:
        self.dt = checks.number("dt", dt, low=0.0, strict=True)
        self.joint_names = joint_names
        self._braking = braking
        shape = (2, len(joint_names))
        self._limits = {quantity: np.full(shape, np.inf) for quantity in _QUANTITIES}
        self._composed = {quantity: limit.copy() for quantity, limit in self._limits.items()}
        self._owners = dict.fromkeys(_QUANTITIES, "joint limits")
        self._per_dt, self._two_per_dt, self._half_dt = 1.0 / self.dt, 2.0 / self.dt, 0.5 * self.dt
        self._constants = {name: np.zeros(2 * shape[1]) for name in _CONSTANTS}
        self._work = {name: np.zeros(2 * shape[1]) for name in _WORK}
        self._zero, self._per_dt_each = np.zeros(2 * shape[1]), np.full(2 * shape[1], 1.0 / self.dt)
        self._q, self._v, self._a, self._minus_B, self._two_B, self._B_dt, self._B_dt_squared, self._return_speed = (
            self._constants.values()
        )
        self._value, self._room, self._reach, self._wanted, self._free, self._bound = self._work.values()
        nj = shape[1]
        self._plain, self._mirrored = self._value[:nj], self._value[nj:]
        self._room_below = self._room[nj:]
        self._bound_above, self._bound_below = self._bound[:nj], self._bound[nj:]
        self._wanted_above, self._wanted_below = self._wanted[:nj], self._wanted[nj:]
        self._back, self._room_before, self._value_now = np.zeros(2 * nj), np.zeros(shape), np.zeros(shape)
        self._opposite_back = self._back.reshape(shape)[::-1]
        # Whether only velocities are limited, whether accelerations are, whether a joint is outside (1) or none is near
        # a position limit (−1), whether jerks are limited.
        self._flags = np.zeros(4, dtype=np.int64)
        self._jerk: JerkLimits | None = None
        self._is_sealed = False
        self._derive()

    @property
    def recovering(self) -> bool:
        """Whether a joint was outside its position limits when bounds were computed last."""
        return self._flags.item(2) > 0

    def memory(self) -> tuple[Any, ...]:
        """Flags, constants and work of the formulas, for compiled code."""
        return (self._flags, *self._constants.values(), *self._work.values())

    @classmethod
    def compose(cls, laws: Iterable[JointInterval], model: RobotModel, dt: float) -> Self:
        """The intervals of laws on positions, velocities, accelerations and jerks; laws on one quantity intersect."""
        laws = list(laws)
        asked = [law.braking for law in laws if law.braking is not None]
        intervals = cls(model.joint_names, dt, braking=min(asked, default=None))
        for law in laws:
            lower, upper = law.bounds(model)
            limit = intervals._limits[law.quantity]
            np.minimum(limit, (upper, -lower), out=limit)
            intervals._check(law.quantity, law.name)
            intervals._owners[law.quantity] = law.name
        intervals._composed = {quantity: limit.copy() for quantity, limit in intervals._limits.items()}
        intervals._derive()
        return intervals

    def seal(self) -> None:
        """From now on only a plan replaces bounds: others narrow them by ``wbc.Overrides``."""
        self._is_sealed = True

    def replace(self, quantity: str, lower: Any, upper: Any, *, by_plan: bool = False) -> None:
        """New bounds on ``quantity``, scalar or (nj,), from the next tick on, until ``reset``.

        Raises:
            InvalidInput: no such quantity, NaN, lower > upper, or no 0 in bounds on velocity or acceleration; the
                intervals of a plan.
        """
        if self._is_sealed and not by_plan:
            raise InvalidInput(f"a plan's bounds on {quantity} are to be read; return wbc.Overrides({quantity}=...)")
        if quantity not in _QUANTITIES:
            raise InvalidInput(f"there are no bounds on {quantity!r}; there are: {', '.join(_QUANTITIES)}")
        nj, former = len(self.joint_names), self._limits[quantity].copy()
        for side, (name, value) in enumerate((("upper", upper), ("lower", lower))):
            bound = checks.each(f"{quantity}.{name}", value, nj, finite=False)
            self._limits[quantity][side] = -bound if side else bound
        try:
            self._check(quantity, "replace")
        except InvalidInput:
            self._limits[quantity][:] = former
            raise
        self._derive()

    def bounds(self, quantity: str) -> tuple[Vec, Vec]:
        """Lower and upper bound (nj,) on ``quantity`` as they are now, copies.

        Raises:
            InvalidInput: no such quantity.
        """
        if quantity not in _QUANTITIES:
            raise InvalidInput(f"there are no bounds on {quantity!r}; there are: {', '.join(_QUANTITIES)}")
        upper, lower = self._limits[quantity].copy()
        return -lower, upper

    def reset(self) -> None:
        """Back to the bounds of the laws; the last acceleration is zero again."""
        for quantity, limit in self._composed.items():
            self._limits[quantity][:] = limit
        self._jerk = None
        self._derive()

    @property
    def remembers(self) -> bool:
        """Whether bounds depend on the acceleration commanded last."""
        return self._jerk is not None

    def remember(self, acceleration: Vec) -> None:
        """The joint accelerations (nj,) that were commanded for the tick that ends now."""
        if self._jerk is not None:
            self._jerk.last[:] = acceleration

    def recovery(self, q: Vec) -> str:
        """Which joint is furthest outside its position limits, and by how much; or nothing."""
        upper, mirrored = self._limits["position"]
        beyond = np.maximum(q - upper, -q - mirrored)
        worst = int(np.argmax(beyond))
        if not beyond[worst] > _ROUNDING:
            return ""
        return f"recovery: joint {self.joint_names[worst]!r} is {beyond[worst]:.3g} outside its position limits"

    def _check(self, quantity: str, who: str) -> None:
        upper, lower = self._limits[quantity][0], -self._limits[quantity][1]
        for joint, low, high in zip(self.joint_names, lower, upper, strict=True):
            if not low <= high:
                raise InvalidInput(f"{who}: joint {joint!r} is left no {quantity}: lower {low:g} > upper {high:g}")
            if quantity != "position" and not low <= 0.0 <= high:
                raise InvalidInput(f"{who}: joint {joint!r} must be allowed a {quantity} of 0, not [{low:g}, {high:g}]")

    def owner(self, joint: int, *, upper: bool) -> str:
        """Which law gave a bound that was computed last, for reports."""
        if self._only_velocity or self._flags[2] < 0:
            return self._owners["velocity"]
        at = joint if upper else joint + len(self.joint_names)
        if self._narrowed.reshape(-1)[at]:
            return self._owners["jerk"]
        if self._has_acceleration and self._bound[at] < self._free[at]:
            return self._owners["acceleration"]
        limited = self._wanted[at] == self._v[at]
        return self._owners["velocity" if limited else "position"]

    @property
    def braking(self) -> Vec:
        """Deceleration (nj,) that each joint can count on in both directions [rad/s², m/s²]."""
        return np.asarray(-self._minus_B.reshape(2, -1).max(axis=0))

    def nearest(self, q: Vec) -> Vec:
        """Distance (nj,) of each joint to the nearer of its position limits."""
        up, down = self._limits["position"]
        distance: Vec = np.minimum(up - q, down + q)
        return distance

    def ahead(self, q: Vec, v: Vec) -> tuple[Vec, Vec]:
        """Of each joint (nj,) the deceleration counted on towards the position limit ahead, and the distance to it.

        A joint at rest has the farther of its limits ahead.
        """
        (up, down), (above, below) = self._limits["position"], self._minus_B.reshape(2, -1)
        up, down = up - q, down + q
        distance = np.where(v > 0.0, up, np.where(v < 0.0, down, np.maximum(up, down)))
        return np.where(v > 0.0, -above, -below), distance

    def _derive(self) -> None:
        """All constants of the formulas."""
        dt = self.dt
        q, v, a, jerk = (self._limits[quantity] for quantity in _QUANTITIES)
        # Towards one limit a joint brakes with the acceleration it has towards the other.
        opposite = a[::-1]
        unlimited = ~np.isfinite(opposite)
        self._has_acceleration = not unlimited.all()
        self._only_velocity = not (self._has_acceleration or np.isfinite(q).any() or np.isfinite(jerk).any())
        self._flags[:2] = self._only_velocity, self._has_acceleration
        B = np.where(unlimited, BRAKING, opposite) if self._braking is None else opposite
        B = np.minimum(B, np.inf if self._braking is None else self._braking)
        # No limit to brake for times no brakes is still no bound: inf · tiny = inf, where inf · 0 is NaN.
        two_B, return_speed = np.maximum(2.0 * B, np.finfo(float).tiny), np.where(np.isfinite(v), v, RETURN_SPEED)
        constants = (q, v, a, -B, two_B, B * dt, (B * dt) ** 2, return_speed)
        for constant, values in zip(self._constants.values(), constants, strict=True):
            constant[:] = values.reshape(-1)
        self._unlimited, self._faster = unlimited.reshape(-1), (a * dt).reshape(-1)
        self._slower = np.where(unlimited, np.inf, B * dt).reshape(-1)
        self._highest_v_per_dt, self._lowest_v_per_dt = v[0] / dt, -v[1] / dt
        # Positions and velocities alone: beyond these positions a limit is nearer than a tick at full speed.
        self._is_simple = not (self._has_acceleration or np.isfinite(jerk).any()) and bool(np.isfinite(v).all())
        if self._is_simple:
            self._clear = (q - v * dt).reshape(-1)
        self._fastest_above, self._fastest_below = v[0].copy(), -v[1]
        self._least_above, self._most_below = -B[0], B[1]
        self._surely_slow = float(v.min()) ** 2
        self._narrowed = np.zeros(B.shape, dtype=bool)
        if not np.isfinite(jerk).any():
            self._jerk = None
        else:
            self._jerk = self._jerk or JerkLimits(len(self.joint_names))
            self._jerk.derive(jerk, B, v, a, dt)
        self._flags[3] = self._jerk is not None

    def acceleration(self, q: Vec, v: Vec, lower: Vec, upper: Vec) -> None:
        """Write bounds (nj,) on the joint accelerations of the next tick, from positions q and velocities v (nj,).

        All are one piece of memory each, of float64: BLAS writes into a copy of anything else.
        """
        if self._only_velocity:
            self._acceleration_by_velocity(v, lower, upper)
            return
        np.multiply(v, self._half_dt, self._plain)
        self._plain += q
        np.negative(self._plain, self._mirrored)
        np.subtract(self._q, self._value, self._room)
        if self._jerk is not None:
            self._room_before[:] = self._room.reshape(2, -1)
        self._speed_that_can_brake()
        self._velocity_wanted(self._two_per_dt)
        self._plain[:] = v
        np.negative(v, self._mirrored)
        np.subtract(self._wanted, self._value, self._free)
        self._free *= self._per_dt_each
        np.maximum(self._free, self._minus_B, out=self._free)
        np.minimum(self._free, self._a, out=self._bound)
        upper[:] = self._bound_above
        np.negative(self._bound_below, lower)
        if self._jerk is not None:
            self._jerk.narrow(self._room_before, self._value.reshape(2, -1), lower, upper)
            self._note_narrowed(lower, upper)

    def _acceleration_by_velocity(self, v: Vec, lower: Vec, upper: Vec) -> None:
        """The same where nothing but velocities is limited."""
        dcopy(self._highest_v_per_dt, upper)
        dcopy(self._lowest_v_per_dt, lower)
        daxpy(v, upper, len(v), -self._per_dt)
        daxpy(v, lower, len(v), -self._per_dt)
        if not ddot(v, v) <= self._surely_slow:  # a joint may be too fast to be slow enough at once
            np.maximum(upper, self._least_above, out=upper)
            np.minimum(lower, self._most_below, out=lower)

    def velocity(self, q: Vec, v: Vec, lower: Vec, upper: Vec) -> None:
        """Write bounds (nj,) on the joint velocities of the next tick, one piece of memory each as for accelerations;
        v is read with acceleration limits only."""
        if self._is_simple:
            room = self._room
            dcopy(self._clear, room)
            daxpy(q, room, len(q), -1.0)
            daxpy(q, self._room_below)
            if room.item(room.argmin()) >= 0.0:
                dcopy(self._fastest_above, upper)
                dcopy(self._fastest_below, lower)
                self._flags[2] = -1
                return
        self._plain[:] = q
        np.negative(q, self._mirrored)
        np.subtract(self._q, self._value, self._room)
        if self._jerk is not None:
            self._room_before[:] = self._room.reshape(2, -1)
        if not self._has_acceleration:
            np.multiply(self._room, self._per_dt_each, self._reach)
            self._velocity_wanted(self._per_dt)
            above, below = self._wanted_above, self._wanted_below
        else:
            self._speed_that_can_brake()
            np.multiply(self._room, self._per_dt, out=self._reach, where=self._unlimited)
            self._velocity_wanted(self._per_dt)
            self._plain[:] = v
            np.negative(v, self._mirrored)
            np.subtract(self._value, self._slower, self._free)
            np.maximum(self._free, self._wanted, out=self._free)
            self._value += self._faster
            np.minimum(self._free, self._value, out=self._bound)
            above, below = self._bound_above, self._bound_below
        upper[:] = above
        np.negative(below, lower)
        if self._jerk is not None:
            np.copyto(self._bound_above, upper)
            np.negative(lower, self._bound_below)
            self._velocity_by_jerk(v, lower, upper)

    def _velocity_by_jerk(self, v: Vec, lower: Vec, upper: Vec) -> None:
        """The same bounds seen as accelerations of the tick, narrowed there."""
        assert self._jerk is not None
        value = self._value_now
        value[0] = v
        np.negative(v, value[1])
        for bound in (lower, upper):
            bound -= v
            bound *= self._per_dt
        self._jerk.narrow(self._room_before, value, lower, upper)
        for bound in (lower, upper):
            bound *= self.dt
            bound += v
        self._note_narrowed(lower, upper)

    def _note_narrowed(self, lower: Vec, upper: Vec) -> None:
        np.less(upper, self._bound_above, out=self._narrowed[0])
        np.greater(lower, -self._bound_below, out=self._narrowed[1])

    def _speed_that_can_brake(self) -> None:
        """reach = −B dt + √((B dt)² + 2 B room), 0 where there is no room."""
        reach = self._reach
        np.maximum(self._room, self._zero, out=reach)
        reach *= self._two_B
        reach += self._B_dt_squared
        np.sqrt(reach, reach)
        reach -= self._B_dt

    def _velocity_wanted(self, per_time: float) -> None:
        """Inside, the speed the limits leave; outside, the way back: at once, or as fast as the other side allows."""
        room, reach, back = self._room, self._reach, self._back
        outside = room[room.argmin()] < 0.0
        self._flags[2] = outside
        if not outside:
            np.minimum(reach, self._v, out=self._wanted)
            return
        np.maximum(reach, self._zero, out=reach)
        np.minimum(reach, self._v, out=reach)
        np.minimum(reach, self._return_speed, out=back)
        np.negative(back, back)
        np.minimum(room, self._zero, out=room)
        room *= per_time
        np.maximum(room.reshape(2, -1), self._opposite_back, out=room.reshape(2, -1))
        np.add(reach, room, self._wanted)
