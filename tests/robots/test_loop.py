"""Loop: torques are continuous at both ends, what arrives is watched, and the robot is held however a run ends."""

from __future__ import annotations

import gc
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tests.robots.builders import GAINS, Spoiled, board_of, go2
from tests.robots.test_devices import order_for
from wbc.errors import InvalidInput
from wbc.robots import BaseEstimator, LeRobot, Loop, MotorBoard, Ros2Control
from wbc.robots.check import _Check
from wbc.robots.device import Order, rotation
from wbc.robots.port import DeviceSilent
from wbc.tasks import JointVelocityLimits, Posture, feet

pytest.importorskip("mujoco")
pytestmark = pytest.mark.physics
ARM = wbc.load("arm")


@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0, 1))
def test_a_mixed_order_gives_the_mixed_torques(seed: int, share: float):
    device, rng = LeRobot(), np.random.default_rng(seed)
    one, other = order_for(device, seed), order_for(device, seed + 1)
    q, dq = rng.normal(size=(2, 5))
    wanted = (1.0 - share) * one.torque(q, dq) + share * other.torque(q, dq)
    np.testing.assert_allclose(one.mixed(other, share).torque(q, dq), wanted, rtol=1e-9, atol=1e-9)
    free = Order(one.q).mixed(Order(other.q), share)
    np.testing.assert_allclose(free.q, (1.0 - share) * one.q + share * other.q)


def torque_loop(spoil: Any = lambda k, frame: frame, *, far: float = 0.1, **settings: Any) -> tuple[Loop, Spoiled]:
    """Of the arm, and its port; ``spoil(k, frame)`` changes the k-th state on its way."""
    board = board_of(Ros2Control(ARM.joint_names, rate=500.0), ARM)
    port = Spoiled(board, lambda came: spoil(len(came), came[-1]))
    controller = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0 + far, kp=100)]), level=wbc.InverseDynamics(), dt=2e-3)
    return Loop(port, controller, rate=500, hold=GAINS, ramp=0.5, **settings), port


def standing_loop(ramp: float, *, q: Any = None, t: float = 0.0, imu: Any = None) -> tuple[Loop, MotorBoard]:
    """Of a quadruped on its feet whose base is estimated, and its board."""
    robot = wbc.load("quadruped")
    q = robot.q0 if q is None else q
    device, joint_map = go2(robot)
    settings = {} if imu is None else {"imu": imu}
    board = board_of(
        device, robot, contacts=feet(robot), joint_map=joint_map, timeout=10.0, on_timeout="hold", **settings
    )
    board.plant.reset(q, t=t)
    base = BaseEstimator(robot, tilt=1e-4)
    base.mount[:] = np.eye(3) if imu is None else imu
    stack = wbc.Stack([Posture(q, kp=100)], contacts=feet(robot, kp=0.0, kd=20.0))
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=2e-3)
    return Loop(board, controller, joint_map=joint_map, base=base, ramp=ramp), board


def test_a_run_reaches_its_target_without_a_jump_and_ends_in_hold():
    loop, port = torque_loop()
    run = loop.run(2.0)
    assert run.meta["ended"] == "complete" and (run["status"] == 0).all() and run.rows == 1000
    last = np.abs(run["error.Posture"][-1])
    assert last[:6].max() < 0.01 and last[6] < 0.06  # the last joint's rotor is ten times as heavy as its link
    sent = np.array(port.sent)
    assert len(sent) == 1001  # the last one holds
    steps = np.abs(np.diff(sent, axis=0)).max(axis=1)
    assert steps.max() < 1.0 and steps[-1] < 0.2
    before = port.board.plant.q
    held = loop._held()
    for _ in range(500):  # what is sent on holds the robot
        port.sleep(2e-3)
        assert loop._receive()
        port.send(port.device.encode(held, loop.reading))
    assert np.abs(port.board.plant.q - before).max() < 0.02


def test_a_run_can_let_the_robot_go():
    loop, port = torque_loop(at_end="release")
    loop.run(0.5)
    assert len(port.sent) == 250 + 250 and np.abs(port.sent[-1] + GAINS[1] * port.board._last.dq).max() < 0.5


def test_what_arrives_is_watched():
    held: list[Any] = []

    def spoil(k: int, frame: Any) -> Any:
        held.append(frame)
        if k == 100:
            return None  # lost
        if k == 150:
            return held[-2]  # repeated
        if k == 200:
            return held[-5]  # out of order
        if k == 250:
            frame.position[2] = float("nan")
            frame.name = frame.name[1:]  # not sound
        return frame

    run = torque_loop(spoil)[0].run(1.0)
    counts = run.meta["loop"]
    assert run.meta["ended"] == "complete"
    assert [counts[name] for name in ("repeated", "out_of_order", "bad")] == [1, 1, 1]
    assert counts["lost"] == 4  # one is missing, three were not used
    assert run["device.age"].max() == pytest.approx(2e-3, abs=1e-6)


@pytest.mark.parametrize("wild", [-1e6, 2, 1e6])
def test_one_wild_stamp_is_one_bad_state(wild: float):
    def spoil(k: int, frame: Any) -> Any:
        if k == 100:
            frame.header.stamp = SimpleNamespace(sec=int(1e7 + wild), nanosec=0)
        else:
            frame.header.stamp.sec += 10**7
        return frame

    run = torque_loop(spoil)[0].run(0.5)
    assert run.meta["ended"] == "complete" and run.meta["loop"]["bad"] == 1
    assert run.meta["loop"]["out_of_order"] == 0 and run.meta["loop"]["lost"] == 1


def test_a_run_goes_on_where_the_counter_of_a_robot_wraps():
    """After 2³² ms, 49.7 days; the estimate of the base and the record see a time that goes on."""
    loop, board = standing_loop(0.1, t=2**32 / 1000 - 0.2)
    run, device = loop.run(0.4), board.device
    assert run.meta["ended"] == "complete" and not loop.base.why
    assert {run.meta["loop"][name] for name in ("bad", "repeated", "out_of_order", "lost")} == {0}
    np.testing.assert_allclose(np.diff(run["device.time"])[2:], 2e-3, atol=1e-6)
    assert device.unpack(device.report(board._last)).time < 0.3, "it has wrapped"


def test_a_check_takes_no_wrap_for_states_out_of_order():
    robot = wbc.load("quadruped", base="fixed")
    device, joint_map = go2(robot)
    board = board_of(device, robot, dt=2e-3, joint_map=joint_map)
    board.plant.reset(robot.q0, t=2**32 / 1000 - 0.2)
    checker = _Check(board, robot, device=device, joint_map=joint_map, hands=None, progress=lambda done: None)
    assert checker.listen(), checker.result


@pytest.mark.parametrize(("first", "last"), [(0, np.inf), (0, 50), (50, np.inf), (50, 100)])
def test_states_without_a_time_are_new_ones(first: float, last: float):
    """Their publisher set no stamp, at all or for a while."""

    def spoil(k: int, frame: Any) -> Any:
        if first <= k < last:
            frame.header.stamp = SimpleNamespace(sec=0, nanosec=0)
        return frame

    run = torque_loop(spoil)[0].run(0.5)
    counts = run.meta["loop"]
    assert run.meta["ended"] == "complete" and np.abs(run["device.q"][-1] - ARM.q0).max() > 0.05
    assert {counts[name] for name in ("repeated", "out_of_order", "bad", "lost")} == {0}


def test_silence_ends_a_run_in_hold():
    loop, port = torque_loop(lambda k, frame: frame if k < 100 else None)
    run = loop.run(5.0)
    assert run.meta["ended"].startswith("no new state for 100 ms") and run.rows < 160
    np.testing.assert_allclose(port.sent[-1], loop._held().torque(loop.reading.q, loop.reading.dq))


def test_without_a_first_state_nothing_is_sent():
    loop, port = torque_loop(lambda k, frame: None)
    with pytest.raises(DeviceSilent, match="no state came in 1 s"):
        loop.run(5.0)
    assert port.sent == []


@pytest.mark.parametrize("fails", ["before_tick", "send", "receive"])
def test_an_error_of_the_script_or_the_port_leaves_a_record(fails: str, tmp_path: Path):
    """And the robot in hold, if orders still reach it."""
    loop, port = torque_loop()
    works = getattr(port, fails, lambda t: None)

    def failing(*given: Any) -> Any:
        if len(port.sent) >= 350:
            raise OSError("the network is unreachable")
        return works(*given)

    setattr(port, fails, failing)
    with pytest.raises(OSError, match="unreachable"):
        loop.run(5.0, before_tick=getattr(port, "before_tick", None), out=tmp_path)
    run = wbc.Run.load(tmp_path)
    assert run.meta["ended"] == "OSError: the network is unreachable" and gc.isenabled()
    assert 349 <= run.rows <= 351
    if fails == "before_tick":
        braked(loop, port)


def braked(loop: Loop, port: Spoiled) -> None:
    """The hold brakes with its damping, as strong as another one before it; nothing else changes at once."""
    most = 2.0 * GAINS[1] * np.abs(np.nan_to_num(loop.reading.dq)) + 1.0
    assert (np.abs(port.sent[-1] - port.sent[-2]) <= most).all()


@pytest.mark.parametrize("at_end", ["hold", "release"])
@pytest.mark.parametrize("tick", [1, 60, 249, 300, 510, 749])
def test_a_run_that_is_interrupted_in_any_phase_ends_in_hold_without_a_jump(tick: int, at_end: str, tmp_path: Path):
    """It comes in until tick 250, ends at 500 and, where it is released, has let go at 750."""
    loop, port = torque_loop(far=1.0, at_end=at_end)
    sleep = port.sleep

    def interrupted(seconds: float) -> None:
        if len(port.sent) == tick:
            port.sleep = loop.port.sleep = sleep
            raise KeyboardInterrupt
        sleep(seconds)

    port.sleep = interrupted
    run = loop.run(1.0, out=tmp_path)
    over = tick >= 500 and at_end == "hold"
    assert run.meta["ended"] == ("complete" if over else "interrupted") == wbc.Run.load(tmp_path).meta["ended"]
    assert run.rows == min(tick, 500) and gc.isenabled()
    if at_end == "hold":
        assert len(port.sent) == min(tick, 500) + 1
    if tick >= 500 or at_end == "hold":
        braked(loop, port)


@pytest.mark.parametrize(("part", "sound"), [("position", False), ("velocity", True), ("effort", True)])
@pytest.mark.parametrize("until", [101, 1000])
def test_numbers_that_are_none_reach_no_motor(part: str, sound: bool, until: int):
    """Without a position a state counts as bad; velocities and efforts are known by some robots only."""

    def spoil(k: int, frame: Any) -> Any:
        if 100 <= k < until:
            getattr(frame, part)[2] = float("nan")
        return frame

    loop, port = torque_loop(spoil)
    run = loop.run(1.0)
    assert np.isfinite(port.sent).all()
    lost = not sound and until > 200
    assert run.meta["ended"].startswith("no new state for 100 ms" if lost else "complete")
    assert run.meta["loop"]["bad"] == (0 if sound else len(port.sent) - 99 if lost else 1)
    braked(loop, port)


class Listening:
    """A guard that listens: when it was told something, by the port's clock, and what."""

    alive = True

    def __init__(self, port: Any, *, silence: float, hold_for: float) -> None:
        self.port, self.silence, self.told, self.dismissed = port, silence, [], False

    def tell(self, order: Order, reading: Any, *, now: bool = False) -> None:
        torque = order.torque(reading.q, 0.0 * reading.q)
        self.told.append((self.port.clock(), torque, now))

    def dismiss(self) -> None:
        self.dismissed = True


@pytest.mark.parametrize("at_end", ["hold", "release"])
def test_a_guard_hears_all_the_time_what_would_hold_the_robot(at_end: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("wbc.robots.loop.Guard", Listening)
    monkeypatch.setattr(Spoiled, "shared", True)
    loop, port = torque_loop(far=1.0, at_end=at_end)
    guards: list[Any] = []
    loop.run(1.0, before_tick=lambda t: guards.append(loop.guard))
    guard = guards[-1]
    times = [t for t, _, _ in guard.told]
    assert np.diff([*times, port.clock()]).max() < guard.silence, "it would take the robot over"
    assert guard.dismissed == (at_end == "release") and guard.told[-1][2] == (at_end == "hold")
    most = np.abs(np.diff(np.array([torque for _, torque, _ in guard.told]), axis=0)).max()
    assert most < 60.0, "what holds the robot follows what is sent"


@pytest.mark.parametrize("turned", [(0.0, 0.0, 1.57), (3.1, 0.0, 0.0), (0.3, -0.5, 2.0)])
@pytest.mark.parametrize("heading", [0.0, 2.97])
def test_a_base_begins_as_its_imu_says_however_that_is_mounted(turned: tuple[float, ...], heading: float):
    robot, q = wbc.load("quadruped"), wbc.load("quadruped").q0.copy()
    q[3:7] = pinocchio.Quaternion(pinocchio.exp3(np.array([0.0, 0.0, heading]))).coeffs()
    loop, board = standing_loop(0.2, q=robot.on_ground(q), imu=pinocchio.exp3(np.array(turned)))
    run = loop.run(0.4)
    told, true = (rotation(one[3:7]) for one in (run["q"][-1], board.plant.q))
    assert np.linalg.norm(pinocchio.log3(told.T @ true)) < 0.01 and not loop.base.why


def test_an_imu_that_says_no_orientation_begins_no_run():
    robot = wbc.load("quadruped")
    device, joint_map = go2(robot)

    def spoil(came: list[bytes]) -> bytes:
        state = np.frombuffer(came[-1], device.state).copy()
        state["imu_state"]["quaternion"] = 0.0
        return bytes(device._sealed(state))

    port = Spoiled(board_of(device, robot, contacts=feet(robot), joint_map=joint_map), spoil)
    controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel(), dt=2e-3)
    with pytest.raises(InvalidInput, match="says no orientation"):
        Loop(port, controller, joint_map=joint_map, base=BaseEstimator(robot)).run(0.1)
    assert port.sent == []


def test_a_setpoint_drives_positions_in_degrees():
    board = board_of(LeRobot(ARM.joint_names), ARM)
    stack = wbc.Stack([Posture(ARM.q0 + 0.2, kp=4)], subject_to=[JointVelocityLimits()])
    controller = wbc.Controller(ARM, stack, level=wbc.VelocityLevel(), dt=0.02)
    run = Loop(board, wbc.Setpoint(controller, max_drift=0.5), rate=50).run(4.0)
    assert np.abs(run["device.q"][-1] - np.degrees(ARM.q0 + 0.2)).max() < 4.0


def test_a_robot_that_nothing_would_hold_is_not_moved():
    weak = ARM.replace(limits=replace(ARM.limits, tau_max=np.array([9.0, 9, 0, 9, 9, 9, 9])))
    controller = wbc.Controller(weak, wbc.Stack([Posture(weak.q0)]), level=wbc.InverseDynamics(), dt=2e-3)
    port = torque_loop()[1]
    with pytest.raises(InvalidInput, match=f"{ARM.joint_names[2]!r} has a torque limit of 0"):
        Loop(port, controller)
    Loop(port, controller, hold=(100.0, 5.0))


def test_a_floating_base_needs_an_estimate():
    robot = wbc.load("quadruped")
    controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel(), dt=2e-3)
    with pytest.raises(InvalidInput, match="which no motor measures; give base"):
        Loop(torque_loop()[1], controller)
