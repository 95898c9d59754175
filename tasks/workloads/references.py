"""References of the workloads: ramped sinusoids with exact rates and accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.types import Vec

from ..trajectories import Samples


@final
@dataclass(frozen=True)
class Motion:
    """A path in space over the ticks of a run: position [m], rate [m/s] and acceleration [m/s²], (ticks, 3) each."""

    position: Vec
    rate: Vec
    acceleration: Vec

    def track(self, dt: float) -> Samples:
        """The target of a task that reads position, rate and acceleration."""
        return Samples(self.position, period=dt, rates=self.rate, accelerations=self.acceleration)

    def moved(self, offset: Vec) -> Motion:
        """The same motion elsewhere: ``offset`` (3,) or (ticks, 3) is added to the position, and only to it."""
        return Motion(self.position + offset, self.rate, self.acceleration)


def times(ticks: int, dt: float) -> Vec:
    """Time of each tick (ticks,) [s]: 0, dt, 2 dt, …"""
    return np.arange(ticks, dtype=np.float64) * dt


def ramp(t: Vec) -> tuple[Vec, Vec, Vec]:
    """From 0 at t = 0 to 1 at t = 1 s, at rest and without acceleration at both ends: 10 t³ − 15 t⁴ + 6 t⁵.

    Value, rate [1/s] and acceleration [1/s²], shaped like ``t``.
    """
    s = np.clip(t, 0.0, 1.0)
    # All three vanish at the ends as they should, so that clipping is enough for the derivatives too.
    value = s**3 * (10.0 + s * (6.0 * s - 15.0))
    rate = 30.0 * (s * (1.0 - s)) ** 2
    acceleration = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
    return value, rate, acceleration


def sway(
    t: Vec, amplitude: Sequence[float], frequency: Sequence[float], phase: Sequence[float] = (0.0, 0.0, 0.0)
) -> Motion:
    """amplitude · sin(2π frequency t + phase) on each axis, times the :func:`ramp`.

    ``amplitude`` [m], ``frequency`` [Hz] and ``phase`` [rad] of the axes x, y, z; times ``t`` (ticks,) [s].

    Example:
        >>> import numpy as np
        >>> from wbc.tasks.workloads.references import sway
        >>> motion = sway(np.array([0.0, 2.0]), [0.1, 0.0, 0.0], [0.125, 1.0, 1.0])
        >>> motion.position[:, 0].round(3).tolist()
        [0.0, 0.1]
    """
    omega = 2.0 * np.pi * np.asarray(frequency)
    angle = t[:, None] * omega + np.asarray(phase)
    wave = np.asarray(amplitude) * np.sin(angle)
    wave_rate = np.asarray(amplitude) * omega * np.cos(angle)
    wave_acceleration = -(omega**2) * wave
    r, r_rate, r_acceleration = (part[:, None] for part in ramp(t))
    return Motion(
        r * wave,
        r_rate * wave + r * wave_rate,
        r_acceleration * wave + 2.0 * r_rate * wave_rate + r * wave_acceleration,
    )


def step(t: Vec, time: float, offset: Sequence[float]) -> Vec:
    """``offset`` (3,) from ``time`` on, zero before: (ticks, 3)."""
    return np.where((t >= time)[:, None], np.asarray(offset, dtype=np.float64), 0.0)
