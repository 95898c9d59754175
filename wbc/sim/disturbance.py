"""Disturbances: frozen settings of what goes wrong, each one readable line, each repeatable to the bit.

A disturbance acts in one of three places of the loop:

    before the step     ``push``       forces on the plant
    at the sensors      ``measure``    what the controller is told of (q, v)
    at the actuators    ``deliver``    what becomes of its command; delays come before all others
"""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.sim.plant import Drive, Plant
from wbc.types import Vec


class Effect:
    """The memory of one disturbance in one run. Each does one of these; the others do nothing."""

    def push(self, t: float) -> None:
        """Called before the step that starts at time t [s]."""

    def measure(self, q: Vec, v: Vec) -> tuple[Vec, Vec]:
        """The measured state for the true q (nq,), v (nv,)."""
        return q, v

    def deliver(self, command: Drive) -> Drive:
        """The command that reaches the actuators."""
        return command


class Disturbance(metaclass=TellsArguments):
    """Settings. ``begin`` starts it in a run; ``str`` says it in one line."""

    @abstractmethod
    def begin(self, plant: Plant) -> Effect:
        """Its effect on ``plant``, from a fresh start: the same settings give the same run.

        Raises:
            UnknownFrame: a frame the plant does not have.
            NotSupported: a plant that cannot be disturbed this way.
        """

    @abstractmethod
    def __str__(self) -> str:
        """One readable line with units."""


def listed(disturbances: Iterable[Disturbance]) -> list[Disturbance]:
    """The argument ``disturbances`` as a list.

    Raises:
        InvalidInput: one alone, or something else.
    """
    if isinstance(disturbances, Disturbance):
        kind = type(disturbances).__name__
        raise InvalidInput(f"disturbances is {disturbances!r}; write disturbances=[{kind}(…)]")
    found = checks.items("disturbances", disturbances, "disturbances")
    what = "a Disturbance, such as wbc.sim.disturbance.Push"
    return [checks.instance(f"disturbances[{i}]", one, Disturbance, what) for i, one in enumerate(found)]


@final
@dataclass(frozen=True)
class Push(Disturbance):
    """A constant force (3,) [N, world axes] at the centre of mass of the link ``frame``, for ``duration`` seconds.

    It acts in every step that starts in that time: its impulse is force × dt × (duration rounded to whole steps).

    Raises:
        InvalidInput: a force that is not three finite numbers, a negative start or a duration that is not positive.

    Example:
        >>> from wbc.sim.disturbance import Push
        >>> print(Push("torso", force=(0.0, 60.0, 0.0), start=1.5, duration=0.2))
        push of (0, 60, 0) N at 'torso' from 1.5 s for 0.2 s
    """

    frame: str
    force: Sequence[float]
    start: float
    duration: float

    def __post_init__(self) -> None:
        checks.text("frame", self.frame)
        object.__setattr__(self, "force", tuple(checks.array("force", self.force, (3,)).tolist()))
        checks.number("start", self.start, low=0.0)
        checks.number("duration", self.duration, low=0.0, strict=True)

    def begin(self, plant: Plant) -> Effect:
        plant.push(self.frame, np.zeros(3))  # refuses here what it would refuse later
        return _Pushing(self, plant)

    def __str__(self) -> str:
        force = ", ".join(f"{x:.4g}" for x in self.force)
        return f"push of ({force}) N at {self.frame!r} from {self.start:.4g} s for {self.duration:g} s"


@final
class _Pushing(Effect):
    def __init__(self, push: Push, plant: Plant) -> None:
        # Half a step of tolerance: t is a multiple of dt up to rounding, and a push must not lose a step to that.
        self._from = push.start - 0.5 * plant.dt
        self._until = push.start + push.duration - 0.5 * plant.dt
        self._frame, self._force, self._plant = push.frame, np.array(push.force), plant

    def push(self, t: float) -> None:
        if self._from <= t < self._until:
            self._plant.push(self._frame, self._force)


@final
@dataclass(frozen=True, kw_only=True)
class SensorNoise(Disturbance):
    """White Gaussian noise on the measured state; each number is one standard deviation.

    ``position`` [rad, m] and ``velocity`` [rad/s, m/s] of the joints; of a floating base ``base_position`` [m],
    ``base_orientation`` [rad], ``base_velocity`` [m/s] and ``base_angular_velocity`` [rad/s], base axes. ``seed``
    decides every number.

    Raises:
        InvalidInput: a negative deviation, or a seed that is not a whole number >= 0.

    Example:
        >>> from wbc.sim.disturbance import SensorNoise
        >>> print(SensorNoise(velocity=0.01, base_velocity=0.005, seed=3))
        sensor noise: velocity 0.01, base_velocity 0.005 (standard deviations, SI units), seed 3
    """

    position: float = 0.0
    velocity: float = 0.0
    base_position: float = 0.0
    base_orientation: float = 0.0
    base_velocity: float = 0.0
    base_angular_velocity: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value in self._deviations().items():
            checks.number(name, value, low=0.0)
        checks.seed("seed", self.seed)

    def begin(self, plant: Plant) -> Effect:
        return _Noise(self, plant)

    def _deviations(self) -> dict[str, float]:
        return {name: value for name, value in vars(self).items() if name != "seed"}

    def __str__(self) -> str:
        parts = ", ".join(f"{name} {value:g}" for name, value in self._deviations().items() if value)
        return f"sensor noise: {parts or 'none'} (standard deviations, SI units), seed {self.seed}"


@final
class _Noise(Effect):
    def __init__(self, noise: SensorNoise, plant: Plant) -> None:
        model = plant.model
        base = model.nb > 0
        self._model = model
        self._random = np.random.default_rng(noise.seed)
        self._on_q = np.full(model.nv, noise.position)
        self._on_v = np.full(model.nv, noise.velocity)
        if base:
            self._on_q[:6] = np.repeat([noise.base_position, noise.base_orientation], 3)
            self._on_v[:6] = np.repeat([noise.base_velocity, noise.base_angular_velocity], 3)

    def measure(self, q: Vec, v: Vec) -> tuple[Vec, Vec]:
        on_q, on_v = self._random.standard_normal((2, self._model.nv))
        return self._model.integrate(q, self._on_q * on_q), v + self._on_v * on_v


@final
@dataclass(frozen=True)
class Delay(Disturbance):
    """The actuators get each command ``seconds`` late, rounded to whole steps. Until then the first one holds.

    Raises:
        InvalidInput: a negative delay.

    Example:
        >>> from wbc.sim.disturbance import Delay
        >>> print(Delay(0.002))
        commands arrive 2 ms late
    """

    seconds: float

    def __post_init__(self) -> None:
        checks.number("seconds", self.seconds, low=0.0)

    def begin(self, plant: Plant) -> Effect:
        return _Late(round(self.seconds / plant.dt))

    def __str__(self) -> str:
        return f"commands arrive {self.seconds * 1e3:g} ms late"


@final
class _Late(Effect):
    def __init__(self, steps: int) -> None:
        self._on_the_way: deque[Drive] = deque(maxlen=steps + 1)

    def deliver(self, command: Drive) -> Drive:
        self._on_the_way.append(command)
        return self._on_the_way[0]


@final
@dataclass(frozen=True)
class Payload(Disturbance):
    """A point mass [kg] fixed to the origin of ``frame`` from ``start`` [s] on; the controller is not told.

    Raises:
        InvalidInput: a mass that is not positive, or a negative start.

    Example:
        >>> from wbc.sim.disturbance import Payload
        >>> print(Payload("hand", mass=2.0, start=5.0))
        payload of 2 kg at 'hand' from 5 s
    """

    frame: str
    mass: float
    start: float = 0.0

    def __post_init__(self) -> None:
        checks.text("frame", self.frame)
        checks.number("mass", self.mass, low=0.0, strict=True)
        checks.number("start", self.start, low=0.0)

    def begin(self, plant: Plant) -> Effect:
        plant.add_mass(self.frame, 0.0)  # refuses here what it would refuse later
        return _Carrying(self, plant)

    def __str__(self) -> str:
        return f"payload of {self.mass:g} kg at {self.frame!r} from {self.start:g} s"


@final
class _Carrying(Effect):
    def __init__(self, payload: Payload, plant: Plant) -> None:
        self._payload, self._plant, self._waiting = payload, plant, True

    def push(self, t: float) -> None:
        if self._waiting and t >= self._payload.start - 0.5 * self._plant.dt:
            self._plant.add_mass(self._payload.frame, self._payload.mass)
            self._waiting = False
