"""Frames of Unitree's robots made a second time: C structures declared from the published IDL, and a checksum.

Nothing here is shared with the library: its records are numpy's, its checksum is zlib's turned round.
"""

from __future__ import annotations

import ctypes
import re
from typing import Any

IDL = """
module unitree_hg {
  struct IMUState { float quaternion[4]; float gyroscope[3]; float accelerometer[3]; float rpy[3]; short temperature; };
  struct MotorCmd { octet mode; float q; float dq; float tau; float kp; float kd; unsigned_long reserve; };
  struct MotorState { octet mode; float q; float dq; float ddq; float tau_est; short temperature[2]; float vol;
                      unsigned_long sensor[2]; unsigned_long motorstate; unsigned_long reserve[4]; };
  struct LowCmd { octet mode_pr; octet mode_machine; MotorCmd motor_cmd[35]; unsigned_long reserve[4];
                  unsigned_long crc; };
  struct LowState { unsigned_long version[2]; octet mode_pr; octet mode_machine; unsigned_long tick;
                    IMUState imu_state; MotorState motor_state[35]; octet wireless_remote[40];
                    unsigned_long reserve[4]; unsigned_long crc; };
};
module unitree_go {
  struct IMUState { float quaternion[4]; float gyroscope[3]; float accelerometer[3]; float rpy[3]; octet temperature; };
  struct MotorCmd { octet mode; float q; float dq; float tau; float kp; float kd; unsigned_long reserve[3]; };
  struct BmsCmd { octet off; octet reserve[3]; };
  struct MotorState { octet mode; float q; float dq; float ddq; float tau_est; float q_raw; float dq_raw; float ddq_raw;
                      octet temperature; unsigned_long lost; unsigned_long reserve[2]; };
  struct BmsState { octet version_high; octet version_low; octet status; octet soc; long current;
                    unsigned_short cycle; octet bq_ntc[2]; octet mcu_ntc[2]; unsigned_short cell_vol[15]; };
  struct LowCmd { octet head[2]; octet level_flag; octet frame_reserve; unsigned_long sn[2]; unsigned_long version[2];
                  unsigned_short bandwidth; MotorCmd motor_cmd[20]; BmsCmd bms_cmd; octet wireless_remote[40];
                  octet led[12]; octet fan[2]; octet gpio; unsigned_long reserve; unsigned_long crc; };
  struct LowState { octet head[2]; octet level_flag; octet frame_reserve; unsigned_long sn[2]; unsigned_long version[2];
                    unsigned_short bandwidth; IMUState imu_state; MotorState motor_state[20]; BmsState bms_state;
                    short foot_force[4]; short foot_force_est[4]; unsigned_long tick; octet wireless_remote[40];
                    octet bit_flag; float adc_reel; octet temperature_ntc1; octet temperature_ntc2; float power_v;
                    float power_a; unsigned_short fan_frequency[4]; unsigned_long reserve; unsigned_long crc; };
};
"""
PLAIN: dict[str, Any] = {
    "octet": ctypes.c_uint8, "short": ctypes.c_int16, "unsigned_short": ctypes.c_uint16, "long": ctypes.c_int32,
    "unsigned_long": ctypes.c_uint32, "float": ctypes.c_float,
}  # fmt: skip


def structures() -> dict[str, dict[str, Any]]:
    """Every structure of the IDL as a class of ctypes, by module and name."""
    found: dict[str, dict[str, Any]] = {}
    for module, body in re.findall(r"module (\w+) \{(.*?)\n\};", IDL, re.DOTALL):
        known = dict(PLAIN)
        for name, members in re.findall(r"struct (\w+) \{(.*?)\};", body, re.DOTALL):
            fields = []
            for kind, member, size in re.findall(r"(\w+) (\w+)(?:\[(\d+)\])?;", members):
                fields.append((member, known[kind] * int(size) if size else known[kind]))
            known[name] = type(name, (ctypes.LittleEndianStructure,), {"_fields_": fields})
        found[module] = known
    return found


def crc_bit_by_bit(frame: bytes) -> int:
    """The register of the makers' text over all words but the last: shift, and subtract the polynomial for each bit
    that leaves or enters."""
    register = 0xFFFFFFFF
    for i in range(0, len(frame) - 4, 4):
        word = int.from_bytes(frame[i : i + 4], "little")
        for place in reversed(range(32)):
            leaves = (register >> 31) ^ (word >> place & 1)
            register = register << 1 & 0xFFFFFFFF
            if leaves:
                register ^= 0x04C11DB7
    return register


def sealed(frame: Any) -> bytes:
    """The bytes of a structure, with its checksum."""
    frame.crc = crc_bit_by_bit(bytes(frame))
    return bytes(frame)
