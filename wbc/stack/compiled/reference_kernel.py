"""Motions of the library that targets follow: value, rate and acceleration at the time of the tick."""

from __future__ import annotations

from math import cos, sin

from wbc.compiled import carray, floats, kernel
from wbc.types import Index, Vec

#: Kinds of references; NONE is written by Python, or stands still.
NONE, SINUSOID, MINIMUM_JERK = -1, 0, 1


@kernel
def sinusoid(t: float, n: int, step: int, numbers: Vec, value: Vec, rate: Vec, second: Vec) -> None:
    """c + r A sin(ω t + φ); ``numbers``: ramp, c, A, ω, φ (n,) each. ``value`` has it every ``step`` entries."""
    ramp, r, dr, ddr = numbers[0], 1.0, 0.0, 0.0
    if t < ramp and ramp > 0.0:
        s = max(t, 0.0) / ramp
        r = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        dr = 30.0 * s * s * (1.0 - s) ** 2 / ramp
        ddr = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / ramp**2
    for i in range(n):
        amplitude, omega = numbers[1 + n + i], numbers[1 + 2 * n + i]
        angle = omega * t + numbers[1 + 3 * n + i]
        sine, cosine = sin(angle), omega * cos(angle)
        value[i * step] = numbers[1 + i] + amplitude * (r * sine)
        rate[i] = amplitude * (dr * sine + r * cosine)
        second[i] = amplitude * ((ddr - r * omega * omega) * sine + 2.0 * dr * cosine)


@kernel
def minimum_jerk(t: float, n: int, step: int, numbers: Vec, value: Vec, rate: Vec, second: Vec) -> None:
    """A quintic, and uniform motion around it; ``numbers``: duration, start time, six coefficients, value and rate at
    the start and at the end, (n,) each."""
    T, late = numbers[0], t - numbers[1]
    inside = 0.0 < late < T
    s, since = late / T, late if late <= 0.0 else late - T
    for i in range(n):
        if not inside:
            ends = 2 + (6 if late <= 0.0 else 8) * n + i
            value[i * step] = numbers[ends] + since * numbers[ends + n]
            rate[i], second[i] = numbers[ends + n], 0.0
            continue
        x, dx, ddx = 0.0, 0.0, 0.0
        for k in range(5, -1, -1):  # Horner's scheme for the polynomial and its derivatives
            ddx = ddx * s + 2.0 * dx
            dx = dx * s + x
            x = x * s + numbers[2 + k * n + i]
        value[i * step], rate[i], second[i] = x, dx / T, ddx / T**2


@kernel
def refer(references: Index, t: float) -> None:
    """Write every reference: of each its kind, size, step, addresses of numbers, value, rate and acceleration."""
    for k in range(len(references)):
        kind, n, step = references[k, 0], references[k, 1], references[k, 2]
        if kind == NONE:
            continue
        numbers, value = carray(floats(references[k, 3]), 2 + 10 * n), carray(floats(references[k, 4]), n * step)
        rate, second = carray(floats(references[k, 5]), n), carray(floats(references[k, 6]), n)
        if kind == SINUSOID:
            sinusoid(t, n, step, numbers, value, rate, second)
        else:
            minimum_jerk(t, n, step, numbers, value, rate, second)
