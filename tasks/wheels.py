"""Where a wheel touches level ground and how that point moves: what rolling tasks share."""

from __future__ import annotations

from typing import Any, NamedTuple, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.models.model import RobotState
from wbc.types import Mat, Vec

from .directions import unit_axis

_NO_DRIFT = np.full(3, np.nan)
#: A wheel that lies nearly flat has no heading: the sine of its lean counts as at least this.
_LEAST_LEAN = 1e-3


class WheelMotion(NamedTuple):
    """Rows along the heading, across it and along the ground's normal: J (3, nv) of the velocity of the wheel's
    material point on the ground, its rate at a = 0 (3,), NaN in a state without drifts, and the point's height [m]."""

    J: Mat
    drift: Vec
    height: float


@final
class Wheel:
    """A disc of ``radius`` [m] about the origin of ``frame``, which turns with it about ``axle`` (3,).

    With a the axle in the world, n the ground's normal z, c = n·a and s = √(1 − c²): the point on the ground is
    p − radius m, m = (n − c a) / s; the heading is t = a × n / s, across it l = n × t.

    Raises:
        InvalidInput: a radius that is not positive, an axle that is zero.
    """

    __slots__ = ("axle", "frame", "radius")

    def __init__(self, name: str, frame: str, radius: float, axle: Any) -> None:
        self.frame = frame
        self.radius = checks.number(f"{name}.radius", radius, low=0.0, strict=True)
        self.axle = unit_axis(f"{name}.axle", axle)

    def motion(self, state: RobotState) -> WheelMotion:
        """How the wheel moves over the ground in this state."""
        frame = state.frame(self.frame)
        a, J = np.dot(frame.rotation, self.axle), frame.jacobian()
        n, c = np.array([0.0, 0.0, 1.0]), float(a[2])
        s = max(float(np.sqrt(1.0 - min(c * c, 1.0))), _LEAST_LEAN)
        m = (n - c * a) / s
        heading = np.array([a[1], -a[0], 0.0]) / s
        across = np.array([-heading[1], heading[0], 0.0])
        axes, arm = np.array([heading, across, n]), pinocchio.skew(self.radius * m)
        rows = J[:3] + np.dot(arm, J[3:])
        height = float(frame.position[2]) - self.radius * float(m[2])
        drift = _NO_DRIFT
        if state.drifts:
            twist, change = np.dot(J, state.v), frame.drift()
            spin = pinocchio.skew(twist[3:])
            a_rate = np.dot(spin, a)
            s_rate = -c * a_rate[2] / s
            m_rate = -(a_rate[2] * a + c * a_rate + s_rate * m) / s
            heading_rate = (np.array([a_rate[1], -a_rate[0], 0.0]) - s_rate * heading) / s
            across_rate = np.array([-heading_rate[1], heading_rate[0], 0.0])
            velocity = twist[:3] + np.dot(arm, twist[3:])
            acceleration = change[:3] + np.dot(arm, change[3:]) - self.radius * np.dot(spin, m_rate)
            drift = np.dot(axes, acceleration)
            drift[:2] += np.dot(heading_rate, velocity), np.dot(across_rate, velocity)
        return WheelMotion(np.dot(axes, rows), drift, height)
