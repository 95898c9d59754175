"""Frames against the makers' own software, where it is installed: ``pip install unitree-sdk2py-dimos pylibfranka``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.robots.test_devices import order_for, reading_for
from wbc.robots import Franka, UnitreeG1, UnitreeG1Arms, UnitreeGo2
from wbc.robots.device import Order, Reading
from wbc.robots.unitree import Unitree


def fill(message: Any, record: Any) -> None:
    """Every field of a record into the message's field of the same name."""
    for name in record.dtype.names:
        value = record[name]
        if value.dtype.names is None:
            setattr(message, name, value.tolist())
        elif value.ndim:
            for part, one in zip(getattr(message, name), value, strict=True):
                fill(part, one)
        else:
            fill(getattr(message, name), value)


@pytest.mark.parametrize("device", [UnitreeG1(), UnitreeG1Arms(waist=True), UnitreeGo2()], ids=repr)
@pytest.mark.parametrize("seed", range(5))
def test_the_sdk_computes_the_same_checksums(device: Unitree, seed: int):
    pytest.importorskip("unitree_sdk2py")
    from unitree_sdk2py.idl import default
    from unitree_sdk2py.utils.crc import CRC

    reading = reading_for(device, seed)
    for kind, layout, frame in (
        ("LowCmd_", device.command, device.encode(order_for(device, seed), reading)),
        ("LowState_", device.state, device.report(reading)),
    ):
        message = getattr(default, f"{device.package}_msg_dds__{kind}")()
        record = np.frombuffer(frame, layout)[0]
        fill(message, record)
        assert CRC().Crc(message) == record["crc"]


def test_pylibfranka_takes_torques_and_has_the_fields_that_are_read():
    libfranka = pytest.importorskip("pylibfranka")
    arm = Franka()
    frame = arm.encode(
        Order(np.zeros(7), tau=0.5), Reading(q=np.zeros(7), dq=np.zeros(7), tau=np.zeros(7), sent=np.zeros(7))
    )
    assert list(libfranka.Torques(frame.tolist()).tau_J) == frame.tolist()
    assert all(hasattr(libfranka.RobotState, name) for name in ("q", "dq", "tau_J", "tau_J_d", "time"))
    assert hasattr(libfranka.Duration, "to_sec")
