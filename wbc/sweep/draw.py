"""Random settings of a run: numbers from a range, one of several values, disturbances of random strength."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil, floor
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.report.coded import Codec
from wbc.sim.disturbance import Delay, Disturbance, Payload, Push, SensorNoise


@final
@dataclass(frozen=True)
class Range:
    """A number, every one from ``low`` to ``high`` equally likely; a whole one where ``whole``.

    Raises:
        InvalidInput: bounds that are not finite, or crossed, or without a whole number between them where it is to be.

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
        low, high = checks.number("low", self.low), checks.number("high", self.high)
        if low > high:
            raise InvalidInput(f"the range {self} runs backwards; write {high:g}:{low:g}")
        if self.whole and ceil(low) > floor(high):
            raise InvalidInput(f"the range {self} holds no whole number")

    def draw(self, rng: np.random.Generator) -> float | int:
        """One number."""
        if self.whole:
            return int(rng.integers(ceil(self.low), floor(self.high), endpoint=True))
        return float(rng.uniform(self.low, self.high))

    def __str__(self) -> str:
        return f"{self.low:g}:{self.high:g}"


@final
@dataclass(frozen=True)
class Choice:
    """One of ``values``, all equally likely.

    Raises:
        InvalidInput: there is none, or one is there twice.
    """

    values: tuple[Any, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise InvalidInput("a choice needs at least one value")
        told = [repr(value) for value in self.values]
        for value in told:
            if told.count(value) > 1:
                raise InvalidInput(f"{value} is given {told.count(value)} times; all values are equally likely")

    def draw(self, rng: np.random.Generator) -> Any:
        """One value."""
        return self.values[int(rng.integers(len(self.values)))]

    def __str__(self) -> str:
        return ",".join(map(str, self.values))


Drawn = Range | Choice


@contextmanager
def about(name: str) -> Iterator[None]:
    """A refusal says what it is about."""
    try:
        yield
    except InvalidInput as refusal:
        raise InvalidInput(f"{name}: {refusal}" if name not in str(refusal) else str(refusal)) from None


def read_range(name: str, text: str) -> Range:
    """``LOW:HIGH``, or one number that is always drawn.

    Raises:
        InvalidInput: neither.
    """
    low, colon, high = text.partition(":")
    with about(name):
        return Range(first := checks.typed(name, low), checks.typed(name, high) if colon else first)


class DrawnDisturbance(ABC):
    """Settings of a disturbance whose strength, and where it has them direction and time, are drawn in each run."""

    @abstractmethod
    def draw(self, rng: np.random.Generator, duration: float) -> Disturbance:
        """The disturbance of one run of ``duration`` seconds."""

    @abstractmethod
    def __str__(self) -> str:
        """In one line."""


def _check_size(name: str, sizes: Range) -> None:
    checks.number(f"the least {name}", checks.instance(name, sizes, Range, "a wbc.sweep.Range").low, low=0.0)


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

    def __post_init__(self) -> None:
        _check_size("mass", self.mass)

    def draw(self, rng: np.random.Generator, duration: float) -> Disturbance:
        del duration
        return Payload(self.frame, mass=max(float(self.mass.draw(rng)), 1e-9))

    def __str__(self) -> str:
        return f"payload {self.frame}={self.mass} kg"


@final
@dataclass(frozen=True)
class RandomNoise(DrawnDisturbance):
    """White noise on measured joint velocities of standard deviation ``velocity`` [rad/s], with a seed of its own."""

    velocity: Range

    def __post_init__(self) -> None:
        _check_size("velocity", self.velocity)

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

    def __post_init__(self) -> None:
        _check_size("seconds", self.seconds)

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


#: How settings stand in a file of results, which may name these classes.
CODEC = Codec((Range, Choice, RandomPush, RandomPayload, RandomNoise, RandomDelay))
