"""Device: the frames of one kind of robot, what its motors make of them, and what it reports. Not tried on hardware.

A motor that is sent position, velocity, torque and two gains gives

    τ = τ* + kp (q* − q) + kd (q̇* − q̇)

Arrays are in the order of the device's motors and in its units; :class:`~wbc.robots.joint_map.JointMap` turns those
of a robot into them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, ClassVar, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.robots.joint_map import JointMap
from wbc.types import Mat, Vec, read_only

_UNKNOWN = read_only(np.full(4, np.nan))


class BadFrame(InvalidInput):
    """A frame that a robot would not take, or that is not from this robot; the message says what is wrong with it."""


@contextmanager
def opened(frame: Any) -> Iterator[None]:
    """Inside, whatever is wrong with ``frame``, which may be anything, is a :class:`BadFrame`."""
    try:
        yield
    except BadFrame:
        raise
    except InvalidInput as cause:
        raise BadFrame(str(cause)) from cause
    except Exception as cause:
        raise BadFrame(f"{checks.shown(frame)} is no frame of this robot: {cause}") from cause


_VECTORS = "q", "dq", "tau", "quaternion", "gyro", "acceleration", "feet", "sent"


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Reading:
    """What a robot reports: ``q``, ``dq`` and ``tau`` (n,) in the order and units of its motors.

    NaN is what it does not know; a position it must know.

    ``time`` [s] is the robot's own clock, not the time of day. ``quaternion`` (4,) is **x y z w**, from the axes of
    the IMU to the world; ``gyro`` (3,) [rad/s] and ``acceleration`` (3,) [m/s²] (at rest: 9.81 upwards) in the axes
    of the IMU. ``feet``: what sensors in the feet say, in the device's order and unit. ``sent`` (n,) [N m] is the
    torque that the robot got last, where it says so.

    Raises:
        InvalidInput: a position that is not finite, a number that is infinite, other sizes of ``dq`` or ``tau``.
    """

    q: Vec
    dq: Vec
    tau: Vec
    time: float = float("nan")
    quaternion: Vec = field(default_factory=lambda: _UNKNOWN[:4])
    gyro: Vec = field(default_factory=lambda: _UNKNOWN[:3])
    acceleration: Vec = field(default_factory=lambda: _UNKNOWN[:3])
    feet: Vec = field(default_factory=lambda: _UNKNOWN[:0])
    sent: Vec = field(default_factory=lambda: _UNKNOWN[:0])
    mode_machine: int = 0
    mode_pr: int = 0

    def __post_init__(self) -> None:
        parts = [self._vector(name) for name in _VECTORS]
        if type(self.time) is not float:
            object.__setattr__(self, "time", checks.number("time", self.time))
        if not self.q.shape == self.dq.shape == self.tau.shape == (len(self.q),):
            raise InvalidInput(f"q, dq and tau have the shapes {self.q.shape}, {self.dq.shape} and {self.tau.shape}")
        if not abs(self.q).max(initial=0.0) <= checks.LARGEST:
            checks.array("q", self.q, self.q.shape)
        if (abs(np.concatenate(parts)) > checks.LARGEST).any() or abs(self.time) > checks.LARGEST:
            raise InvalidInput(f"a number of the state is larger than {checks.LARGEST:g}")

    def _vector(self, name: str) -> Vec:
        """A field as a vector of float64; in a loop it is one already."""
        value: Any = getattr(self, name)
        if type(value) is not np.ndarray or value.dtype != np.float64 or value.ndim != 1:
            try:
                (size,) = np.shape(value)
                object.__setattr__(self, name, checks.floats(value).reshape(size))
            except Exception as cause:  # a conversion may raise whatever it likes
                raise InvalidInput(f"{name} must be a vector of numbers, not {checks.shown(value)}") from cause
        vector: Vec = getattr(self, name)
        return vector


@final
@dataclass(frozen=True, eq=False)
class Order:
    """What motors are sent: ``q``, ``dq``, ``tau``, ``kp``, ``kd`` (n,), each one for all or one for each motor.

    ``gravity`` (n,) [N m] is what gravity asks of the motors, for robots that add it themselves. ``weight`` in [0, 1]
    is the share that our orders have against the robot's own controller, for robots that have one.

    Raises:
        InvalidInput: another size, not finite, a negative gain.
    """

    q: Any
    dq: Any = 0.0
    tau: Any = 0.0
    kp: Any = 0.0
    kd: Any = 0.0
    gravity: Any = 0.0
    weight: float = 1.0

    def __post_init__(self) -> None:
        if self._sound():
            return
        size = len(checks.array("q", self.q, (None,)))
        for name in ("q", "dq", "tau", "gravity"):
            object.__setattr__(self, name, checks.each(name, getattr(self, name), size))
        for name in ("kp", "kd"):
            object.__setattr__(self, name, checks.gains(name, getattr(self, name), size))
        checks.number("weight", self.weight, low=0.0, high=1.0)

    def _sound(self) -> bool:
        """Whether all is as it should be already, as in a loop, where every check costs more than the order."""
        given = [self.q, self.dq, self.tau, self.kp, self.kd]
        if type(self.gravity) is not float or self.gravity != 0.0:
            given.append(self.gravity)
        if not all(type(one) is np.ndarray and one.dtype == np.float64 and one.ndim == 1 for one in given):
            return False
        if len({len(one) for one in given}) != 1:
            return False
        if type(self.weight) is not float or not 0.0 <= self.weight <= 1.0:
            return False
        finite = abs(np.concatenate(given)).max(initial=0.0) < checks.LARGEST
        return bool(finite and min(self.kp.min(), self.kd.min()) >= 0.0)

    def torque(self, q: Vec, dq: Vec) -> Vec:
        """τ (n,) of a motor that stands at q (n,) and turns with dq (n,)."""
        torque: Vec = self.tau + self.kp * (self.q - q) + self.kd * (self.dq - dq)
        return torque

    def mixed(self, other: Order, share: float) -> Order:
        """The order whose torques are those of ``other`` by ``share`` in [0, 1], and of this one by the rest."""

        def mean(one: Any, two: Any) -> Any:
            return (1.0 - share) * one + share * two

        def place(gain: str, name: str) -> Vec:
            # Two springs are one spring between their ends; without any, what is followed is a position.
            ours, theirs = (1.0 - share) * getattr(self, gain), share * getattr(other, gain)
            both, one, two = ours + theirs, getattr(self, name), getattr(other, name)
            found: Vec = np.where(
                both > 0.0, (ours * one + theirs * two) / np.where(both > 0.0, both, 1.0), mean(one, two)
            )
            return found

        tau, kp, kd, gravity = (mean(getattr(self, n), getattr(other, n)) for n in ("tau", "kp", "kd", "gravity"))
        return Order(
            place("kp", "q"), place("kd", "dq"), tau, kp, kd, gravity=gravity, weight=mean(self.weight, other.weight)
        )


class Device(metaclass=TellsArguments):
    """Frames of one kind of robot: ``encode`` and ``unpack`` are ours, ``decode`` and ``report`` the robot's own side.

    ``law`` is what its motors follow: "impedance" (the law above, on the robot), "torque" or "position".
    """

    motors: tuple[str, ...]
    rate: float
    #: Stiffness and damping (n,) with which each motor holds still on its own, modest ones, in the device's units.
    gains: tuple[Any, Any] = (20.0, 1.0)
    law: ClassVar[str] = "impedance"
    unit: ClassVar[str] = "rad"
    #: After so long [s] the clock of its states starts again at 0.
    wraps: ClassVar[float] = np.inf
    #: Whether the robot adds the torques that gravity asks for to those that it is sent.
    adds_gravity: ClassVar[bool] = False
    #: By how much a torque that is sent may change in a second [N m/s].
    torque_rate: ClassVar[float] = np.inf
    has_imu: ClassVar[bool] = False
    #: Whether it reports the torques of its motors.
    has_torque: ClassVar[bool] = True

    def joint_map(self, robot: RobotModel, **conventions: Any) -> JointMap:
        """The map of a robot whose joints are called as the motors; those that it does not have are idle.

        ``conventions`` as for :meth:`~wbc.robots.joint_map.JointMap.of`; a joint that ``unit`` does not name has the
        device's, or "m" if it slides.
        """
        names, joints = conventions.get("names") or {}, conventions.get("joints") or robot.joint_names
        wanted = {names.get(joint, joint) for joint in joints}
        idle = [motor for motor in self.motors if motor not in wanted]
        unit = conventions.pop("unit", {})
        if isinstance(unit, Mapping):
            slides = [robot.joint_units[robot.joint(joint)] == "m" for joint in joints]
            unit = {joint: "m" if m else self.unit for joint, m in zip(joints, slides, strict=True)} | dict(unit)
        return JointMap.of(robot, self.motors, **{"unit": unit, "idle": idle} | conventions)

    def accepted(self, joint_map: JointMap | None, robot: RobotModel) -> JointMap:
        """A map that is given for a robot, or else that of equal names.

        Raises:
            InvalidInput: its slots are not the motors of this device, in their order.
        """
        if joint_map is None:
            return self.joint_map(robot)
        slots = checks.instance("joint_map", joint_map, JointMap, "a JointMap").device
        if slots != tuple(self.motors):
            raise InvalidInput(
                f"joint_map is for the slots {', '.join(slots)}; the motors of the device are {', '.join(self.motors)}"
            )
        return joint_map

    @abstractmethod
    def encode(self, order: Order, reading: Reading) -> Any:
        """The frame to send; ``reading`` is the last one, for robots that want to be answered to it."""

    @abstractmethod
    def unpack(self, frame: Any) -> Reading:
        """What a robot's frame says.

        Raises:
            BadFrame: it is not a sound frame of this device.
        """

    @abstractmethod
    def decode(self, frame: Any, reading: Reading) -> Order:
        """What the robot would take from a frame that it is sent while it reports ``reading``.

        Raises:
            BadFrame: it would not take it; the sentence says why.
        """

    @abstractmethod
    def report(self, reading: Reading) -> Any:
        """The frame in which the robot says ``reading``."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self.motors)} motors)"


def rotation(quaternion: Vec) -> Mat:
    """The rotation (3, 3) of a quaternion x y z w of any length."""
    R: Mat = pinocchio.Quaternion(quaternion / np.linalg.norm(quaternion)).toRotationMatrix()
    return R
