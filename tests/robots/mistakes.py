"""Mistakes that people make between a program and a robot, each with what a check must say of it.

``python3 -m tests.robots.mistakes`` writes docs/robots/mistakes.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio

import wbc
from tests.robots.builders import GO2_MOTORS, PARTS, Spoiled
from wbc.robots import SENSORS, Franka, MotorBoard, UnitreeG1, UnitreeGo2
from wbc.robots.check import Checked, check
from wbc.robots.device import Device, Order, Reading
from wbc.robots.hands import BoardHands
from wbc.robots.unitree import GO_COMMAND, HG_COMMAND, Unitree
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant

#: Device, robot and the names of its joints' motors, by kind.
ROBOTS: Mapping[str, tuple[Callable[[], Device], str]] = {
    "go2": (UnitreeGo2, "quadruped"),
    "franka": (Franka, "arm"),
    "g1": (UnitreeG1, "g1"),
    "panda": (Franka, "panda"),
}
#: Robots of each kind with nothing wrong.
CLEAN = {"franka": 60, "go2": 30, "g1": 10}


def names_of(kind: str) -> dict[str, str]:
    """The motor of each joint."""
    robot = wbc.load(ROBOTS[kind][1], base="fixed")
    return GO2_MOTORS if kind == "go2" else dict(zip(robot.joint_names, ROBOTS[kind][0]().motors, strict=True))


class Other:
    """A program's own device: the true one, with parts of it replaced."""

    def __init__(self, true: Device, *, unpack: Any = None, encode: Any = None) -> None:
        self._true = true
        self._unpack, self._encode = unpack or (lambda reading: reading), encode or (lambda frame: frame)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._true, name)

    def unpack(self, frame: Any) -> Reading:
        return self._unpack(self._true.unpack(frame))

    def encode(self, order: Order, reading: Reading) -> Any:
        return self._encode(self._true.encode(order, reading))


@dataclass(frozen=True)
class Seeded:
    """One mistake. ``wrong``: conventions of the map; ``exchange``: joints whose motors are those of others; ``own``:
    makes the program's device of the true one; ``spoil``: the port; ``board``: settings. ``kind`` and ``says`` are what
    the one finding must be, and have in its sentence."""

    what: str
    robot: str
    kind: str
    says: str
    wrong: Mapping[str, Any] = field(default_factory=dict)
    exchange: Mapping[str, str] = field(default_factory=dict)
    own: Callable[[Device], Any] | None = None
    spoil: Callable[[list[Any]], Any] | None = None
    board: Mapping[str, Any] = field(default_factory=dict)


def period(device: Device) -> float:
    """Of the motors' law on the board [s]: 1 kHz or faster, however seldom states are sent."""
    return min(1.0 / device.rate, 1e-3)


def checked(
    kind: str, seed: int, mistake: Seeded | None = None, *, fit: Callable[[MotorBoard], None] = lambda board: None
) -> Checked:
    """A check of a robot with noise, friction and masses of its own, drawn by ``seed``; ``fit`` changes its motors."""
    make, name = ROBOTS[kind]
    device, robot, rng = make(), wbc.load(name, base="fixed"), np.random.default_rng(seed)
    names = names_of(kind)
    physics = PhysicsSettings(armature=0.01, joint_friction=0.02, joint_damping=0.05)
    plant = MujocoPlant(robot, dt=period(device), settings=physics)
    plant.physics.body_mass[:] *= rng.uniform(0.95, 1.05, plant.physics.nbody)
    plant.reset(np.clip(robot.q0 + rng.uniform(-0.1, 0.1, robot.nj), robot.limits.q_min, robot.limits.q_max))
    settings: dict[str, Any] = {
        "delay": rng.uniform(0.0, 4e-3), "sensors": SENSORS["mti-300"], "seed": seed, "mode_machine": 5,
    }  # fmt: skip
    mistake = mistake or Seeded("", kind, "", "")
    board = MotorBoard(device, plant, joint_map=device.joint_map(robot, names=names), **settings | dict(mistake.board))
    fit(board)
    port: Any = Spoiled(board, mistake.spoil) if mistake.spoil else board
    taken = {joint: names[mistake.exchange.get(joint, joint)] for joint in names}
    joint_map = device.joint_map(robot, names=taken, **mistake.wrong)
    own = mistake.own(device) if mistake.own else device
    return check(port, robot, device=own, joint_map=joint_map, hands=BoardHands(board))


def both(*pairs: tuple[str, str]) -> dict[str, str]:
    """Joints that are exchanged, both ways."""
    return {a: b for one, other in pairs for a, b in ((one, other), (other, one))}


def _reads(**changes: Callable[[Any], Any]) -> Callable[[Device], Other]:
    def unpack(reading: Reading) -> Reading:
        return replace(reading, **{name: change(getattr(reading, name)) for name, change in changes.items()})

    return lambda true: Other(true, unpack=unpack)


def _sends(layout: Any, change: Callable[[Any], None], *, seal: bool = True) -> Callable[[Device], Other]:
    def encode(frame: bytes) -> bytes:
        record = np.frombuffer(frame, layout).copy()
        change(record)
        return Unitree._sealed(record) if seal else record.tobytes()

    return lambda true: Other(true, encode=encode)


def _set(name: str, value: Any) -> Callable[[Any], None]:
    return lambda record: record.__setitem__(name, value)


def _off(record: Any) -> None:
    record["motor_cmd"]["mode"] = 0


def _crossed(record: Any) -> None:
    record["motor_cmd"][0, [2, 5]] = record["motor_cmd"][0, [5, 2]]


def _flipped(sign: Any) -> Callable[[Any], Any]:
    return lambda values: np.asarray(sign) * values


def _every(count: int) -> Callable[[list[Any]], Any]:
    return lambda came: came[-1] if len(came) % count == 0 else None


def _swapped(came: list[Any]) -> Any:
    return came[-3] if len(came) > 3 and len(came) % 5 == 0 else came[-1]


def _twice(came: list[Any]) -> Any:
    return came[-1 - len(came) % 2] if len(came) > 1 else came[-1]


def _mirrored(reading: Reading) -> Reading:
    """All of an IMU whose y counts the other way."""
    x, y, z, w = reading.quaternion
    flip = np.array([1.0, -1.0, 1.0])
    quaternion = np.array([-x, y, -z, w])
    return replace(reading, quaternion=quaternion, gyro=-flip * reading.gyro, acceleration=flip * reading.acceleration)


def _torn(came: list[Any]) -> Any:
    return came[-1][:100] + bytes([came[-1][100] ^ 1]) + came[-1][101:]


def _leg(name: str) -> list[str]:
    return [f"{name}_{part}" for part in PARTS.values()]


def _mounted(axis: int, angle: float) -> Any:
    return pinocchio.exp3(angle * np.eye(3)[axis])


_FL, _FR, _RL, _RR = (_leg(f"{end}_{side}") for end in ("front", "rear") for side in ("left", "right"))
_LEG_JOINTS = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM_JOINTS = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
_L, _R = ([f"{side}_{joint}_joint" for joint in _LEG_JOINTS] for side in ("left", "right"))
_ARMS = [[f"{side}_{joint}_joint" for joint in _ARM_JOINTS] for side in ("left", "right")]


def _backwards(limb: list[str]) -> dict[str, str]:
    return dict(zip(limb, limb[::-1], strict=True))


MISTAKES = [
    Seeded("knees of the front legs", "go2", "order",
           "front_left_knee and front_right_knee are exchanged", exchange=both((_FL[2], _FR[2]))),
    Seeded("hip roll and pitch of a leg", "go2", "order",
           "front_left_hip_roll and front_left_hip_pitch are exchanged", exchange=both((_FL[0], _FL[1]))),
    Seeded("FL FR RL RR taken for FR FL RR RL", "go2", "order",
           "front_left_hip_roll with front_right_hip_roll and rear_left_hip_roll with",
           exchange=both(*zip(_FL, _FR, strict=True), *zip(_RL, _RR, strict=True))),
    Seeded("front left leg and front right leg", "go2", "order",
           "limbs are exchanged", exchange=both(*zip(_FL, _FR, strict=True))),
    Seeded("one leg from knee to hip", "go2", "order",
           "rear_right_hip_roll and rear_right_knee are exchanged", exchange=both((_RR[0], _RR[2]))),
    Seeded("each leg from knee to hip", "go2", "order",
           "each limb are in another order",
           exchange={a: b for leg in (_FL, _FR, _RL, _RR) for a, b in _backwards(leg).items()}),
    Seeded("sign of a hip roll", "go2", "sign",
           "the sign of rear_left_hip_roll is wrong", wrong={"sign": {"rear_left_hip_roll": -1}}),
    Seeded("sign of a hip pitch", "go2", "sign",
           "the sign of front_right_hip_pitch is wrong", wrong={"sign": {"front_right_hip_pitch": -1}}),
    Seeded("sign of a knee", "go2", "sign",
           "the sign of rear_right_knee is wrong", wrong={"sign": {"rear_right_knee": -1}}),
    Seeded("all in degrees", "go2", "unit",
           "every joint comes in radians and is taken for degrees", wrong={"unit": "deg"}),
    Seeded("gear of a knee", "go2", "gear",
           "the gear of front_left_knee is wrong", wrong={"gear": {"front_left_knee": 2.5}}),
    Seeded("offset of a hip pitch", "go2", "offset",
           "rear_left_hip_pitch is off by", wrong={"offset": {"rear_left_hip_pitch": 0.8}}),
    Seeded("crc 0", "go2", "frame", "crc is 0x00000000", own=_sends(GO_COMMAND, _set("crc", 0), seal=False)),
    Seeded("no head", "go2", "frame", "head", own=_sends(GO_COMMAND, _set("head", 0))),
    Seeded("motors off", "go2", "frame", "mode of motor FR_hip_joint is 0", own=_sends(GO_COMMAND, _off)),
    Seeded("orders of two motors crossed", "go2", "frame",
           "our frames say another q of FR_calf_joint", own=_sends(GO_COMMAND, _crossed)),
    Seeded("w first", "go2", "imu", "w first, and is read as x y z w", own=_reads(quaternion=lambda q: np.roll(q, 1))),
    Seeded("w last taken for w first", "go2", "imu",
           "x y z w, and is read as w first", own=_reads(quaternion=lambda q: np.roll(q, -1))),
    Seeded("inverse quaternion", "go2", "imu", "the inverse", own=_reads(quaternion=_flipped([-1, -1, -1, 1]))),
    Seeded("IMU turned by 90°", "go2", "imu", "mounted turned by 90° about z", board={"imu": _mounted(2, np.pi / 2)}),
    Seeded("IMU turned by 180°", "go2", "imu", "mounted turned by 180° about z", board={"imu": _mounted(2, np.pi)}),
    Seeded("gyroscope mirrored", "go2", "imu",
           "the gyroscope is mirrored: its y", own=_reads(gyro=_flipped([1, -1, 1]))),
    Seeded("gyroscope in degrees", "go2", "imu", "degrees per second", own=_reads(gyro=_flipped(180 / np.pi))),
    Seeded("accelerometer in g", "go2", "imu",
           "the accelerometer is in g", own=_reads(acceleration=_flipped(1 / 9.81))),
    Seeded("accelerometer upside down", "go2", "imu", "opposite sign", own=_reads(acceleration=_flipped(-1))),
    Seeded("accelerometer mirrored", "go2", "imu",
           "the accelerometer is mirrored: its x", own=_reads(acceleration=_flipped([-1, 1, 1]))),
    Seeded("stale states", "go2", "stale", "their time stands still", spoil=lambda came: came[0]),
    Seeded("states out of order", "go2", "stale", "out of order", spoil=_swapped),
    Seeded("states at 50 Hz", "go2", "rate", "50 Hz, not 500 Hz", spoil=_every(10)),
    Seeded("no states", "go2", "silent", "no state comes", spoil=lambda came: None),
    Seeded("torn states", "go2", "frame", "states are not sound", spoil=_torn),
    Seeded("orders 40 ms late", "go2", "latency", "ms late", board={"delay": 0.04}),
    Seeded("velocities with the other sign", "go2", "velocity",
           "velocities of all joints have the other sign", own=_reads(dq=_flipped(-1))),
    Seeded("a whole turn at a knee", "go2", "offset",
           "front_left_knee is read at -7.", wrong={"offset": {"front_left_knee": 2 * np.pi}}),
    Seeded("torques with the other sign", "go2", "torque",
           "the torques of all joints are read with the other sign", own=_reads(tau=_flipped(-1))),
    Seeded("torques of half the size", "go2", "torque",
           "the torques of all joints are read 0.", own=_reads(tau=_flipped(0.5))),
    Seeded("gear of a rear knee", "go2", "gear",
           "the gear of rear_left_knee is wrong", wrong={"gear": {"rear_left_knee": 2}}),
    Seeded("IMU mirrored", "go2", "imu",
           "if the robot is upside down; else it is mirrored", own=lambda t: Other(t, unpack=_mirrored)),
    Seeded("accelerometer without gravity", "go2", "imu",
           "gravity is left out", own=_reads(acceleration=lambda a: a - [0.0, 0.0, 9.81])),
    Seeded("states sent twice", "go2", "stale", "are the one before once more", spoil=_twice),
    Seeded("joints 1 and 3", "franka", "order",
           "shoulder_yaw and upper_arm_roll are exchanged", exchange=both(("shoulder_yaw", "upper_arm_roll"))),
    Seeded("joints 4 and 6", "franka", "order",
           "elbow and wrist_pitch are exchanged", exchange=both(("elbow", "wrist_pitch"))),
    Seeded("joints 2 and 4", "franka", "order",
           "shoulder_pitch and elbow are exchanged", exchange=both(("shoulder_pitch", "elbow"))),
    Seeded("sign of joint 1", "franka", "sign",
           "the sign of shoulder_yaw is wrong", wrong={"sign": {"shoulder_yaw": -1}}),
    Seeded("sign of joint 4", "franka", "sign", "the sign of elbow is wrong", wrong={"sign": {"elbow": -1}}),
    Seeded("gear of joint 4", "franka", "gear", "the gear of elbow is wrong", wrong={"gear": {"elbow": 2.0}}),
    Seeded("gear of joint 2", "franka", "gear",
           "the gear of shoulder_pitch is wrong", wrong={"gear": {"shoulder_pitch": 0.5}}),
    Seeded("offset of joint 4", "franka", "offset", "elbow is off by", wrong={"offset": {"elbow": -0.3}}),
    Seeded("offset of joint 2", "franka", "offset",
           "shoulder_pitch is off by", wrong={"offset": {"shoulder_pitch": 0.2}}),
    Seeded("a whole turn at joint 4", "franka", "offset",
           "beyond its limits -2.40 and 2.40: it is off by whole turns", wrong={"offset": {"elbow": 2 * np.pi}}),
    Seeded("degrees and sign of joint 4", "franka", "unit",
           "elbow comes in radians and is taken for degrees, with the other sign",
           wrong={"unit": {"elbow": "deg"}, "sign": {"elbow": -1}}),
    Seeded("degrees", "franka", "unit", "every joint comes in radians and is taken for degrees", wrong={"unit": "deg"}),
    Seeded("torques with the other sign", "franka", "command",
           "commanded one way and read the other", own=lambda true: Other(true, encode=lambda frame: -frame)),
    Seeded("clock in milliseconds", "franka", "rate", "times as fast as ours", own=_reads(time=lambda t: 1000.0 * t)),
    Seeded("mode_machine 0", "g1", "frame",
           "mode_machine is 0; it must be 5", own=_sends(HG_COMMAND, _set("mode_machine", 0))),
    Seeded("mode_pr 1", "g1", "frame", "mode_pr is 1; it must be 0", own=_sends(HG_COMMAND, _set("mode_pr", 1))),
    Seeded("crc 0", "g1", "frame", "crc is 0x00000000", own=_sends(HG_COMMAND, _set("crc", 0), seal=False)),
    Seeded("w first", "g1", "imu", "w first, and is read as x y z w", own=_reads(quaternion=lambda q: np.roll(q, 1))),
    Seeded("knees", "g1", "order", "left_knee_joint and right_knee_joint are exchanged", exchange=both((_L[3], _R[3]))),
    Seeded("legs", "g1", "order", "limbs are exchanged", exchange=both(*zip(_L, _R, strict=True))),
    Seeded("arms", "g1", "order", "limbs are exchanged", exchange=both(*zip(*_ARMS, strict=True))),
    Seeded("sign of a hip yaw", "g1", "sign", "the sign of left_hip_yaw_joint is wrong", wrong={"sign": {_L[2]: -1}}),
    Seeded("sign of a shoulder roll", "g1", "sign",
           "the sign of right_shoulder_roll_joint is wrong", wrong={"sign": {_ARMS[1][1]: -1}}),
    Seeded("gear of a knee", "g1", "gear", "the gear of left_knee_joint is wrong", wrong={"gear": {_L[3]: 2}}),
    Seeded("offset of an elbow", "g1", "offset", "left_elbow_joint is off by", wrong={"offset": {_ARMS[0][3]: 0.5}}),
]  # fmt: skip


def page() -> str:
    """The page of all mistakes, as docs/robots/mistakes.md has it."""
    kinds = [one.robot for one in MISTAKES]
    counts = ", ".join(f"{kinds.count(kind)} on {kind}" for kind in dict.fromkeys(kinds))
    head = f"""# Mistakes that the check names

`tests/robots/mistakes.py` seeds {len(MISTAKES)} mistakes between a program and its robot, {counts}:
each on a robot in physics with noise, friction, delay and masses of its own. The check must find this one mistake and
nothing else, and its sentence must have the words of the last column. `make deep` runs all of them, and
{sum(CLEAN.values())} robots with nothing wrong, of which it must find nothing. `python3 -m tests.robots.mistakes`
writes this page; a test compares it.

| device | mistake | kind | the sentence has |
| :-- | :-- | :-- | :-- |
"""
    return head + "".join(f"| {one.robot} | {one.what} | {one.kind} | {one.says} |\n" for one in MISTAKES)


if __name__ == "__main__":
    (Path(__file__).parents[2] / "docs" / "robots" / "mistakes.md").write_text(page(), encoding="utf-8")
