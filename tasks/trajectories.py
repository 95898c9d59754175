"""Reference motions: functions of time that give (value, rate, acceleration), to be used as a task's target."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from typing import Any, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.stack.kernel_rows import MINIMUM_JERK, POSE, SAMPLES, SINUSOID, KnownMotion
from wbc.stack.tracking import pose_target
from wbc.types import Vec

#: What a target may be: a function of time [s] giving a value, its rate and its acceleration.
Trajectory = Callable[[float], tuple[Any, Vec, Vec]]


@final
class Sinusoid(metaclass=TellsArguments):
    """c + r(t) A sin(2π f t + φ) per axis, with exact derivatives; r grows from 0 to 1 in ``ramp`` seconds, a quintic.

    center, amplitude [unit of the target], frequency [Hz] and phase [rad] are (dim,) or scalars. The ramp starts the
    motion from rest: value, rate and acceleration are continuous at t = 0 and t = ramp.

    Raises:
        InvalidInput: shapes that do not fit, NaN, a negative ramp.

    Example:
        >>> from wbc.tasks import Sinusoid
        >>> sway = Sinusoid([0.0, 0.0, 0.9], amplitude=[0.0, 0.05, 0.0], frequency=0.5)
        >>> value, rate, acceleration = sway(0.0)
        >>> value
        array([0. , 0. , 0.9])
    """

    __slots__ = ("_amplitude", "_center", "_omega", "_phase", "_ramp")

    def __init__(self, center: Any, *, amplitude: Any, frequency: Any, phase: Any = 0.0, ramp: float = 1.0) -> None:
        self._center = checks.array("Sinusoid.center", center, (None,))
        size = self._center.size

        def spread(name: str, value: Any) -> Vec:
            return checks.each(f"Sinusoid.{name}", value, size)

        self._amplitude = spread("amplitude", amplitude)
        self._omega = 2.0 * np.pi * spread("frequency", frequency)
        self._phase = spread("phase", phase)
        self._ramp = checks.number("Sinusoid.ramp", ramp, low=0.0)

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

    def known_motion(self) -> KnownMotion:
        """What a compiled tick evaluates instead of calling this."""
        parts = (self._center, self._amplitude, self._omega, self._phase)
        return KnownMotion(SINUSOID, self._center.size, np.concatenate([[self._ramp], *parts]))


@final
class MinimumJerk(metaclass=TellsArguments):
    """From ``start`` to ``end``, (dim,) each, in ``duration`` seconds from ``start_time`` on, with the least ∫ |x⃛|² dt.

    A quintic in s = (t − start_time) / duration, accelerations zero at both ends. ``start_rate`` and ``end_rate`` are
    (dim,) or scalars [unit/s]; before and after, the motion goes on uniformly at these rates (0: it rests). With both
    zero x = start + (10 s³ − 15 s⁴ + 6 s⁵) (end − start). Source: Flash, Hogan, J. Neuroscience 1985.

    Raises:
        InvalidInput: shapes that do not fit, NaN, a duration that is not positive.

    Example:
        >>> from wbc.tasks import MinimumJerk
        >>> shift = MinimumJerk([0.0, 0.0, 0.9], [0.0, 0.1, 0.9], duration=1.0, start_time=0.5)
        >>> value, rate, acceleration = shift(1.0)
        >>> value, rate.max().round(6)
        (array([0.  , 0.05, 0.9 ]), np.float64(0.1875))
    """

    __slots__ = ("_coefficients", "_duration", "_ends", "_start_time")

    def __init__(
        self, start: Any, end: Any, *, duration: float, start_time: float = 0.0, start_rate: Any = 0.0,
        end_rate: Any = 0.0,
    ) -> None:  # fmt: skip
        a = checks.array("start", start, (None,))
        b = checks.array("end", end, a.shape)
        self._duration = T = checks.number("duration", duration, low=0.0, strict=True)
        self._start_time = checks.number("start_time", start_time)
        u, w = (
            checks.array(name, np.full(a.shape, rate) if checks.ndim(rate) == 0 else rate, a.shape)
            for name, rate in (("start_rate", start_rate), ("end_rate", end_rate))
        )
        d, u_T, w_T = b - a, u * T, w * T
        zero = np.zeros_like(a)
        cubic, quartic, fifth = 10 * d - 6 * u_T - 4 * w_T, -15 * d + 8 * u_T + 7 * w_T, 6 * d - 3 * u_T - 3 * w_T
        self._coefficients = np.array([a, u_T, zero, cubic, quartic, fifth])
        self._ends = ((a, u), (b, w))

    def __call__(self, t: float) -> tuple[Vec, Vec, Vec]:
        """Value, rate and acceleration at time t [s]."""
        T, late = self._duration, t - self._start_time
        if not 0.0 < late < T:
            (value, rate), since = (self._ends[0], late) if late <= 0.0 else (self._ends[1], late - T)
            return value + since * rate, rate, np.zeros_like(rate)
        s = late / T
        s2, s3, s4 = s * s, s**3, s**4
        powers = np.array(
            [
                [1.0, s, s2, s3, s4, s3 * s2],
                [0.0, 1.0, 2 * s, 3 * s2, 4 * s3, 5 * s4],
                [0.0, 0.0, 2.0, 6 * s, 12 * s2, 20 * s3],
            ]
        )
        value, rate, acceleration = powers @ self._coefficients
        return value, rate / T, acceleration / T**2

    def known_motion(self) -> KnownMotion:
        """What a compiled tick evaluates instead of calling this."""
        parts = ([self._duration, self._start_time], *self._coefficients, *self._ends[0], *self._ends[1])
        return KnownMotion(MINIMUM_JERK, self._ends[0][0].size, np.concatenate(parts))


@final
class PoseInterpolation(metaclass=TellsArguments):
    """From one pose to another on a straight line and the shortest turn, both 10 s³ − 15 s⁴ + 6 s⁵ of the way.

    p = p₀ + r (p₁ − p₀),  R = exp(r w) R₀ with w = log(R₁ R₀ᵀ) and s = (t − start_time) / duration in [0, 1]. Rates and
    accelerations (6,) are in world axes, linear first: a target of ``Frame``. ``lift`` [m] raises the way by
    64 s³ (1 − s)³ lift along the world's z: a foot that swings.

    Raises:
        InvalidInput: not poses (pinocchio.SE3 or 4x4), a duration that is not positive.

    Example:
        >>> import numpy as np, pinocchio
        >>> from wbc.tasks import PoseInterpolation
        >>> ahead = pinocchio.SE3(np.eye(3), np.array([0.1, 0.0, 0.0]))
        >>> step = PoseInterpolation(pinocchio.SE3.Identity(), ahead, duration=1.0, lift=0.05)
        >>> step(0.5)[0].translation
        array([0.05, 0.  , 0.05])
    """

    __slots__ = ("_duration", "_lift", "_position", "_rotation", "_start_time", "_turn", "_way")

    def __init__(
        self, start: Any, end: Any, *, duration: float, start_time: float = 0.0, lift: float = 0.0
    ) -> None:  # fmt: skip
        (self._rotation, self._position), (rotation, position) = (
            (part.copy() for part in pose_target(name, pose, True)) for name, pose in (("start", start), ("end", end))
        )
        self._duration = checks.number("duration", duration, low=0.0, strict=True)
        self._start_time = checks.number("start_time", start_time)
        self._lift = checks.number("lift", lift)
        self._turn = pinocchio.log3(rotation @ self._rotation.T)
        self._way = np.concatenate([position - self._position, self._turn])

    def __call__(self, t: float) -> tuple[Any, Vec, Vec]:
        """Pose, twist and acceleration at time t [s]."""
        T, late = self._duration, t - self._start_time
        r, dr, ddr = quintic(late, T)
        position = self._position + r * self._way[:3]
        rate, acceleration = dr * self._way, ddr * self._way
        if self._lift and 0.0 < late < T:
            s = late / T
            rest = 1.0 - s
            lift = 64.0 * self._lift
            position[2] += lift * (s * rest) ** 3
            rate[2] += lift * 3.0 * (s * rest) ** 2 * (rest - s) / T
            acceleration[2] += lift * 6.0 * s * rest * ((rest - s) ** 2 - s * rest) / T**2
        return pinocchio.SE3(pinocchio.exp3(r * self._turn) @ self._rotation, position), rate, acceleration

    def known_motion(self) -> KnownMotion:
        """What a compiled tick evaluates instead of calling this."""
        times = [self._duration, self._start_time, self._lift]
        return KnownMotion(POSE, 12, np.concatenate([times, self._position, self._way, self._rotation.ravel()]))


@final
class Samples(metaclass=TellsArguments):
    """A motion that was recorded or computed before, a sample each ``period`` [s]: x(t) = x_k, k the integer nearest to
    t / period.

    The first sample holds before t = 0 and the last after the end. ``values`` are vectors (samples, dim), or poses
    (pinocchio.SE3 or 4x4), a target of ``Frame``. ``rates`` and ``accelerations`` (samples, dim), (samples, 6) of poses
    in world axes, linear first, come together or not at all. Nothing is interpolated: a motion that was sampled more
    slowly than the controller ticks is resampled before.

    Raises:
        InvalidInput: no sample, values that are no vectors or poses of one size, or not finite, rates of another shape,
            or without accelerations, a period that is not positive.

    Example:
        >>> from wbc.tasks import Samples
        >>> motion = Samples([[0.0], [0.1], [0.3]], period=0.01)
        >>> [float(motion(t)[0]) for t in (-1.0, 0.004, 0.006, 9.0)]
        [0.0, 0.0, 0.1, 0.3]
    """

    __slots__ = ("_has_rates", "_known", "_per_second", "_rates", "_values")

    def __init__(
        self, values: Sequence[Any] | Vec, *, period: float, rates: Any = None, accelerations: Any = None
    ) -> None:
        self._per_second = 1.0 / checks.number("period", period, low=0.0, strict=True)
        values = checks.items("values", values, "samples")
        if not values:
            raise InvalidInput("values is empty; there is at least one sample")
        self._values: list[Any]
        if isinstance(values[0], pinocchio.SE3) or checks.ndim(values[0]) == 2:
            parts = [pose_target(f"values[{k}]", pose, True) for k, pose in enumerate(values)]
            self._values = [pinocchio.SE3(rotation, position) for rotation, position in parts]
            table = np.array([np.concatenate([rotation.ravel(), position]) for rotation, position in parts])
            width = 6
        else:
            table = checks.array("values", values, (len(values), None))
            self._values, width = [*table], table.shape[1]
        self._has_rates = rates is not None
        if self._has_rates != (accelerations is not None):
            raise InvalidInput("rates and accelerations come together; where one is not known it is zero")
        shape = len(values), width
        given = [("rates", rates), ("accelerations", accelerations)] if self._has_rates else []
        self._rates = [checks.array(name, value, shape) for name, value in given]
        head = [self._per_second, len(values), width, self._has_rates]
        numbers = np.concatenate([head, np.hstack([table, *self._rates]).ravel()])
        self._known = KnownMotion(SAMPLES, table.shape[1], numbers)

    def __call__(self, t: float) -> Any:
        """The value, or value, rate and acceleration, at time t [s]."""
        k = int(min(max(t * self._per_second + 0.5, 0.0), len(self._values) - 1.0))
        return (self._values[k], *(rates[k] for rates in self._rates)) if self._has_rates else self._values[k]

    def known_motion(self) -> KnownMotion:
        """What a compiled tick evaluates instead of calling this."""
        return self._known


@final
class Piecewise(metaclass=TellsArguments):
    """One motion after another: at time t the last of ``pieces``, (start [s], trajectory) each, that has started.

    Before the first start, the first. Whether the pieces fit together is theirs to know.

    Raises:
        InvalidInput: no piece, starts that do not increase, motions of the library of several sizes.

    Example:
        >>> from wbc.tasks import MinimumJerk, Piecewise
        >>> there = MinimumJerk([0.0], [1.0], duration=1.0)
        >>> back = MinimumJerk([1.0], [0.0], duration=1.0, start_time=2.0)
        >>> [float(Piecewise([(0.0, there), (2.0, back)])(t)[0][0]) for t in (0.5, 1.5, 2.5)]
        [0.5, 1.0, 0.5]
    """

    __slots__ = ("_known", "_motions", "_starts")

    def __init__(self, pieces: Iterable[tuple[float, Trajectory]]) -> None:
        pieces = checks.pairs("pieces", pieces, "start, trajectory")
        if not pieces:
            raise InvalidInput("pieces is empty; there is at least one (start, trajectory)")
        self._starts = [checks.number(f"pieces[{i}] start", start) for i, (start, _) in enumerate(pieces)]
        for i, (before, after) in enumerate(zip(self._starts, self._starts[1:], strict=False), start=1):
            if not before < after:
                raise InvalidInput(f"pieces[{i}] starts at {after:g} s, not after pieces[{i - 1}] at {before:g} s")
        self._motions: list[Trajectory] = [motion for _, motion in pieces]
        self._known = KnownMotion.piecewise(self._starts, self._motions)

    def __call__(self, t: float) -> tuple[Any, Vec, Vec]:
        """What the piece of this time gives."""
        return self._motions[max(bisect_right(self._starts, t) - 1, 0)](t)

    def known_motion(self) -> KnownMotion | None:
        """What a compiled tick evaluates instead of calling this, where it knows all pieces."""
        return self._known


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
