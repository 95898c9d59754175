"""JointMap: both ways are each other's inverse, torques go against velocities, and mistakes are named."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tests.robots.builders import sliding
from wbc.errors import InvalidInput
from wbc.robots import JointMap, LeRobot

JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
SLOTS = ("m0", "m1", "m2", "m3")


@st.composite
def maps(draw: st.DrawFn) -> dict[str, Any]:
    """The arguments of a sound map: permuted slots, some idle, with any conventions."""
    n, more = draw(st.integers(1, 8)), draw(st.integers(0, 4))
    slots = draw(st.permutations([f"slot{i}" for i in range(n + more)]))
    many = {"min_size": n, "max_size": n}
    return {
        "joints": [f"joint{i}" for i in range(n)],
        "slots": slots[:n],
        "device": [f"slot{i}" for i in range(n + more)],
        "idle": slots[n:],
        "sign": draw(st.lists(st.sampled_from([1, -1]), **many)),
        "offset": draw(st.lists(st.floats(-10, 10), **many)),
        "gear": draw(st.lists(st.floats(0.01, 200), **many)),
        "unit": draw(st.lists(st.sampled_from(["rad", "deg", "m"]), **many)),
    }


def arrays(n: int) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(-100, 100, allow_subnormal=False), min_size=n, max_size=n)


@given(maps(), st.data())
def test_both_ways_are_inverse_and_as_the_equations_say(arguments: dict[str, Any], data: st.DataObject):
    joint_map = JointMap(**arguments)
    n = len(arguments["joints"])
    q, v, tau, gain = (np.array(data.draw(arrays(n))) for _ in range(4))
    p, rate = joint_map.position_to_device(q, rest=7.0), joint_map.velocity_to_device(v)
    torque, gains = joint_map.torque_to_device(tau), joint_map.gain_to_device(gain)
    for i, slot in enumerate(arguments["slots"]):
        k = arguments["device"].index(slot)
        per_radian = 180.0 / np.pi if arguments["unit"][i] == "deg" else 1.0
        turns = arguments["sign"][i] * arguments["gear"][i]
        assert p[k] == pytest.approx(turns * per_radian * q[i] + arguments["offset"][i], rel=1e-12, abs=1e-12)
        assert rate[k] == pytest.approx(turns * per_radian * v[i], rel=1e-12)
        assert torque[k] * turns == pytest.approx(tau[i], rel=1e-12)
        assert torque[k] * rate[k] / per_radian == pytest.approx(tau[i] * v[i], rel=1e-12)  # the same power
        # The same spring on both sides.
        assert turns * gains[k] * rate[k] == pytest.approx(gain[i] * v[i], rel=1e-12)
    assert all(p[arguments["device"].index(slot)] == 7.0 for slot in arguments["idle"])
    for there, back in [
        (p, lambda: (joint_map.position_from_device(p), q)),
        (rate, lambda: (joint_map.velocity_from_device(rate), v)),
        (torque, lambda: (joint_map.torque_from_device(torque), tau)),
        (gains, lambda: (joint_map.gain_from_device(gains), gain)),
    ]:
        assert there.shape == (joint_map.size,)
        found, given_ = back()
        # An offset of 10 takes digits from a position that the gear made small.
        np.testing.assert_allclose(found, given_, rtol=1e-12, atol=1e-12)


@given(st.permutations(SLOTS), st.lists(st.sampled_from([1, -1]), min_size=4, max_size=4), arrays(4))
def test_order_and_signs_are_exact_to_the_bit(slots: list[str], sign: list[int], q: list[float]):
    joint_map = JointMap(JOINTS, slots, SLOTS, sign=sign)
    for name in ("position", "velocity", "torque", "gain"):
        out = getattr(joint_map, f"{name}_to_device")(q)
        assert getattr(joint_map, f"{name}_from_device")(out).tolist() == q


def test_a_robots_joints_go_to_the_slots_of_their_names():
    robot = wbc.load("arm")
    device = ["motor_of_elbow" if name == "elbow" else name for name in reversed(robot.joint_names)]
    joint_map = JointMap.of(robot, [*device, "gripper"], names={"elbow": "motor_of_elbow"}, idle=["gripper"])
    assert joint_map.joints == robot.joint_names
    q = np.arange(7.0)
    assert joint_map.position_to_device(q).tolist() == [6, 5, 4, 3, 2, 1, 0, 0]
    part = JointMap.of(robot, ["elbow", "wrist_roll"], joints=["wrist_roll", "elbow"], sign={"elbow": -1})
    assert part.position_to_device([1.0, 2.0]).tolist() == [-2.0, 1.0]


@given(given_=st.dictionaries(st.sampled_from(["base", "elbow", "gripper"]), st.sampled_from(["rad", "m"])))
def test_a_device_keeps_its_unit_for_the_joints_that_are_not_named(given_: dict[str, str]):
    with TemporaryDirectory() as folder:
        robot = sliding(Path(folder))
    arm = LeRobot(robot.joint_names)
    usual = dict.fromkeys(robot.joint_names, "deg") | {"gripper": "m"}
    joint_map = arm.joint_map(robot, unit=given_) if given_ else arm.joint_map(robot)
    assert dict(zip(joint_map.joints, joint_map.unit, strict=True)) == usual | given_
    ones = [180.0 / np.pi if unit == "deg" else 1.0 for unit in joint_map.unit]
    np.testing.assert_allclose(joint_map.position_to_device(np.ones(4)), ones)
    for unit in ("deg", {"gripper": "deg"}):
        with pytest.raises(InvalidInput, match="gripper is deg; it slides, so it must be m"):
            arm.joint_map(robot, unit=unit)


def test_a_map_cannot_be_changed():
    joint_map = JointMap(JOINTS, SLOTS, SLOTS)
    with pytest.raises(AttributeError):
        joint_map.sign = -1.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        joint_map.gear[0] = 2.0
