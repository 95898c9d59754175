"""Ros2Port: a loop drives an arm over topics of ROS 2; the robot is another process that speaks as ros2_control does.

Needs ``rclpy``, from ROS or the extra ``ros2``; without it these tests are skipped.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest

import wbc
from tests.robots.builders import GAINS, ROOT, killed_after
from wbc.robots import Loop, Ros2Control, Ros2Port
from wbc.tasks import Posture

pytest.importorskip("rclpy", reason="needs ROS 2: rclpy")
pytest.importorskip("mujoco")
pytestmark = [
    pytest.mark.physics,
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of what rclpy imports
]
ARM = wbc.load("arm")
#: What a hardware of ros2_control does: states on one topic, its joints in an order of their own, efforts from another.
ROBOT = """
import sys, time, rclpy, wbc
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from wbc.robots import MotorBoard, Ros2Control
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant
import numpy as np
arm = wbc.load("arm")
device = Ros2Control(arm.joint_names, rate=500.0)
plant = MujocoPlant(arm, dt=2e-3, settings=PhysicsSettings(armature=0.01))
board = MotorBoard(device, plant, timeout=0.3, on_timeout="limp")
rclpy.init()
node = rclpy.create_node("robot")
states = node.create_publisher(JointState, "joint_states", 10)
node.create_subscription(
    Float64MultiArray, "effort_controller/commands", lambda message: board.send(np.array(message.data)), 10
)
due = time.monotonic()
while rclpy.ok():
    rclpy.spin_once(node, timeout_sec=max(0.0, due - time.monotonic()))
    if time.monotonic() < due:
        continue
    due = time.monotonic() + 2e-3
    board.sleep(2e-3)
    said = board.receive()
    if said is None:
        continue
    message = JointState(name=said.name[::-1], position=said.position[::-1], velocity=said.velocity[::-1])
    message.effort = said.effort[::-1]
    message.header.stamp.sec, message.header.stamp.nanosec = said.header.stamp.sec, said.header.stamp.nanosec
    states.publish(message)
"""
SCRIPT = """
from tests.robots.test_ros2_port import loop
loop(hold_for=10.0).run(before_tick=lambda t: print("tick", flush=True))
"""


def loop(**other: float) -> Loop:
    """A controller that goes to a posture beside q0, 500 times a second."""
    device = Ros2Control(ARM.joint_names, rate=500.0)
    controller = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0 + 0.1, kp=60)]), level=wbc.InverseDynamics(), dt=2e-3)
    port = Ros2Port(device, commands="effort_controller/commands")
    return Loop(port, controller, hold=GAINS, ramp=0.3, patience=2.0, **other)


@pytest.fixture(autouse=True)
def robot(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The robot, on a domain of its own."""
    monkeypatch.setenv("ROS_DOMAIN_ID", "87")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, "-c", ROBOT], env=environment, cwd=ROOT) as process:
        yield
        process.kill()


def heard(port: Ros2Port, seconds: float) -> np.ndarray:
    """Positions of the joints that come in so much time, once one has come."""
    latest, until, rows = time.monotonic() + 20.0, np.inf, []
    while time.monotonic() < min(until, latest):
        port.sleep(2e-3)
        until = min(until, time.monotonic() + seconds) if rows else np.inf
        if (message := port.receive()) is not None:
            rows.append(port.device.unpack(message).q)
    return np.array(rows)


def test_a_run_over_topics_reaches_its_target_and_is_held():
    driven = loop(hold_for=10.0)
    try:
        run = driven.run(3.0)
        assert run.meta["ended"] == "complete" and (run["status"] == 0).all()
        assert np.abs(run["device.q"][-1] - ARM.q0 - 0.1)[:6].max() < 0.02
        rows = heard(driven.port, 1.0)  # the guard, a node of another process, holds
        assert len(rows) > 20 and np.abs(rows - rows[0]).max() < 0.02
    finally:
        driven.release()
        driven.port.close()


def test_a_killed_script_is_held_by_its_guard():
    killed_after(200, "-c", SCRIPT)
    port = Ros2Port(Ros2Control(ARM.joint_names, rate=500.0))
    rows = heard(port, 1.5)  # it would go limp after 0.3 s
    port.close()
    assert len(rows) > 20 and np.abs(rows[len(rows) // 2 :] - rows[len(rows) // 2]).max() < 0.03
