"""Loop: torques are continuous at both ends, what arrives is watched, and the robot is held however a run ends."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tests.robots.test_devices import order_for
from wbc.errors import InvalidInput
from wbc.robots import LeRobot, Loop, MotorBoard, Ros2Control
from wbc.robots.device import Order
from wbc.robots.port import DeviceSilent
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant
from wbc.tasks import JointVelocityLimits, Posture

pytest.importorskip("mujoco")
pytestmark = pytest.mark.physics
ARM = wbc.load("arm")
GAINS = [np.array([200.0, 200, 150, 150, 60, 60, 20]), np.array([10.0, 10, 8, 8, 2, 2, 0.5])]


@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0, 1))
def test_a_mixed_order_gives_the_mixed_torques(seed: int, share: float):
    device, rng = LeRobot(), np.random.default_rng(seed)
    one, other = order_for(device, seed), order_for(device, seed + 1)
    q, dq = rng.normal(size=(2, 5))
    wanted = (1.0 - share) * one.torque(q, dq) + share * other.torque(q, dq)
    np.testing.assert_allclose(one.mixed(other, share).torque(q, dq), wanted, rtol=1e-9, atol=1e-9)
    free = Order(one.q).mixed(Order(other.q), share)
    np.testing.assert_allclose(free.q, (1.0 - share) * one.q + share * other.q)


def arm_plant() -> MujocoPlant:
    """Motors have rotors: without, the light joints at the wrist chatter. The controller does not know of them."""
    return MujocoPlant(ARM, dt=1e-3, settings=PhysicsSettings(armature=0.01))


class Spoiled:
    """A port whose states are changed on their way, by ``spoil(k, frame)``."""

    shared = False

    def __init__(self, board: MotorBoard, spoil: Any) -> None:
        self.board, self.device, self.spoil, self.k = board, board.device, spoil, 0
        self.clock, self.sleep = board.clock, board.sleep
        self.sent: list[Any] = []

    def receive(self) -> Any:
        frame = self.board.receive()
        self.k += frame is not None
        return None if frame is None else self.spoil(self.k, frame)

    def send(self, frame: Any) -> None:
        self.sent.append(frame)
        self.board.send(frame)


def torque_loop(spoil: Any = lambda k, frame: frame, **settings: Any) -> tuple[Loop, Spoiled]:
    plant = arm_plant()
    port = Spoiled(MotorBoard(Ros2Control(ARM.joint_names, rate=500.0), plant), spoil)
    target = ARM.q0 + 0.1
    controller = wbc.Controller(ARM, wbc.Stack([Posture(target, kp=100)]), level=wbc.InverseDynamics(), dt=2e-3)
    return Loop(port, controller, rate=500, hold=tuple(GAINS), ramp=0.5, **settings), port


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
    held = Order(loop.reading.q, 0.0, loop._order.tau, *loop._hold)
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
    assert {name: counts[name] for name in ("repeated", "out_of_order", "bad")} == dict.fromkeys(
        ("repeated", "out_of_order", "bad"), 1
    )
    assert counts["lost"] == 4  # one is missing, three were not used
    assert run["device.age"].max() == pytest.approx(2e-3, abs=1e-6)


def test_silence_ends_a_run_in_hold():
    loop, port = torque_loop(lambda k, frame: frame if k < 100 else None)
    run = loop.run(5.0)
    assert run.meta["ended"].startswith("no new state for 100 ms") and run.rows < 160
    np.testing.assert_allclose(port.sent[-1], loop._held(loop._order.tau).torque(loop.reading.q, loop.reading.dq))


def test_without_a_first_state_nothing_is_sent():
    loop, port = torque_loop(lambda k, frame: None)
    with pytest.raises(DeviceSilent, match="no state came in 1 s"):
        loop.run(5.0)
    assert port.sent == []


@pytest.mark.parametrize("raised", [KeyboardInterrupt, RuntimeError])
def test_an_interrupt_and_an_error_end_in_hold_and_are_recorded(raised: type[BaseException], tmp_path: Path):
    loop, port = torque_loop()

    def before_tick(t: float) -> None:
        if t > 0.7:
            raise raised("by the test")

    if raised is RuntimeError:
        with pytest.raises(RuntimeError):
            loop.run(5.0, before_tick=before_tick, out=tmp_path)
        run = wbc.Run.load(tmp_path)
        assert run.meta["ended"] == "RuntimeError: by the test"
    else:
        run = loop.run(5.0, before_tick=before_tick)
        assert run.meta["ended"] == "interrupted"
    assert 300 < run.rows < 400
    # It brakes with the damping of the hold; nothing else changes at once.
    braking = GAINS[1] * np.abs(loop.reading.dq)
    assert (np.abs(port.sent[-1] - port.sent[-2]) <= braking + 0.3).all()


def test_a_setpoint_drives_positions_in_degrees():
    device = LeRobot(ARM.joint_names)
    plant = arm_plant()
    board = MotorBoard(device, plant)
    stack = wbc.Stack([Posture(ARM.q0 + 0.2, kp=4)], subject_to=[JointVelocityLimits()])
    controller = wbc.Controller(ARM, stack, level=wbc.VelocityLevel(), dt=0.02)
    run = Loop(board, wbc.Setpoint(controller, max_drift=0.5), rate=50).run(4.0)
    assert np.abs(run["device.q"][-1] - np.degrees(ARM.q0 + 0.2)).max() < 4.0


@pytest.mark.parametrize(
    ("bad", "match"),
    [({"rate": 1000}, "give it dt"), ({"ramp": 0.0}, "ramp"), ({"at_end": "fall"}, "at_end"), ({"kp": -1.0}, "kp")],
)
def test_settings_that_make_no_sense_are_refused(bad: dict[str, Any], match: str):
    loop, port = torque_loop()
    with pytest.raises(InvalidInput, match=match):
        Loop(port, loop.controller, **bad)


def test_a_floating_base_needs_an_estimate():
    robot = wbc.load("quadruped")
    controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel(), dt=2e-3)
    with pytest.raises(InvalidInput, match="which no motor measures; give base"):
        Loop(torque_loop()[1], controller)
