"""Devices: frames are those of the published layouts to the bit, come back as they went, and bad ones are named."""

from __future__ import annotations

import random
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tests.robots import layouts
from tests.robots.examples import needs_examples
from wbc.errors import InvalidInput, UnknownSlot
from wbc.robots import Franka, JointMap, LeRobot, Loop, MotorBoard, Ros2Control, UnitreeG1, UnitreeG1Arms, UnitreeGo2
from wbc.robots.check import check
from wbc.robots.device import BadFrame, Device, Order, Reading
from wbc.robots.unitree import GO_COMMAND, GO_STATE, HG_COMMAND, HG_STATE, Unitree, checksum
from wbc.sim.plant import ForwardDynamicsPlant
from wbc.tasks import Posture

STRUCTURES = layouts.structures()
UNITREE: list[Unitree] = [UnitreeG1(), UnitreeG1Arms(), UnitreeG1Arms(waist=True), UnitreeGo2()]
DEVICES: list[Device] = [
    *UNITREE, Franka(), Ros2Control(["b", "a"]), Ros2Control(["b", "a"], interface="position"), LeRobot(),
]  # fmt: skip
SLOTS = {"UnitreeG1": [*range(29)], "UnitreeGo2": [*range(12)]}
seeds = st.integers(0, 2**32 - 1)


def slots(device: Unitree) -> list[int]:
    """The published slot of each motor, written down here once more."""
    if isinstance(device, UnitreeG1Arms):
        return [*range(15, 29), *([12, 13, 14] if len(device.motors) == 17 else [])]
    return SLOTS[type(device).__name__]


def order_for(device: Device, seed: int, weight: float = 1.0) -> Order:
    rng, n = np.random.default_rng(seed), len(device.motors)
    q, dq, tau = (np.float32(rng.normal(0, 3, n)) for _ in range(3))
    kp, kd = (np.float32(rng.uniform(0, 200, n)) for _ in range(2))
    return Order(q, dq, tau, kp, kd, weight=weight)


def reading_for(device: Device, seed: int) -> Reading:
    rng, n = np.random.default_rng(seed), len(device.motors)
    q, dq, tau = (np.float64(np.float32(rng.normal(0, 3, n))) for _ in range(3))
    more: dict[str, Any] = {}
    if device.has_imu:
        quaternion = np.float64(np.float32(rng.normal(size=4)))
        gyro, acceleration = (np.float64(np.float32(rng.normal(size=3))) for _ in range(2))
        more = {"quaternion": quaternion, "gyro": gyro, "acceleration": acceleration}
    if isinstance(device, UnitreeGo2):
        more["feet"] = np.float64(rng.integers(-3000, 3000, 4))
    if device.motors[0].startswith("left"):
        more |= {"mode_machine": int(rng.integers(256)), "mode_pr": int(rng.integers(2))}
    return Reading(q=q, dq=dq, tau=tau, time=int(rng.integers(10**6)) / 1000, **more)


def test_the_checksum_is_that_of_the_makers_text_and_of_the_catalogue():
    rng = random.Random(1)
    for size in (4, 8, 20, 812, 1004):
        frame = rng.randbytes(size)
        assert checksum(frame) == layouts.crc_bit_by_bit(frame)
    # CRC-32/MPEG-2 of "123456789" is 0376E6E7 in the catalogue of parametrised CRCs; words swap their bytes here.
    swapped = b"".join(b"12345678"[i : i + 4][::-1] for i in (0, 4))
    register = checksum(swapped + bytes(4))
    for bit in reversed(range(8)):  # the ninth byte, which is no whole word
        leaves = register >> 31 ^ (ord("9") >> bit & 1)
        register = (register << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 * leaves)
    assert register == 0x0376E6E7


@pytest.mark.parametrize(
    ("layout", "module", "name", "size"),
    [
        (HG_COMMAND, "unitree_hg", "LowCmd", 1004),
        (HG_STATE, "unitree_hg", "LowState", 2092),
        (GO_COMMAND, "unitree_go", "LowCmd", 812),
        (GO_STATE, "unitree_go", "LowState", 1180),
    ],
)
def test_records_are_the_structures_of_the_idl(layout: np.dtype[Any], module: str, name: str, size: int):
    """Names, kinds, sizes and places of all fields, as NumPy reads them from the C structure."""
    assert np.dtype(STRUCTURES[module][name]) == layout and layout.itemsize == size


@pytest.mark.parametrize("device", UNITREE, ids=repr)
@given(seed=seeds, mode_machine=st.integers(0, 255), mode_pr=st.sampled_from([0, 1]), weight=st.floats(0, 1, width=32))
def test_commands_are_those_of_a_second_implementation(
    device: Unitree, seed: int, mode_machine: int, mode_pr: int, weight: float
):
    made = STRUCTURES[device.package]["LowCmd"]()
    order = order_for(device, seed, weight)
    if device.package == "unitree_go":
        made.head[0], made.head[1], made.level_flag = 0xFE, 0xEF, 0xFF
        for motor in made.motor_cmd:
            motor.mode, motor.q, motor.dq = 1, 2.146e9, 16000.0
    else:
        made.mode_machine, made.mode_pr = mode_machine, mode_pr
    for k, slot in enumerate(slots(device)):
        motor = made.motor_cmd[slot]
        motor.mode = 1
        for name in ("q", "dq", "tau", "kp", "kd"):
            setattr(motor, name, getattr(order, name)[k])
    if isinstance(device, UnitreeG1Arms):
        made.motor_cmd[29].q = weight
    reading = Reading(q=order.q, dq=order.dq, tau=order.tau, mode_machine=mode_machine, mode_pr=mode_pr)
    frame = device.encode(order, reading)
    assert frame == layouts.sealed(made)
    back = device.decode(frame, reading)
    for name in ("q", "dq", "tau", "kp", "kd"):
        np.testing.assert_array_equal(getattr(back, name), getattr(order, name))
    assert back.weight == (weight if isinstance(device, UnitreeG1Arms) else 1.0)
    if not isinstance(device, UnitreeG1Arms):
        again = device.pack(
            order.q, order.dq, order.tau, order.kp, order.kd, mode_machine=mode_machine, mode_pr=mode_pr
        )
        assert again == frame


@pytest.mark.parametrize("device", UNITREE, ids=repr)
@given(seed=seeds)
def test_states_are_those_of_a_second_implementation(device: Unitree, seed: int):
    reading = reading_for(device, seed)
    made = STRUCTURES[device.package]["LowState"]()
    made.tick = round(1000 * reading.time)
    x, y, z, w = reading.quaternion
    made.imu_state.quaternion[:] = [w, x, y, z]
    made.imu_state.gyroscope[:], made.imu_state.accelerometer[:] = reading.gyro, reading.acceleration
    if device.package == "unitree_go":
        made.head[0], made.head[1], made.level_flag = 0xFE, 0xEF, 0xFF
        made.foot_force[:] = [int(force) for force in reading.feet]
    else:
        made.mode_machine, made.mode_pr = reading.mode_machine, reading.mode_pr
    for k, slot in enumerate(slots(device)):
        motor = made.motor_state[slot]
        motor.mode, motor.q, motor.dq, motor.tau_est = 1, reading.q[k], reading.dq[k], reading.tau[k]
    frame = layouts.sealed(made)
    assert device.report(reading) == frame
    assert same(device.unpack(frame), reading)


def same(one: Reading, other: Reading) -> bool:
    return all(np.array_equal(getattr(one, k), getattr(other, k), equal_nan=True) for k in vars(other))


@pytest.mark.parametrize("device", DEVICES, ids=repr)
@given(seed=seeds)
def test_readings_and_orders_come_back_as_they_went(device: Device, seed: int):
    reading = reading_for(device, seed)
    back = device.unpack(device.report(reading))
    np.testing.assert_array_equal(back.q, reading.q)
    if device.has_torque:
        np.testing.assert_array_equal(back.dq, reading.dq)
        np.testing.assert_array_equal(back.tau, reading.tau)
        assert back.time == pytest.approx(reading.time, abs=1e-9)
    order = order_for(device, seed)
    obeyed = device.decode(device.encode(order, back), back)
    if device.law != "torque":
        np.testing.assert_array_equal(obeyed.q, order.q)


def record_of(device: Unitree, frame: bytes) -> Any:
    """A frame as numbers that can be changed."""
    return np.frombuffer(frame, device.command if len(frame) == device.command.itemsize else device.state).copy()


def changed(device: Unitree, frame: bytes, **values: int) -> bytes:
    """A frame of which some numbers are others, with its checksum anew."""
    record = record_of(device, frame)
    for name, value in values.items():
        record[name] = value
    return device._sealed(record)


@pytest.mark.parametrize("place", [0, 1, 2, 5, 700, 803, 811])
def test_a_flipped_bit_is_refused(place: int):
    go2 = UnitreeGo2()
    frame = bytearray(go2.encode(order_for(go2, 0), reading_for(go2, 0)))
    frame[place] ^= 1
    with pytest.raises(BadFrame, match="crc"):
        go2.decode(bytes(frame), reading_for(go2, 0))


def test_frames_that_a_robot_would_not_take_are_named():
    g1, go2 = UnitreeG1(), UnitreeGo2()
    readings, orders = ({one: of(one, 0) for one in (g1, go2)} for of in (reading_for, order_for))
    other = replace(readings[g1], mode_machine=(readings[g1].mode_machine + 1) % 256)
    sound = {one: one.encode(orders[one], readings[one]) for one in (g1, go2)}
    off = record_of(g1, sound[g1])
    off["motor_cmd"]["mode"][0, 7] = 0
    for device, frame, said in (
        (g1, g1.encode(orders[g1], other), r"mode_machine is .*; it must be"),
        (g1, g1._sealed(off), "right_hip_roll_joint is 0, so it is off"),
        (go2, changed(go2, sound[go2], head=0), "head"),
    ):
        with pytest.raises(BadFrame, match=said):
            device.decode(frame, readings[device])
    no_answer = changed(g1, g1.report(readings[g1]), mode_pr=2)
    for device, frame, said in (
        *((go2, frame, "must be 1180 bytes") for frame in (b"", bytes(811), "text", None)),
        (go2, bytes(1180), "crc"),
        (g1, no_answer, "mode_pr is 2; it must be 0 or 1"),
    ):
        with pytest.raises(BadFrame, match=said):
            device.unpack(frame)
    assert UnitreeGo2(check=False).unpack(bytes(1180)).time == 0.0


def of_franka(**changed: Any) -> SimpleNamespace:
    return SimpleNamespace(**{"time": 0.0, **dict.fromkeys(("q", "dq", "tau_J", "tau_J_d"), np.zeros(7)), **changed})


def of_group(*names: str, **lists: list[Any]) -> SimpleNamespace:
    return SimpleNamespace(**{"name": [*names], "velocity": [], "effort": [], "position": [], **lists})


JUNK = [
    None, "text", b"", bytes(812), 3.0, [], {}, np.zeros(3), np.zeros((2, 2)), [None, "x"], SimpleNamespace(), object,
    of_group("b", "a", position=["x", 1]), of_group("b", "a"), SimpleNamespace(name=None), of_franka(time=None),
    of_franka(**dict.fromkeys(("q", "dq", "tau_J", "tau_J_d"), np.zeros(6))),
]  # fmt: skip


@pytest.mark.parametrize("device", DEVICES, ids=repr)
def test_what_is_no_frame_at_all_is_a_bad_frame(device: Device):
    for junk in JUNK:
        with pytest.raises(BadFrame):
            device.unpack(junk)
        with pytest.raises(BadFrame):
            device.decode(junk, reading_for(device, 0))


def spoilt(device: Device, frame: Any, bad: float, rng: np.random.Generator) -> Any:
    """A frame of which one number that the device reads is ``bad``."""
    if isinstance(device, Unitree):
        commanded, record = len(frame) == device.command.itemsize, record_of(device, frame)
        part, names = ("motor_cmd", "q dq tau kp kd") if commanded else ("motor_state", "q dq tau_est")
        if not commanded and rng.random() < 0.4:
            record["imu_state"][rng.choice(["quaternion", "gyroscope", "accelerometer"])][0, rng.integers(3)] = bad
        else:
            record[part][rng.choice(names.split())][0, rng.choice(slots(device))] = bad
        return device._sealed(record)
    if isinstance(frame, np.ndarray):
        frame[rng.integers(len(frame))] = bad
    elif isinstance(frame, dict):
        frame[rng.choice(list(frame))] = bad
    elif isinstance(frame, SimpleNamespace):
        frame.position[rng.integers(2)] = bad
    else:
        name = rng.choice(["q", "dq", "tau_J", "tau_J_d"])
        frame = frame._replace(**{name: np.where(np.arange(7) == rng.integers(7), bad, getattr(frame, name))})
    return frame


@pytest.mark.parametrize("device", DEVICES, ids=repr)
@given(seed=seeds, bad=st.sampled_from([np.nan, np.inf, -np.inf, 1e30]))
def test_a_frame_with_a_number_that_is_none_is_a_bad_frame(device: Device, seed: int, bad: float):
    rng, reading = np.random.default_rng(seed), reading_for(device, seed)
    with pytest.raises(BadFrame):
        device.unpack(spoilt(device, device.report(reading), bad, rng))
    answered = device.unpack(device.report(reading))
    with pytest.raises(BadFrame):
        device.decode(spoilt(device, device.encode(order_for(device, seed), answered), bad, rng), answered)


@given(seed=seeds)
def test_what_a_franka_is_sent_changes_by_a_newton_metre_at_most_and_leaves_gravity_out(seed: int):
    rng = np.random.default_rng(seed)
    arm, order = Franka(), order_for(Franka(), seed)
    gravity, sent = rng.normal(0, 20, 7), rng.normal(0, 20, 7)
    order = Order(order.q, order.dq, order.tau, order.kp, order.kd, gravity=gravity)
    reading = Reading(q=rng.normal(size=7), dq=rng.normal(size=7), tau=np.zeros(7), sent=sent)
    frame = arm.encode(order, reading)
    wanted = order.tau + order.kp * (order.q - reading.q) + order.kd * (order.dq - reading.dq) - gravity
    assert (np.abs(frame - sent) <= 1.0).all()
    near = np.abs(wanted - sent) < 0.99
    np.testing.assert_allclose(frame[near], wanted[near])
    assert (np.sign(frame - sent)[~near] == np.sign(wanted - sent)[~near]).all()
    arm.decode(frame, reading)
    with pytest.raises(BadFrame, match=r"changes by 1\.01 N m"):
        arm.decode(sent + 1.01, reading)


def test_a_group_of_ros2_control_is_read_by_name_and_written_in_its_own_order():
    group = Ros2Control(["hip", "knee"], adds_gravity=True)
    reading = group.unpack(of_group("other", "knee", "hip", position=[9, 2, 1], velocity=[9, 4, 3], effort=[9, 6, 5]))
    assert (reading.q.tolist(), reading.dq.tolist(), reading.tau.tolist()) == ([1, 2], [3, 4], [5, 6])
    order = Order([1.5, 2.0], dq=3.0, tau=[10.0, 20.0], kp=2.0, kd=1.0, gravity=[1.0, 2.0])
    np.testing.assert_allclose(group.encode(order, reading), [10 + 1.0 - 1.0, 20 - 1.0 - 2.0])
    without = group.unpack(of_group("hip", "knee", position=[1.0, 2.0]))  # unknown velocities brake nothing
    np.testing.assert_allclose(group.encode(order, without), [10 + 1.0 + 3.0 - 1.0, 20 + 3.0 - 2.0])
    with pytest.raises(BadFrame, match="no 'hip'"):
        group.unpack(of_group("knee", position=[1.0]))


def test_dictionaries_of_degrees_become_radians_through_their_map():
    robot, arm = wbc.load("arm"), LeRobot(wbc.load("arm").joint_names)
    joint_map = arm.joint_map(robot)
    frame = arm.encode(Order(joint_map.position_to_device(np.full(7, np.pi / 6))), None)
    assert frame["elbow.pos"] == pytest.approx(30.0)
    np.testing.assert_allclose(joint_map.position_from_device(arm.unpack(frame).q), np.pi / 6)
    with pytest.raises(BadFrame, match=r"no 'elbow\.pos'"):
        arm.unpack({k: v for k, v in frame.items() if k != "elbow.pos"})


@needs_examples
@pytest.mark.parametrize(("name", "device"), [("g1", UnitreeG1()), ("go2", UnitreeGo2()), ("panda", Franka())])
def test_motors_have_the_names_of_the_published_descriptions(name: str, device: Device):
    joint_map = device.joint_map(wbc.load(name))
    assert sorted(joint_map.index.tolist()) == [*range(len(device.motors))] and joint_map.idle == ()


@given(order=st.permutations(range(7)))
@settings(max_examples=5)
def test_a_map_of_other_motors_drives_none(order: list[int]):
    """Of other names, or of the same in another order: a torque would go to another motor."""
    robot = wbc.load("arm")
    group = Ros2Control(robot.joint_names)
    board = MotorBoard(group, ForwardDynamicsPlant(robot))
    controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.InverseDynamics(), dt=2e-3)
    for motors in ([robot.joint_names[k] for k in order], [f"m{k}" for k in order]):
        joint_map = JointMap.of(robot, motors, names=dict(zip(robot.joint_names, motors, strict=True)))
        if motors == [*robot.joint_names]:
            continue
        for use in (
            lambda m: MotorBoard(group, ForwardDynamicsPlant(robot), joint_map=m),
            lambda m: Loop(board, controller, joint_map=m),
            lambda m: check(board, robot, joint_map=m),
        ):
            with pytest.raises(InvalidInput, match="the motors of the device are"):
                use(joint_map)


@needs_examples
def test_a_part_of_the_robot_is_mapped_by_name():
    robot, arms = wbc.load("g1"), UnitreeG1Arms()
    joint_map = arms.joint_map(robot, joints=arms.motors)
    assert joint_map.index.tolist() == [*range(14)]
    with pytest.raises(UnknownSlot):
        arms.joint_map(robot)


# ---- the makers' own software, where it is installed: ``pip install unitree-sdk2py-dimos pylibfranka``
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
