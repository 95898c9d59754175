"""Sensors in a simulation: an IMU, encoders and feet with the errors of data sheets, and an estimator that reads them.

The controller then gets what :class:`~wbc.robots.estimator.BaseEstimator` makes of the sensors, not the plant's truth.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.robots.device import rotation
from wbc.robots.estimator import BaseEstimator
from wbc.robots.invariant_filter import ImuNoise
from wbc.sim.disturbance import Disturbance, Effect
from wbc.sim.plant import Drive, Plant
from wbc.types import Mat, Vec

_DEGREE, _MILLI_G = math.pi / 180.0, 9.81e-3


@final
@dataclass(frozen=True)
class Sensors(metaclass=TellsArguments):
    """A set of sensors: standard deviations, and the delay with which the controller gets a sample.

    ``imu``: its noise and biases. ``joint_position`` [rad, m] and ``joint_velocity`` [rad/s, m/s]: white noise of the
    encoders; ``joint_torque`` [N m, N]: of the torques that motors report. ``delay`` [s], rounded to whole steps.
    ``feet``: what says whether a foot touches, "forces" in it or the joints' "torques", those that were commanded.
    ``tilt`` [rad]: how far the robot leans at the start; the estimator does not know it.

    Raises:
        InvalidInput: a negative number, or other ``feet``.

    Example:
        >>> from wbc.robots import SENSORS
        >>> SENSORS["mti-300"].delay
        0.001
    """

    imu: ImuNoise = field(default_factory=ImuNoise)
    joint_position: float = 0.0
    joint_velocity: float = 0.0
    joint_torque: float = 0.0
    delay: float = 0.0
    feet: str = "forces"
    tilt: float = 0.0

    def __post_init__(self) -> None:
        for name in ("joint_position", "joint_velocity", "joint_torque", "delay", "tilt"):
            checks.number(f"{name} of Sensors", getattr(self, name), low=0.0)
        checks.one_of("feet of Sensors", self.feet, ("forces", "torques"))


#: Sets by name. Data sheets: Movella, MTi-300 (May 2023): 0.01 °/s/√Hz, 60 µg/√Hz, 450 °/s, 20 g. Bosch, BMI055: 0.014
#: °/s/√Hz, 150 µg/√Hz, zero-rate offset 1 °/s (typical), zero-g offset 60 mg (most, taken for 3σ), 2000 °/s, 16 g. ams,
#: AS5045 at 10 kHz: 0.06° rms and 0.1 ms at the motor; behind a gear of 6 that is 0.01°. Our assumptions: the biases of
#: an MTi-300 after calibration, 0.2 °/s and 3 mg; how biases wander; velocities to 0.01 rad/s, which a motor board
#: filters; torques to 0.05 N m; the lean at the start; 1 ms on the way.
SENSORS: Mapping[str, Sensors] = {
    "exact": Sensors(ImuNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    "mti-300": Sensors(
        ImuNoise(0.01 * _DEGREE, 0.06 * _MILLI_G, 0.2 * _DEGREE, 3.0 * _MILLI_G, 1e-5, 1e-4, 450.0 * _DEGREE, 196.0),
        joint_position=0.01 * _DEGREE, joint_velocity=0.01, joint_torque=0.05, delay=1e-3, tilt=5e-3,
    ),
    "bmi055": Sensors(
        ImuNoise(0.014 * _DEGREE, 0.15 * _MILLI_G, 1.0 * _DEGREE, 20.0 * _MILLI_G, 3e-5, 3e-4, 2000.0 * _DEGREE, 157.0),
        joint_position=0.01 * _DEGREE, joint_velocity=0.01, joint_torque=0.05, delay=1e-3, tilt=0.02,
    ),
}  # fmt: skip


@final
class Errors:
    """The errors that sensors make in one run, a sample every ``period`` [s], drawn by ``seed``.

    ``bias`` (6,) is that of gyroscope and accelerometer now, ``lean`` (3,) [rad] by how much the robot is told to lean,
    in its own axes.
    """

    def __init__(self, sensors: Sensors, period: float, seed: int) -> None:
        self._sensors, imu = sensors, sensors.imu
        self._normal = np.random.default_rng(seed).standard_normal
        self._white = np.repeat([imu.gyro, imu.accelerometer], 3) / math.sqrt(period)
        self._walk = np.repeat([imu.gyro_walk, imu.accelerometer_walk], 3) * math.sqrt(period)
        self.bias = np.repeat([imu.gyro_bias, imu.accelerometer_bias], 3) * self._normal(6)
        self.lean = sensors.tilt * np.array([*self._normal(2), 0.0])

    def imu(self, motion: Vec) -> Vec:
        """What an IMU says of a rate and a specific force (6,)."""
        self.bias = self.bias + self._walk * self._normal(6)
        said: Vec = motion + self.bias + self._white * self._normal(6)
        return said

    def joints(self, q: Vec, v: Vec) -> tuple[Vec, Vec]:
        """What encoders say of q and v (nj,)."""
        sensors, n = self._sensors, len(q)
        return q + sensors.joint_position * self._normal(n), v + sensors.joint_velocity * self._normal(n)

    def torques(self, tau: Vec) -> Vec:
        """What motors say of their torques (nj,)."""
        said: Vec = tau + self._sensors.joint_torque * self._normal(len(tau))
        return said


def felt(before: tuple[Mat, Vec], now: tuple[Mat, Vec], dt: float, gravity: Vec) -> Vec:
    """Mean rate [rad/s] and specific force [m/s²] (6,) of an IMU, its axes, over ``dt``.

    ``before`` and ``now`` are its rotation (3, 3) and its velocity (3,) [m/s] in the world.
    """
    turn = pinocchio.log3(before[0].T @ now[0])
    middle = before[0] @ pinocchio.exp3(0.5 * turn)
    return np.concatenate([turn / dt, middle.T @ ((now[1] - before[1]) / dt - gravity)])


@final
@dataclass(frozen=True)
class EstimatedBase(Disturbance):
    """The controller gets the state that an estimator computes from ``sensors``; ``seed`` decides their errors.

    Before the run the robot has stood still for ``still`` [s] on all feet, and the estimator has listened. The rate and
    the specific force that the IMU gives are means over a step, from the plant's own states. The IMU sits at
    ``imu_frame``; default: the base. The estimator is given the places of the feet and not the lean; ``floor`` as
    :class:`BaseEstimator` takes it.

    Raises:
        InvalidInput: a seed that is not a whole number >= 0, a negative time or ``floor``.

    Example:
        >>> from wbc.robots import SENSORS, EstimatedBase
        >>> print(EstimatedBase(SENSORS["exact"], seed=3))
        base estimated from IMU and encoders, 0 ms late; feet by forces; seed 3
    """

    sensors: Sensors
    seed: int = 0
    imu_frame: str = ""
    still: float = 0.0
    floor: float | None = None

    def __post_init__(self) -> None:
        checks.number("still", self.still, low=0.0)
        if self.floor is not None:
            checks.number("floor", self.floor, low=0.0)
        checks.seed("seed", self.seed)

    def begin(self, plant: Plant) -> Effect:
        return Sensing(self, plant)

    def __str__(self) -> str:
        sensors = self.sensors
        late = f"{sensors.delay * 1e3:g} ms late"
        return f"base estimated from IMU and encoders, {late}; feet by {sensors.feet}; seed {self.seed}"


@final
class Sensing(Effect):
    """The sensors and the ``estimator`` of one run; ``sample`` is the last that they gave, by the names that
    :meth:`BaseEstimator.update` has for its parts."""

    def __init__(self, settings: EstimatedBase, plant: Plant) -> None:
        sensors, model = settings.sensors, plant.model
        self._settings, self._sensors, self._plant, self._model = settings, sensors, plant, model
        self.estimator = BaseEstimator(
            model, [*getattr(plant, "wrenches", dict)()] or None, imu_frame=settings.imu_frame, noise=sensors.imu,
            joint=sensors.joint_position, joint_rate=sensors.joint_velocity, tilt=max(sensors.tilt, 1e-4),
            floor=settings.floor, late=sensors.delay,
        )  # fmt: skip
        if sensors.feet == "forces" and not hasattr(plant, "wrenches"):
            raise InvalidInput(f"{type(plant).__name__} has no force sensors; give Sensors(feet='torques')")
        self._errors = Errors(sensors, plant.dt, settings.seed)
        self._late: deque[dict[str, Any]] = deque(maxlen=round(sensors.delay / plant.dt) + 1)
        self._tau: Vec = np.zeros(model.nj)
        self._before: tuple[Mat, Vec] | None = None
        self.sample: dict[str, Any] = {}

    def measure(self, q: Vec, v: Vec) -> tuple[Vec, Vec]:
        if self._before is None:
            self._before = self._moves()
            self.estimator.reset(self._leaning(q), v)
            steps, dt = round(self._settings.still / self._plant.dt), self._plant.dt
            for k in range(steps):
                self.estimator.update(**self._sampled(q, 0.0 * v, self._plant.t + (k - steps) * dt))
        self._late.append({**self._sampled(q, v, self._plant.t), **self._pressing()})
        self.sample = self._late[0]
        return self.estimator.update(**self.sample)

    def _leaning(self, q: Vec) -> Vec:
        """What the robot is told of q (nq,): leaning otherwise about the middle of its feet."""
        lean = np.concatenate([np.zeros(3), self._errors.lean, np.zeros(self._model.nj)])
        told, state = self._model.integrate(q, lean), self._model.state()
        middles = []
        for one in (q, told):
            state.update(0.0, one, np.zeros(self._model.nv))
            middles.append(np.mean([state.frame(name).position for name in self.estimator.contacts], axis=0))
        told[:3] += middles[0] - middles[1]
        return told

    def deliver(self, command: Drive) -> Drive:
        self._tau = np.array(command.tau)
        return command

    def _sampled(self, q: Vec, v: Vec, t: float) -> dict[str, Any]:
        """A sample at t [s] of the plant as it is, joints as in q (nq,), v (nv,)."""
        nj = self._model.nj
        imu = self._errors.imu(self._motion())
        joint_q, joint_v = self._errors.joints(q[-nj:], v[-nj:])
        return {"t": t, "joint_q": joint_q, "joint_v": joint_v, "gyro_in_imu": imu[:3], "acceleration_in_imu": imu[3:]}

    def _pressing(self) -> dict[str, Any]:
        """What says which feet touch."""
        if self._sensors.feet == "torques":
            return {"joint_tau": self._tau}
        plant: Any = self._plant
        up = -self._model.gravity / np.linalg.norm(self._model.gravity)
        return {"forces": {name: float(up @ wrench[:3]) for name, wrench in plant.wrenches().items()}}

    @property
    def bias(self) -> Vec:
        """Biases of gyroscope and accelerometer (6,) [rad/s], [m/s²]."""
        return self._errors.bias

    def _motion(self) -> Vec:
        """Mean rate [rad/s] and specific force [m/s²] of the IMU (6,) in the last step, its axes."""
        assert self._before is not None, "measure has begun"
        before, self._before = self._before, self._moves()
        return felt(before, self._before, self._plant.dt, self._model.gravity)

    def _moves(self) -> tuple[Mat, Vec]:
        """Rotation (3, 3) and velocity (3,) of the IMU in the world."""
        q, v, estimator = self._plant.q, self._plant.v, self.estimator
        base = rotation(q[3:7])
        return base @ estimator.mount, base @ (v[:3] + np.cross(v[3:6], estimator.lever))
