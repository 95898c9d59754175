"""Reference motions: functions of time that give (value, rate, acceleration), to be used as a task's target."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc import checks
from wbc.types import Vec


@final
class Sinusoid:
    """c + r(t) A sin(2π f t + φ) per axis, with exact derivatives; r grows from 0 to 1 in ``ramp`` seconds, a quintic.

    center, amplitude [unit of the target], frequency [Hz] and phase [rad] are (dim,) or scalars. The ramp starts the
    motion from rest: value, rate and acceleration are continuous at t = 0 and t = ramp.

    Raises:
        InvalidInput: shapes that do not fit, NaN, a negative ramp.

    Example:
        >>> from tasks import Sinusoid
        >>> sway = Sinusoid([0.0, 0.0, 0.9], amplitude=[0.0, 0.05, 0.0], frequency=0.5)
        >>> value, rate, acceleration = sway(0.0)
        >>> value
        array([0. , 0. , 0.9])
    """

    __slots__ = ("_amplitude", "_center", "_omega", "_phase", "_ramp")

    def __init__(self, center: Any, *, amplitude: Any, frequency: Any, phase: Any = 0.0, ramp: float = 1.0) -> None:
        self._center = checks.array("center", center, (None,))
        size = (self._center.size,)

        def spread(name: str, value: Any) -> Vec:
            values = np.asarray(value, dtype=np.float64)
            return checks.array(name, np.full(size, values) if values.ndim == 0 else values, size)

        self._amplitude = spread("amplitude", amplitude)
        self._omega = 2.0 * np.pi * spread("frequency", frequency)
        self._phase = spread("phase", phase)
        self._ramp = checks.number("ramp", ramp, low=0.0)

    def __call__(self, t: float) -> tuple[Vec, Vec, Vec]:
        """Value, rate and acceleration at time t [s]."""
        r, dr, ddr = quintic(t, self._ramp)
        angle = self._omega * t + self._phase
        sine, cosine = np.sin(angle), self._omega * np.cos(angle)
        amplitude = self._amplitude
        return (
            self._center + amplitude * (r * sine),
            amplitude * (dr * sine + r * cosine),
            amplitude * ((ddr - r * self._omega**2) * sine + 2.0 * dr * cosine),
        )


def quintic(t: float, duration: float) -> tuple[float, float, float]:
    """10 s³ − 15 s⁴ + 6 s⁵ with s = t / duration held in [0, 1], and its two time derivatives."""
    if duration <= 0.0 or t >= duration:
        return 1.0, 0.0, 0.0
    if t <= 0.0:
        return 0.0, 0.0, 0.0
    s = t / duration
    return (
        s**3 * (10.0 - 15.0 * s + 6.0 * s * s),
        30.0 * s * s * (1.0 - s) ** 2 / duration,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / duration**2,
    )
