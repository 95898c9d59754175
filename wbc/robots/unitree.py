"""Unitree G1 and Go2: LowCmd and LowState as bytes, in the layout that the robots check. Not tried on hardware.

Bytes are little-endian, in the memory layout of the makers' C structures, which their checksum is about. A DDS message
is filled from them field by field, by code of your own. The layouts are those that the IDL files ``unitree_hg`` and
``unitree_go`` of ``unitree_sdk2`` declare.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from typing import Any, ClassVar, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.robots.device import BadFrame, Device, Order, Reading, opened
from wbc.types import Index, Vec

#: What the makers send to motors that are not there: position [rad] and velocity [rad/s] that mean "none".
NO_POSITION, NO_VELOCITY = 2.146e9, 16000.0
#: The slot of G1 whose position is how far the arms follow ``rt/arm_sdk``.
WEIGHT_SLOT = 29
_BITS = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def _record(text: str, **parts: np.dtype[Any]) -> np.dtype[Any]:
    """A C structure from words name:type or name:type*count; ``parts`` are types of its own."""
    fields: list[Any] = []
    for word in text.split():
        name, kind, count = re.fullmatch(r"(\w+):(\w+)(?:\*(\d+))?", word).groups()  # type: ignore[union-attr]
        fields.append((name, parts.get(kind, f"<{kind}"), *([int(count)] if count else [])))
    return np.dtype(fields, align=True)


_DRIVE = ("q", "dq", "tau", "kp", "kd")
_MOTOR = " ".join(["mode:u1", *(f"{name}:f4" for name in _DRIVE)])
_IMU = "quaternion:f4*4 gyroscope:f4*3 accelerometer:f4*3 rpy:f4*3 temperature:"
_GO_HEAD = "head:u1*2 level_flag:u1 frame_reserve:u1 sn:u4*2 version:u4*2 bandwidth:u2 "
HG_COMMAND = _record(
    "mode_pr:u1 mode_machine:u1 motor_cmd:motor*35 reserve:u4*4 crc:u4", motor=_record(_MOTOR + " reserve:u4")
)
HG_STATE = _record(
    "version:u4*2 mode_pr:u1 mode_machine:u1 tick:u4 imu_state:imu motor_state:motor*35 wireless_remote:u1*40 "
    "reserve:u4*4 crc:u4",
    imu=_record(_IMU + "i2"),
    motor=_record(
        "mode:u1 q:f4 dq:f4 ddq:f4 tau_est:f4 temperature:i2*2 vol:f4 sensor:u4*2 motorstate:u4 reserve:u4*4"
    ),
)
GO_COMMAND = _record(
    _GO_HEAD + "motor_cmd:motor*20 bms_cmd:bms wireless_remote:u1*40 led:u1*12 fan:u1*2 gpio:u1 reserve:u4 crc:u4",
    motor=_record(_MOTOR + " reserve:u4*3"),
    bms=_record("off:u1 reserve:u1*3"),
)
GO_STATE = _record(
    _GO_HEAD + "imu_state:imu motor_state:motor*20 bms_state:bms foot_force:i2*4 foot_force_est:i2*4 tick:u4 "
    "wireless_remote:u1*40 bit_flag:u1 adc_reel:f4 temperature_ntc1:u1 temperature_ntc2:u1 power_v:f4 power_a:f4 "
    "fan_frequency:u2*4 reserve:u4 crc:u4",
    imu=_record(_IMU + "u1"),
    motor=_record(
        "mode:u1 q:f4 dq:f4 ddq:f4 tau_est:f4 q_raw:f4 dq_raw:f4 ddq_raw:f4 temperature:u1 lost:u4 reserve:u4*2"
    ),
    bms=_record(
        "version_high:u1 version_low:u1 status:u1 soc:u1 current:i4 cycle:u2 bq_ntc:u1*2 mcu_ntc:u1*2 cell_vol:u2*15"
    ),
)


def checksum(frame: bytes) -> int:
    """The makers' CRC of a frame without its last word: polynomial 04C11DB7, from FFFFFFFF, over little-endian words
    from their highest bit, nothing reflected.

    zlib has the same polynomial with all bits the other way round.

    Example:
        >>> from wbc.robots.unitree import checksum
        >>> hex(checksum(bytes(8)))
        '0xc704dd7b'
    """
    words = np.frombuffer(frame, "<u4")[:-1].byteswap().tobytes()
    turned = zlib.crc32(words.translate(_BITS)) ^ 0xFFFFFFFF
    return int(f"{turned:032b}"[::-1], 2)


class Unitree(Device):
    """What the robots share: records with a checksum at the end, IMUs with w first, motors in numbered slots.

    Args:
        check: whether a state frame with a wrong checksum is refused; some simulators leave it 0.
    """

    has_imu: ClassVar[bool] = True
    command: ClassVar[np.dtype[Any]]
    state: ClassVar[np.dtype[Any]]
    #: Names of the DDS topics and of the maker's package.
    topics: ClassVar[tuple[str, str]] = ("rt/lowcmd", "rt/lowstate")
    package: ClassVar[str]
    #: Fields that are the same in every frame; what a command sends to slots without a motor of ours.
    fixed: ClassVar[Mapping[str, Any]] = {}
    idle: ClassVar[Mapping[str, float]] = {}
    #: Fields of a state that a command repeats, and their values.
    echoed: ClassVar[Mapping[str, range]] = {}
    #: The field of a state with the forces in the feet; the slot whose position is the weight of an order.
    feet: ClassVar[str | None] = None
    weight_slot: ClassVar[int | None] = None
    #: ``tick`` counts milliseconds in 32 bits: 49.7 days.
    wraps: ClassVar[float] = 2**32 / 1000
    #: Slot of each motor.
    index: Index
    rate = 500.0

    def __init__(self, *, check: bool = True) -> None:
        self.check = check

    def pack(self, q: Any, dq: Any, tau: Any, kp: Any, kd: Any, *, mode_machine: int = 0, mode_pr: int = 0) -> bytes:
        """The LowCmd frame of q [rad], dq [rad/s], tau [N m], kp [N m/rad], kd [N m s/rad], one for each motor.

        ``mode_machine`` must be what the last LowState said; ``mode_pr`` 0: ankles in pitch and roll. Robots without
        such fields ignore both.

        Raises:
            InvalidInput: another size, not finite, a negative gain.
        """
        order, nothing = Order(q, dq, tau, kp, kd), np.zeros(0)
        said = Reading(q=nothing, dq=nothing, tau=nothing, mode_machine=mode_machine, mode_pr=mode_pr)
        return self.encode(order, said)

    def encode(self, order: Order, reading: Reading) -> bytes:
        if len(order.q) != len(self.index):
            raise InvalidInput(f"q has {len(order.q)} entries; {type(self).__name__} has {len(self.index)} motors")
        frame = self._begun(self.command, reading)
        motors = frame["motor_cmd"]
        for name, value in self.idle.items():
            motors[name] = value
        for name in _DRIVE:
            motors[name][0, self.index] = getattr(order, name)
        motors["mode"][0, self.index] = 1
        if self.weight_slot is not None:
            motors["q"][0, self.weight_slot] = order.weight
        return self._sealed(frame)

    def unpack(self, frame: Any) -> Reading:
        state = self._opened(frame, self.state, check=self.check)
        motors, imu = state["motor_state"][self.index], state["imu_state"]
        with opened(frame):
            more: dict[str, Any] = {
                name: checks.one_of(name, int(state[name]), allowed) for name, allowed in self.echoed.items()
            }
            if self.feet is not None:
                more["feet"] = _doubles(state[self.feet])
            return Reading(
                q=_doubles(motors["q"]), dq=_doubles(motors["dq"]), tau=_doubles(motors["tau_est"]),
                time=int(state["tick"]) / 1000, quaternion=np.roll(_doubles(imu["quaternion"]), -1),
                gyro=_doubles(imu["gyroscope"]), acceleration=_doubles(imu["accelerometer"]), **more,
            )  # fmt: skip

    def decode(self, frame: Any, reading: Reading) -> Order:
        command = self._opened(frame, self.command, check=True)
        echoed = {name: getattr(reading, name) for name in self.echoed}
        for name, value in {**self.fixed, **echoed}.items():
            if np.any(command[name] != value):
                raise BadFrame(f"{name} is {command[name]}; it must be {value}")
        motors = command["motor_cmd"][self.index]
        if not motors["mode"].all():
            motor = self.motors[int(motors["mode"].argmin())]
            raise BadFrame(f"the mode of motor {motor} is 0, so it is off; it must be 1")
        slot = self.weight_slot
        weight = 1.0 if slot is None else float(np.clip(command["motor_cmd"]["q"][slot], 0.0, 1.0))
        q, dq, tau, kp, kd = (_doubles(motors[name]) for name in _DRIVE)
        with opened(frame):
            return Order(q, dq, tau, kp, kd, weight=weight)

    def report(self, reading: Reading) -> bytes:
        frame = self._begun(self.state, reading)
        motors, imu = frame["motor_state"], frame["imu_state"]
        motors["mode"][0, self.index] = 1
        for name, values in (("q", reading.q), ("dq", reading.dq), ("tau_est", reading.tau)):
            motors[name][0, self.index] = values
        imu["quaternion"][0] = np.roll(reading.quaternion, 1)
        imu["gyroscope"][0], imu["accelerometer"][0] = reading.gyro, reading.acceleration
        if self.feet is not None and len(reading.feet):
            frame[self.feet] = reading.feet
        frame["tick"] = round(1e3 * reading.time) % 2**32
        return self._sealed(frame)

    def _begun(self, layout: np.dtype[Any], reading: Reading) -> Any:
        """An empty frame but for what is fixed and what is repeated."""
        frame = np.zeros(1, layout)
        for name, value in self.fixed.items():
            frame[name] = value
        for name, allowed in self.echoed.items():
            frame[name] = checks.one_of(name, getattr(reading, name), allowed)
        return frame

    @staticmethod
    def _opened(frame: Any, layout: np.dtype[Any], *, check: bool) -> Any:
        if not isinstance(frame, bytes | bytearray | memoryview) or len(frame) != layout.itemsize:
            what = f"{len(frame)} bytes" if isinstance(frame, bytes | bytearray | memoryview) else checks.shown(frame)
            raise BadFrame(f"the frame is {what}; it must be {layout.itemsize} bytes")
        record = np.frombuffer(frame, layout)[0]
        if check and record["crc"] != (wanted := checksum(bytes(frame))):
            raise BadFrame(f"the frame's crc is {int(record['crc']):#010x}; it must be {wanted:#010x}")
        return record

    @staticmethod
    def _sealed(frame: Any) -> bytes:
        frame["crc"] = checksum(frame.tobytes())
        return bytes(frame.tobytes())


_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
_WAIST = tuple(f"waist_{name}_joint" for name in ("yaw", "roll", "pitch"))
_SIDES = ("left", "right")
#: Those of the makers' example for the robot that hangs, by slot.
_LEG_KP, _LEG_KD = (60.0, 60.0, 60.0, 100.0, 40.0, 40.0), (1.0, 1.0, 1.0, 2.0, 1.0, 1.0)
_KP = np.array([*_LEG_KP, *_LEG_KP, 60.0, 40.0, 40.0, *([40.0] * 14)])
_KD = np.array([*_LEG_KD, *_LEG_KD, *([1.0] * 17)])
_ARMS = tuple(f"{side}_{name}_joint" for side in _SIDES for name in _ARM)


class _Humanoid(Unitree):
    command, state, package = HG_COMMAND, HG_STATE, "unitree_hg"
    echoed: ClassVar[Mapping[str, range]] = {"mode_machine": range(256), "mode_pr": range(2)}


@final
class UnitreeG1(_Humanoid):
    """G1 with 29 motors: ``unitree_hg``, 35 slots, ankles in pitch and roll (``mode_pr`` 0). Not tried on hardware.

    Release the robot's own controller first (``MotionSwitcherClient.ReleaseMode``): LowState has no position of the
    base, and two controllers on ``rt/lowcmd`` would work against each other. Where the waist is locked, its roll and
    pitch are not valid.

    Example:
        >>> import numpy as np
        >>> from wbc.robots import UnitreeG1
        >>> g1 = UnitreeG1()
        >>> frame = g1.pack(np.zeros(29), 0.0, 0.0, 60.0, 1.0, mode_machine=5)
        >>> len(frame), frame[1], g1.motors[3]
        (1004, 5, 'left_knee_joint')
    """

    motors = (*(f"{side}_{name}_joint" for side in _SIDES for name in _LEG), *_WAIST, *_ARMS)
    index = np.arange(29)
    gains = (_KP, _KD)


@final
class UnitreeG1Arms(_Humanoid):
    """The arms of a G1 that balances on its own: ``rt/arm_sdk``, the weight in slot 29. Not tried on hardware.

    The robot's controller keeps the legs; the arms follow by the ``weight`` in [0, 1] of an order, which should rise
    and fall over seconds: an arm that is released falls. ``waist`` adds the three joints of the waist.

    Example:
        >>> from wbc.robots import UnitreeG1Arms
        >>> UnitreeG1Arms().motors[3], UnitreeG1Arms(waist=True).motors[14]
        ('left_elbow_joint', 'waist_yaw_joint')
    """

    topics: ClassVar[tuple[str, str]] = ("rt/arm_sdk", "rt/lowstate")
    weight_slot: ClassVar[int | None] = WEIGHT_SLOT

    def __init__(self, *, waist: bool = False, check: bool = True) -> None:
        super().__init__(check=check)
        waist = checks.truth("waist", waist)
        self.motors = (*_ARMS, *(_WAIST if waist else ()))
        self.index = np.array([*range(15, 29), *(range(12, 15) if waist else ())])
        self.gains = _KP[self.index], _KD[self.index]


@final
class UnitreeGo2(Unitree):
    """Go2: ``unitree_go``, 20 slots of which 12 have motors, FR FL RR RL times hip, thigh, calf. Not tried on hardware.

    Slots without motors are sent the maker's "no position, no velocity".

    Example:
        >>> from wbc.robots import UnitreeGo2
        >>> go2 = UnitreeGo2()
        >>> frame = go2.pack([0.0, 0.8, -1.6] * 4, 0.0, 0.0, 60.0, 5.0)
        >>> len(frame), frame[:3].hex(), go2.motors[:3]
        (812, 'feefff', ('FR_hip_joint', 'FR_thigh_joint', 'FR_calf_joint'))
    """

    command, state, package = GO_COMMAND, GO_STATE, "unitree_go"
    motors = tuple(f"{leg}_{name}_joint" for leg in ("FR", "FL", "RR", "RL") for name in ("hip", "thigh", "calf"))
    index = np.arange(12)
    gains = (np.full(12, 40.0), np.full(12, 1.5))
    fixed: ClassVar[Mapping[str, Any]] = {"head": (0xFE, 0xEF), "level_flag": 0xFF}
    idle: ClassVar[Mapping[str, float]] = {"mode": 1, "q": NO_POSITION, "dq": NO_VELOCITY}
    feet: ClassVar[str | None] = "foot_force"


def _doubles(values: Any) -> Vec:
    """Numbers of a frame, all of which a sound one has."""
    result: Vec = values.astype(np.float64)
    if np.isnan(result).any():
        raise BadFrame("a number of the frame is nan")
    return result
