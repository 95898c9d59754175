"""Random settings of a run: numbers from a range, one of several values, disturbances of random strength."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.sim.disturbance import Delay, Disturbance, Payload, Push, SensorNoise


@final
@dataclass(frozen=True)
class Range:
    """A number, every one from ``low`` to ``high`` equally likely; a whole one where ``whole``.

    Raises:
        InvalidInput: bounds that are not finite, or crossed.

    Example:
        >>> import numpy as np
        >>> from wbc.sweep import Range
        >>> 1.0 <= Range(1.0, 2.0).draw(np.random.default_rng(0)) <= 2.0
        True
    """

    low: float
    high: float
    whole: bool = False

    def __post_init__(self) -> None:
        checks.number("low", self.low)
        checks.number("high", self.high, low=self.low)

    def draw(self, rng: np.random.Generator) -> float | int:
        """One number."""
        if self.whole:
            return int(rng.integers(int(self.low), int(self.high), endpoint=True))
        return float(rng.uniform(self.low, self.high))

    def __str__(self) -> str:
        return f"{self.low:g}:{self.high:g}"


@final
@dataclass(frozen=True)
class Choice:
    """One of ``values``, all equally likely.

    Raises:
        InvalidInput: there is none.
    """

    values: tuple[Any, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise InvalidInput("a choice needs at least one value")

    def draw(self, rng: np.random.Generator) -> Any:
        """One value."""
        return self.values[int(rng.integers(len(self.values)))]

    def __str__(self) -> str:
        return ",".join(map(str, self.values))


Drawn = Range | Choice


def read_range(name: str, text: str) -> Range:
    """``LOW:HIGH``, or one number that is always drawn.

    Raises:
        InvalidInput: neither.
    """
    low, colon, high = text.partition(":")
    first = checks.typed(name, low)
    return Range(first, checks.typed(name, high, low=first) if colon else first)


class DrawnDisturbance(ABC):
    """Settings of a disturbance whose strength, and where it has them direction and time, are drawn in each run."""

    @abstractmethod
    def draw(self, rng: np.random.Generator, duration: float) -> Disturbance:
        """The disturbance of one run of ``duration`` seconds."""

    @abstractmethod
    def __str__(self) -> str:
        """In one line."""


#: A push lasts so long [s] and begins in this part of the run.
PUSH_TIME, PUSH_FROM, PUSH_UNTIL = 0.2, 0.1, 0.8


@final
@dataclass(frozen=True)
class RandomPush(DrawnDisturbance):
    """A level push of 0.2 s at ``frame``, any direction, force from ``force`` [N], between 10 and 80 % of the run."""

    frame: str
    force: Range

    def draw(self, rng: np.random.Generator, duration: float) -> Disturbance:
        force, angle = float(self.force.draw(rng)), rng.uniform(0.0, 2.0 * np.pi)
        start = float(rng.uniform(PUSH_FROM, PUSH_UNTIL) * duration)
        return Push(
            self.frame, force=(force * np.cos(angle), force * np.sin(angle), 0.0), start=start, duration=PUSH_TIME
        )

    def __str__(self) -> str:
        return f"push {self.frame}={self.force} N"


@final
@dataclass(frozen=True)
class RandomPayload(DrawnDisturbance):
    """A point mass from ``mass`` [kg] at ``frame``, of which the controller is not told."""

    frame: str
    mass: Range

    def draw(self, rng: np.random.Generator, duration: float) -> Disturbance:
        del duration
        return Payload(self.frame, mass=max(float(self.mass.draw(rng)), 1e-9))

    def __str__(self) -> str:
        return f"payload {self.frame}={self.mass} kg"


@final
@dataclass(frozen=True)
class RandomNoise(DrawnDisturbance):
    """White noise on measured joint velocities, standard deviation from ``velocity`` [rad/s], with a "
    "seed of its own."""

    velocity: Range

    def draw(self, rng: np.random.Generator, duration: float) -> Disturbance:
        del duration
        return SensorNoise(velocity=float(self.velocity.draw(rng)), seed=int(rng.integers(2**31)))

    def __str__(self) -> str:
        return f"noise {self.velocity} rad/s"


@final
@dataclass(frozen=True)
class RandomDelay(DrawnDisturbance):
    """Commands that arrive late by a time from ``seconds`` [s]."""

    seconds: Range

    def draw(self, rng: np.random.Generator, duration: float) -> Disturbance:
        del duration
        return Delay(float(self.seconds.draw(rng)))

    def __str__(self) -> str:
        return f"delay {self.seconds} s"


def at_frame(option: str, text: str) -> tuple[str, Range]:
    """``FRAME=LOW:HIGH``.

    Raises:
        InvalidInput: something else.
    """
    frame, equals, numbers = text.partition("=")
    if not equals or not frame:
        raise InvalidInput(f"{option} {text!r} must be FRAME=LOW:HIGH")
    return frame, read_range(f"{option} {frame}", numbers)


def axes(disturbances: Sequence[Disturbance]) -> dict[str, float]:
    """What was drawn of each disturbance, by name with unit.

    Example:
        >>> from wbc.sim.disturbance import Push
        >>> from wbc.sweep.draw import axes
        >>> axes([Push("base", force=(0.0, 30.0, 0.0), start=1.5, duration=0.2)])
        {'push at base [N]': 30.0, 'push at base, direction [°]': 90.0, 'push at base, start [s]': 1.5}
    """
    found: dict[str, float] = {}
    for k, one in enumerate(disturbances):
        match one:
            case Push():
                x, y, _ = one.force
                name, angle = f"push at {one.frame}", float(np.degrees(np.arctan2(y, x)))
                of = {
                    f"{name} [N]": float(np.hypot(x, y)),
                    f"{name}, direction [°]": angle,
                    f"{name}, start [s]": one.start,
                }
            case Payload():
                of = {f"payload at {one.frame} [kg]": one.mass}
            case SensorNoise():
                of = {"noise of joint velocities [rad/s]": one.velocity}
            case Delay():
                of = {"delay of commands [s]": one.seconds}
            case _:
                of = {}
        found |= {key if key not in found else f"{key}, disturbance {k + 1}": value for key, value in of.items()}
    return found


#: The classes that a file of results may name.
_KINDS = {kind.__name__: kind for kind in (Range, Choice, RandomPush, RandomPayload, RandomNoise, RandomDelay)}


def to_plain(value: Any) -> Any:
    """``value`` as JSON has it; objects of this module become {"kind": class name, field: value, ...}.

    Raises:
        InvalidInput: something that :func:`from_plain` could not read back.

    Example:
        >>> from wbc.sweep.draw import Range, from_plain, to_plain
        >>> to_plain(Range(0.0, 1.0))
        {'kind': 'Range', 'low': 0.0, 'high': 1.0, 'whole': False}
        >>> from_plain(to_plain((Range(0.0, 1.0), 2)))
        (Range(low=0.0, high=1.0, whole=False), 2)
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str) or (isinstance(value, float) and np.isfinite(value)):
        return value
    if isinstance(value, tuple | list):
        return [to_plain(item) for item in value]
    if isinstance(value, Mapping) and "kind" not in value and all(isinstance(key, str) for key in value):
        return {key: to_plain(item) for key, item in value.items()}
    if _KINDS.get(type(value).__name__) is type(value):
        return {"kind": type(value).__name__} | {one.name: to_plain(getattr(value, one.name)) for one in fields(value)}
    raise InvalidInput(f"{value!r} has no form in JSON that a sweep can read back")


def from_plain(value: Any) -> Any:
    """What :func:`to_plain` was given; lists become tuples.

    Raises:
        InvalidInput: a kind that is not one of this module's, or fields that it does not have.
    """
    if isinstance(value, list):
        return tuple(from_plain(item) for item in value)
    if not isinstance(value, dict):
        return value
    settings = {key: from_plain(item) for key, item in value.items() if key != "kind"}
    if "kind" not in value:
        return settings
    kind = _KINDS.get(value["kind"]) if isinstance(value["kind"], str) else None
    if kind is None or set(settings) != {one.name for one in fields(kind)}:
        raise InvalidInput(f"{value['kind']!r} is nothing that a sweep can draw")
    made: Any = kind(**settings)
    return made
