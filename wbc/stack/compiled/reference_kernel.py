"""Motions of the library that targets follow: value, rate and acceleration at the time of the tick."""

from __future__ import annotations

from math import cos, sin

from wbc.compiled import carray, copy, floats, kernel
from wbc.stack.compiled.geometry import turn_by
from wbc.stack.kernel_rows import PIECEWISE, POSE, SAMPLES, SINUSOID
from wbc.types import Index, Vec


@kernel
def sinusoid(t: float, n: int, numbers: Vec, value: Vec, rate: Vec, second: Vec) -> None:
    """c + r A sin(ω t + φ); ``numbers``: ramp, c, A, ω, φ (n,) each."""
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
        value[i] = numbers[1 + i] + amplitude * (r * sine)
        rate[i] = amplitude * (dr * sine + r * cosine)
        second[i] = amplitude * ((ddr - r * omega * omega) * sine + 2.0 * dr * cosine)


@kernel
def minimum_jerk(t: float, n: int, numbers: Vec, value: Vec, rate: Vec, second: Vec) -> None:
    """A quintic, and uniform motion around it; ``numbers``: duration, start time, six coefficients, value and rate at
    the start and at the end, (n,) each."""
    T, late = numbers[0], t - numbers[1]
    inside = 0.0 < late < T
    s, since = late / T, late if late <= 0.0 else late - T
    for i in range(n):
        if not inside:
            ends = 2 + (6 if late <= 0.0 else 8) * n + i
            value[i] = numbers[ends] + since * numbers[ends + n]
            rate[i], second[i] = numbers[ends + n], 0.0
            continue
        x, dx, ddx = 0.0, 0.0, 0.0
        for k in range(5, -1, -1):  # Horner's scheme for the polynomial and its derivatives
            ddx = ddx * s + 2.0 * dx
            dx = dx * s + x
            x = x * s + numbers[2 + k * n + i]
        value[i], rate[i], second[i] = x, dx / T, ddx / T**2


@kernel
def pose(t: float, numbers: Vec, value: Vec, rate: Vec, second: Vec) -> None:
    """A straight line and the shortest turn; ``numbers``: duration, start time, lift, position at the start, the way
    from there (6), linear before angular, rotation at the start by rows. ``value`` is a rotation and a position."""
    T, late = numbers[0], t - numbers[1]
    s = min(max(late / T, 0.0), 1.0)
    rest = 1.0 - s
    r = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    dr, ddr = 30.0 * (s * rest) ** 2 / T, 60.0 * s * rest * (rest - s) / T**2
    for i in range(6):
        rate[i], second[i] = dr * numbers[6 + i], ddr * numbers[6 + i]
    lift = 64.0 * numbers[2]
    rate[2] += lift * 3.0 * (s * rest) ** 2 * (rest - s) / T
    second[2] += lift * 6.0 * s * rest * ((rest - s) ** 2 - s * rest) / T**2
    turn_by(r, numbers[9:12], numbers[12:21], value[:9])
    for i in range(3):
        value[9 + i] = numbers[3 + i] + r * numbers[6 + i]
    value[11] += lift * (s * rest) ** 3


@kernel
def sample(t: float, n: int, at: int, value: Vec, rate: int, second: int) -> None:
    """The sample of the time nearest to t; numbers at ``at``: samples per second, how many, size of a rate, whether
    there are rates, then the samples, of each its value, rate and acceleration. ``rate`` and ``second`` are addresses.
    """
    head = carray(floats(at), 4)
    count, width, has_rates = int(head[1]), int(head[2]), head[3] > 0.0
    k = int(min(max(t * head[0] + 0.5, 0.0), count - 1.0))
    size = n + 2 * width if has_rates else n
    found = carray(floats(at), 4 + count * size)[4 + k * size : 4 + (k + 1) * size]
    copy(found, value[:n])
    speed, more = carray(floats(rate), width), carray(floats(second), width)
    for i in range(width):
        speed[i] = found[n + i] if has_rates else 0.0
        more[i] = found[n + width + i] if has_rates else 0.0


@kernel
def refer(references: Index, t: float) -> None:
    """Write every reference: of each its kind, size, addresses of numbers, value, rate and acceleration.

    Of motions one after another the numbers are how many there are, when each starts, its kind, where its numbers are,
    and these.
    """
    for k in range(len(references)):
        kind, n = references[k, 0], references[k, 1]
        at = references[k, 2]
        while kind == PIECEWISE:
            pieces = int(carray(floats(at), 1)[0])
            table = carray(floats(at), 1 + 3 * pieces)
            i = pieces - 1
            while i > 0 and t < table[1 + i]:
                i -= 1
            kind, at = int(table[1 + pieces + i]), at + 8 * int(table[1 + 2 * pieces + i])
        value = carray(floats(references[k, 3]), n)
        if kind == SAMPLES:
            sample(t, n, at, value, references[k, 4], references[k, 5])
            continue
        numbers = carray(floats(at), max(2 + 10 * n, 21))
        width = 6 if kind == POSE else n
        rate, second = carray(floats(references[k, 4]), width), carray(floats(references[k, 5]), width)
        if kind == SINUSOID:
            sinusoid(t, n, numbers, value, rate, second)
        elif kind == POSE:
            pose(t, numbers, value, rate, second)
        else:
            minimum_jerk(t, n, numbers, value, rate, second)
