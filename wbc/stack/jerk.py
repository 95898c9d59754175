"""JerkLimits: each joint's limits are approached so that its acceleration never has to jump."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.types import Vec

#: Share of the jerk that the approach to a bound on velocity may use; the bound itself, which falls while a position
#: limit comes nearer, uses less than a sixth of the rest.
_SHARE = 0.5


@final
class JerkLimits:
    """Bounds on accelerations that change by no more than j dt from one tick to the next.

    The velocity u towards a limit is bounded as without jerk, but with room for the time B/j that braking takes to set
    in: u <= w(s) = −B T + √((B T)² + 2 B s), T = dt + B/j. Along that bound the acceleration −u B / (w + B T) ends at
    zero and changes by 0.15 j at most. It is approached as a position is, one derivative higher: with the room
    r = min(w, v_max) − u left, and j' = j / 2,

        a <= ẇ − j' dt + √((j' dt)² + 2 j' r)         and         |a − a_last| <= j dt.

    Position, velocity and acceleration come first: where the last acceleration, or a state from outside, leaves no way
    to keep both, the limit on jerk is relaxed. From rest it never does. Arrays (2, nj) as in
    :class:`~wbc.stack.interval.JointIntervals`, whose bounds these narrow and never cross.
    """

    def __init__(self, nj: int) -> None:
        self.last = np.zeros(nj)
        shape = (2, nj)
        self._reach, self._slope, self._room, self._soft, self._window = (np.zeros(shape) for _ in range(5))

    def derive(self, jerk: Vec, braking: Vec, velocity: Vec, acceleration: Vec, dt: float) -> None:
        """Read the limits (2, nj), the upper ones and the lower ones mirrored."""
        self._dt, self._v, self._a, self._minus_B = dt, velocity, acceleration, -braking
        self._free = ~np.isfinite(jerk)
        j = np.where(self._free, 1.0, jerk)
        # Upwards towards a limit a joint brakes with the jerk that it has downwards.
        least = np.maximum(np.minimum(j, j[::-1]), np.finfo(float).tiny)
        delay = braking * (dt + braking / least)
        self._B, self._two_B, self._delay, self._delay_squared = braking, 2.0 * braking, delay, delay**2
        share = _SHARE * least
        self._share_dt, self._share_dt_squared, self._two_share = share * dt, (share * dt) ** 2, 2.0 * share
        self._window_up = np.where(self._free, np.inf, jerk)[0] * dt
        self._window_down = np.where(self._free, np.inf, jerk)[1] * dt

    def narrow(self, room: Vec, towards: Vec, lower: Vec, upper: Vec) -> None:
        """Narrow ``lower`` and ``upper`` (nj,) [rad/s², m/s²], which hold without jerk limits.

        ``room`` (2, nj): distance to either position limit that braking within the tick leaves; ``towards`` (2, nj):
        the velocity towards it.
        """
        reach, slope, left, soft = self._reach, self._slope, self._room, self._soft
        np.maximum(room, 0.0, out=reach)
        reach *= self._two_B
        reach += self._delay_squared
        np.sqrt(reach, reach)  # w + B T
        np.maximum(towards, 0.0, out=slope)
        slope *= self._B
        slope /= np.maximum(reach, np.finfo(float).tiny)
        reach -= self._delay
        slope[reach >= self._v] = 0.0
        np.minimum(reach, self._v, out=reach)
        np.subtract(reach, towards, out=left)
        np.maximum(left, 0.0, out=soft)
        soft *= self._two_share
        soft += self._share_dt_squared
        np.sqrt(soft, soft)
        soft -= self._share_dt
        # Beyond the bound on velocity: back to it within the tick.
        np.minimum(left, 0.0, out=left)
        left /= self._dt
        soft += left
        soft -= slope
        np.maximum(soft, self._minus_B, out=soft)
        np.minimum(soft, self._a, out=soft)
        soft[self._free] = np.inf
        self._clip(soft[0], -soft[1], lower, upper)

    def _clip(self, above: Vec, below: Vec, lower: Vec, upper: Vec) -> None:
        """The wanted interval [below, above], inside what jerk allows, inside what the other limits allow."""
        least, most = self._window
        np.subtract(self.last, self._window_down, least)
        np.add(self.last, self._window_up, most)
        # From outside both sides may ask for the way back at once.
        below, above = np.minimum(below, above), np.maximum(below, above)
        for side in (below, above):
            np.maximum(side, least, out=side)
            np.minimum(side, most, out=side)
            np.maximum(side, lower, out=side)
            np.minimum(side, upper, out=side)
        lower[:], upper[:] = below, above
