"""JointIntervals: position, velocity, acceleration and jerk limits as one interval per joint, never empty."""

from __future__ import annotations

from collections.abc import Iterable
from typing import final

import numpy as np

from wbc import checks
from wbc.compiled import Memory
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.compiled.interval_kernel import bound_joints
from wbc.stack.constraint import JointInterval, bounds_of
from wbc.tolerances import MET, SAME
from wbc.types import Vec

#: Deceleration counted on where no acceleration limit says otherwise [rad/s², m/s²]: a joint at 2 rad/s stops within
#: 0.1 s and 0.1 rad, which drives of arms and legs can do with their load; small enough not to fight contacts.
BRAKING = 20.0
#: Speed of the way back into position limits, for joints without a velocity limit [rad/s, m/s].
RETURN_SPEED = 1.0
_QUANTITIES = ("position", "velocity", "acceleration", "jerk")


@final
class JointIntervals:
    """What a joint may do next so that all its limits hold now and can hold for ever after.

    Position limits need room to brake. With d the distance to a limit and B the deceleration counted on (the
    acceleration limit, at most ``braking`` of the constraint on positions; 20 where nothing is said), the velocity u
    towards the limit at the end of the tick is bounded by

    accelerations: q⁺ = q + v dt + ½ a dt², v⁺ = v + a dt.   u <= −B dt + √((B dt)² + 2 B s), s = d − ½ v dt,
                   u <= max(0.6 s / dt, 0.7 v)
    velocities:    q⁺ = q + v dt.   u <= d / dt; with an acceleration limit u <= −B dt + √((B dt)² + 2 B d)

    beside the velocity and acceleration limits. It can then brake with B or stop within the tick, and the same holds
    at the next tick, so the interval is never empty. With the first bound alone u falls from s / dt to zero within a
    tick near a limit, and in a plant with q⁺ = q + v⁺ dt the joint swings about it from tick to tick: the map from
    (d, u dt) to those of the next tick has the eigenvalue −1 there. With 0.6 s / dt it has −0.5 and 0.6. A joint that
    brakes along d = v² / 2D keeps the second bound, whatever its deceleration D is: for every x = v / D dt one of
    0.6 (x² − x) / 2 and 0.7 x is at least x − 1.
    Whether motors can give B is the matter of :class:`~wbc.stack.stopping.Stopping`. States that can keep their limits
    are those with d >= u² / 2B + u dt / 2 at the level of accelerations, d >= u² / 2B at that of velocities.

    Outside (noise, a push, limits that shrank) the bounds ask for the way back and are still an interval: u <= d / dt,
    or as fast as the velocity limit (1 where there is none), B, and braking before the opposite limit allow. A bound on
    acceleration thus never asks for more than B. With u <= 2 s / dt the joint would be back at the end of the tick, but
    with its speed reversed, and in a plant that accelerates by some per cent more than it is told it swings ever wider.
    This is the recovery mode: ``recovering`` is then true, and ``recovery`` says which joint is outside by how much.

    With jerk limits the interval of accelerations is narrowed to what keeps them too, from the acceleration
    commanded last, which is ``remember``-ed; see :mod:`wbc.stack.compiled.interval_kernel`. From rest an acceleration
    never has to jump; where the last one, or a state from outside, leaves no other way, the limit on jerk is relaxed.

    With velocity limits alone the acceleration bounds are (±v_max − v) / dt as long as |v| <= v_max.

    Raises:
        InvalidInput: two constraints that leave a joint nothing, by joint name; velocity or acceleration bounds without
        0.

    Source: Del Prete, IEEE RA-L 2018 (viability in continuous time; here stopping within a tick needs no reversal).

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks import JointVelocityLimits
        >>> from wbc.stack.interval import JointIntervals
        >>> robot = wbc.load("arm")
        >>> intervals = JointIntervals([JointVelocityLimits(2.0)], robot, dt=0.01)
        >>> lower, upper = np.empty(robot.nj), np.empty(robot.nj)
        >>> intervals.write(2, np.zeros(robot.nj), np.full(robot.nj, 1.5), lower, upper)
        >>> lower[0].round(6), upper[0].round(6)
        (np.float64(-350.0), np.float64(50.0))
    """

    # Arrays hold both sides, one behind the other: the upper limit, and the lower one seen in a mirror, so that one
    # formula does for both: limit − value >= 0 on either. Their memory never moves: the formulas are compiled.

    def __init__(self, constraints: Iterable[JointInterval], model: RobotModel, dt: float) -> None:
        """Of constraints on positions, velocities, accelerations and jerks; those on one quantity intersect."""
        constraints = list(constraints)
        self.dt = checks.number("dt", dt, low=0.0, strict=True)
        self.joint_names, self.joint_units = model.joint_names, model.joint_units
        self._braking = min((one.braking for one in constraints if one.braking is not None), default=None)
        shape = (2, model.nj)
        self._limits = {quantity: np.full(shape, np.inf) for quantity in (*_QUANTITIES, "torque")}
        nj = shape[1]
        # Constants of the compiled formulas and what these leave, a quantity in each row, in the order of the kernel.
        numbers = np.zeros((16, 2 * nj))
        self._constants, self._v, self._minus_B = numbers[:10], numbers[1], numbers[3]
        self._wanted, self._free, self._bound, self._narrowed = numbers[12:]
        # Whether only velocities are limited, whether accelerations are, whether a joint is outside, whether jerks are
        # limited; and the acceleration commanded last.
        self._flags, self._last = np.zeros(4, dtype=np.int64), np.zeros(nj)
        self._order, self._now = np.array([nj, 0], dtype=np.int64), np.zeros((4, nj))
        #: For compiled code.
        self.memory = self._flags, numbers, self._last, np.array([self.dt])
        self._memory = Memory(self._order, self._now, *self.memory)
        for constraint in constraints:
            lower, upper = bounds_of(constraint, model)
            limit = self._limits[constraint.quantity]
            np.minimum(limit, (upper, -lower), out=limit)
            refuse_bounds(model, constraint.name, constraint.quantity, -limit[1], limit[0])
        self._is_sealed = False
        self._derive()

    @property
    def recovering(self) -> bool:
        """Whether a joint was outside its position limits when bounds were computed last."""
        return self._flags.item(2) > 0

    def seal(self) -> None:
        """From now on only a plan replaces bounds: others narrow them by ``wbc.Overrides``."""
        self._is_sealed = True

    def replace(self, quantity: str, lower: Vec | float, upper: Vec | float, *, by_plan: bool = False) -> None:
        """New bounds on ``quantity``, scalar or (nj,), from the next tick on, as whoever gives them has checked them.

        Raises:
            InvalidInput: these are the intervals of a plan.
        """
        if self._is_sealed and not by_plan:
            raise InvalidInput(f"a plan's bounds on {quantity} are to be read; return wbc.Overrides({quantity}=...)")
        limits = self._limits[quantity]
        limits[0], limits[1] = upper, np.negative(lower)
        self._derive()

    def bounds(self, quantity: str) -> tuple[Vec, Vec]:
        """Lower and upper bound (nj,) on ``quantity`` as they are now, copies.

        Raises:
            InvalidInput: no such quantity.
        """
        checks.one_of("quantity", quantity, self._limits)
        upper, lower = self._limits[quantity].copy()
        return -lower, upper

    def remember(self, acceleration: Vec, *, accuracy: float = MET) -> str:
        """The joint accelerations (nj,) that were commanded for the tick that ends now.

        Returns which joint changed its own by most beyond its limit on jerk, or nothing; a difference of ``accuracy``
        [rad/s², m/s²] counts as none.
        """
        change, most = acceleration - self._last, self._limits["jerk"] * self.dt
        beyond = np.maximum(change - most[0], -change - most[1])
        self._last[:] = acceleration
        worst = int(beyond.argmax())
        if not beyond[worst] > accuracy:
            return ""
        jerk, limit = np.array([abs(change[worst]), most[int(change[worst] < 0.0), worst]]) / self.dt
        unit = f"{self.joint_units[worst]}/s³"
        return f"jerk: joint {self.joint_names[worst]!r} has {jerk:.4g} {unit}, beyond its limit of {limit:.4g} {unit}"

    def recovery(self, q: Vec) -> str:
        """Which joint is furthest outside its position limits, and by how much; or nothing."""
        beyond = -self.nearest(q)
        worst = int(np.argmax(beyond))
        if not beyond[worst] > SAME:
            return ""
        name, far = self.joint_names[worst], f"{beyond[worst]:.3g} {self.joint_units[worst]}"
        return f"recovery: joint {name!r} is {far} outside its position limits"

    def cause(self, joint: int, bound: float, *, upper: bool) -> str:
        """Limits on which quantity gave ``bound`` to a joint in the tick that was computed last, for reports.

        A bound that is nearer than the formulas' own leaves a way to rest within the position limits.
        """
        if self._only_velocity:
            return "velocity"
        at = joint if upper else joint + len(self.joint_names)
        if self._narrowed[at]:
            return "jerk"
        if (bound if upper else -bound) < self._bound[at]:
            return "position"
        if self._has_acceleration and self._bound[at] < self._free[at]:
            return "acceleration"
        return "velocity" if self._wanted[at] == self._v[at] else "position"

    @property
    def braking(self) -> Vec:
        """Deceleration (nj,) that each joint can count on in both directions [rad/s², m/s²]."""
        return np.asarray(-self._minus_B.reshape(2, -1).max(axis=0))

    def nearest(self, q: Vec) -> Vec:
        """Distance (nj,) of each joint to the nearer of its position limits."""
        up, down = self._limits["position"]
        distance: Vec = np.minimum(up - q, down + q)
        return distance

    def _derive(self) -> None:
        """All constants of the formulas."""
        dt = self.dt
        q, v, a, jerk = (self._limits[quantity] for quantity in _QUANTITIES)
        # Towards one limit a joint brakes with the acceleration it has towards the other.
        opposite = a[::-1]
        unlimited = ~np.isfinite(opposite)
        self._has_acceleration = not unlimited.all()
        self._only_velocity = not (self._has_acceleration or np.isfinite(q).any() or np.isfinite(jerk).any())
        #: Whether bounds depend on the acceleration commanded last.
        self.remembers = bool(np.isfinite(jerk).any())
        self._flags[[0, 1, 3]] = self._only_velocity, self._has_acceleration, self.remembers
        B = np.where(unlimited, BRAKING, opposite) if self._braking is None else opposite
        B = np.minimum(B, np.inf if self._braking is None else self._braking)
        # No limit to brake for times no brakes is still no bound: inf · tiny = inf, where inf · 0 is NaN.
        two_B, return_speed = np.maximum(2.0 * B, np.finfo(float).tiny), np.where(np.isfinite(v), v, RETURN_SPEED)
        constants = (q, v, a, -B, two_B, B * dt, (B * dt) ** 2, return_speed, a * dt, jerk)
        self._constants[:] = np.reshape(constants, self._constants.shape)
        self._narrowed[:] = 0.0
        if not self.remembers:
            self._last[:] = 0.0

    def write(self, order: int, q: Vec, v: Vec, lower: Vec, upper: Vec) -> None:
        """Write bounds (nj,) on the joint velocities (order 1) or accelerations (2) of the next tick, from positions q
        and velocities v (nj,). Bounds on velocities depend on v with acceleration limits only."""
        self._order[1], self._now[0][:], self._now[1][:] = order, q, v
        bound_joints(self._memory.address)
        lower[:], upper[:] = self._now[2], self._now[3]


def refuse_bounds(model: RobotModel, who: str, quantity: str, lower: Vec, upper: Vec, *, beside: str = "") -> None:
    """Refuse bounds (nj,) that leave a joint nothing, or on velocities, accelerations or jerks no rest.

    Raises:
        InvalidInput: by the name of ``who`` gives them and of the joint.
    """
    something = (lower <= upper) & (lower < np.inf) & (upper > -np.inf)
    rest = (lower <= 0.0) & (upper >= 0.0) | (quantity in ("position", "torque"))
    if (something & rest).all():
        return
    i = int((something & rest).argmin())
    joint, low, high = f"{who}: joint {model.joint_names[i]!r}", f"{lower[i]:g}", f"{upper[i]:g}"
    if something[i]:
        raise InvalidInput(f"{joint} must be allowed a {quantity} of 0, not [{low}, {high}]")
    raise InvalidInput(f"{joint} is left no {quantity}{beside}: lower {low}, upper {high}")
