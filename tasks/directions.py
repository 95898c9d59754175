"""Directions seen from a frame: what axis alignment and gaze share, with exact first and second derivatives."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import FrameState, RobotState
from wbc.types import Mat, Vec

_NO_DRIFT = np.full(2, np.nan)
#: Straight behind no way round is shortest: a direction nearer to it than this [rad] counts as this far beside it.
_BEHIND = 0.01
_COS_BEHIND, _SIN_BEHIND = float(np.cos(_BEHIND)), float(np.sin(_BEHIND))
#: θ / sin θ = Σ 2ⁿ (n!)² / (2n + 1)! xⁿ with x = 1 − cos θ, for small x; its derivatives by cos θ follow.
_SERIES = np.polynomial.Polynomial(
    [1.0, 1 / 3, 2 / 15, 2 / 35, 8 / 315, 8 / 693, 16 / 3003, 16 / 6435, 128 / 109395, 128 / 230945]
)
_SERIES_1, _SERIES_2 = _SERIES.deriv(), _SERIES.deriv(2)


def unit_axis(name: str, value: Any) -> Vec:
    """``value`` (3,) scaled to length one.

    Raises:
        InvalidInput: another shape, not finite, or no direction at all.
    """
    axis = checks.array(name, value, (3,))
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise InvalidInput(f"{name} is {axis.tolist()}; a direction is not zero")
    return axis / length


def direction_target(name: str, value: Any, strict: bool) -> Vec:
    """Reader of directions (3,): of any length but zero, which is looked at when a target is assigned."""
    if strict:
        unit_axis(name, value)
    direction = np.asarray(value, dtype=np.float64)
    if direction.shape != (3,):
        raise InvalidInput(f"{name} must have shape (3,), not {direction.shape}")
    return direction


def view_axes(axis: Vec) -> Mat:
    """Rows b₁, b₂ and ``axis``, right-handed and orthonormal: the axes of somebody who looks along ``axis``."""
    across = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = across - (across @ axis) * axis
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first), axis])


class UnitMotion(NamedTuple):
    """A direction (3,), its rate and second rate, and the matrix (3, 3) that turns a velocity into its rate."""

    value: Vec
    rate: Vec
    second: Vec
    by_velocity: Mat


def unit_motion(x: Vec, rate: Vec, second: Vec, nearest: float) -> UnitMotion:
    """x / |x| and its derivatives, for x (3,) with rate ẋ and second rate ẍ; x / nearest where |x| < nearest.

    With u = x / r: u̇ = P ẋ / r, P = I − u uᵀ; ü = (ẍ − r̈ u − 2 ṙ u̇) / r, ṙ = u·ẋ, r̈ = u·ẍ + (|ẋ|² − ṙ²) / r.
    """
    r = float(np.sqrt(x @ x))
    if r < nearest:
        return UnitMotion(x / nearest, rate / nearest, second / nearest, np.eye(3) / nearest)
    u = x / r
    towards = (np.eye(3) - np.outer(u, u)) / r
    r_rate = u @ rate
    r_second = u @ second + (rate @ rate - r_rate**2) / r
    u_rate = (rate - r_rate * u) / r
    return UnitMotion(u, u_rate, (second - r_second * u - 2.0 * r_rate * u_rate) / r, towards)


class Bearing:
    """Where a direction lies for somebody who looks along an axis: two angles y (2,) [rad], |y| the angle between.

    u (3,) is the direction in the viewer's axes (rows b₁, b₂, axis), θ its angle to the axis: y = f u₁₂, f = θ / sin θ.
    ``towards`` (2, 3) = ∂y/∂u. They are smooth but for the direction straight behind, and zero straight ahead only.
    """

    __slots__ = ("_f1", "_f2", "_s", "towards", "y")

    def __init__(self, u: Vec) -> None:
        s, c = u[:2], float(u[2])
        if c < -_COS_BEHIND:
            length = float(np.sqrt(s @ s))
            s = _SIN_BEHIND * (s / length if length > 0.0 else np.array([1.0, 0.0]))
            c = -_COS_BEHIND
        f, self._f1, self._f2 = _angle_over_sine(c)
        self._s = s
        self.y = f * s
        self.towards = np.column_stack([f * np.eye(2), self._f1 * s])

    def curvature(self, rate: Vec) -> Vec:
        """ÿ − (∂y/∂u) ü (2,) when u changes at ``rate`` (3,), viewer's axes."""
        bent: Vec = rate[2] * (self._f2 * rate[2] * self._s + 2.0 * self._f1 * rate[:2])
        return bent


def _angle_over_sine(c: float) -> tuple[float, float, float]:
    """θ / sin θ for c = cos θ, and its first two derivatives by c: (1 − c²) f' = c f − 1, and once more."""
    x = 1.0 - c
    if x < 0.05:
        return float(_SERIES(x)), -float(_SERIES_1(x)), float(_SERIES_2(x))
    squared = 1.0 - c * c
    f = float(np.arccos(c)) / squared**0.5
    f1 = (c * f - 1.0) / squared
    return f, f1, (f + 3.0 * c * f1) / squared


class Sight(NamedTuple):
    """What a viewer sees of a direction: the rows that a task writes about it, (2,) each and J (2, nv)."""

    e: Vec
    J: Mat
    drift: Vec
    rate_ref: Vec
    acc_ref: Vec


def sight(
    state: RobotState, frame: FrameState, view: Mat, *, direction: UnitMotion, target: UnitMotion, J: Mat
) -> Sight:
    """The bearing y of a world direction u seen from a frame with the axes ``view`` (3, 3), as a task's rows: e = y.

    ``direction`` moves as target and robot make it move together, with a = 0; ``target`` as the target alone does, and
    ``J`` (3, nv) is what velocities of the robot add to u̇. Seen from a frame that turns with ω:

        u̇' = u̇ − ω × u          ü' = ü − ω̇ × u − 2 ω × u̇ + ω × (ω × u)

    Target and robot do not simply add up (ω × u̇), so ``drift`` holds what is common to both: ë = acc_ref − J a − drift.
    """
    to_view = np.dot(view, frame.rotation.T)
    bearing = Bearing(np.dot(to_view, direction.value))
    by_world = np.dot(bearing.towards, to_view)
    turn = frame.jacobian()[3:]
    rows = np.dot(by_world, np.dot(pinocchio.skew(-direction.value), turn) - J)
    rate_ref = np.dot(by_world, target.rate)
    if not state.drifts:
        return Sight(bearing.y, rows, _NO_DRIFT, rate_ref, _NO_DRIFT)
    spin = pinocchio.skew(np.dot(turn, state.v))
    seen = direction.rate - np.dot(spin, direction.value)
    second = direction.second - np.dot(pinocchio.skew(frame.angular_drift()), direction.value)
    second -= np.dot(spin, direction.rate + seen)
    acc_ref = np.dot(by_world, target.second) + bearing.curvature(np.dot(to_view, target.rate))
    together = np.dot(by_world, second) + bearing.curvature(np.dot(to_view, seen))
    return Sight(bearing.y, rows, acc_ref - together, rate_ref, acc_ref)
