"""A killed script: its guard, another process, holds the robot. The robot is a board that runs in real time here."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

import wbc
from tasks import Posture
from tests.robots.builders import board_of, go2, killed_after, served
from wbc.robots import Loop, MotorBoard, Udp, UnitreeGo2
from wbc.robots.device import Order, Reading
from wbc.robots.guard import Guard

SCRIPT = """
import sys, wbc
from tests.robots.builders import go2
from wbc.robots import Loop, Udp
from wbc.tasks import Posture
robot = wbc.load("quadruped", base="fixed")
device, joint_map = go2(robot)
controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0, kp=100)]), level=wbc.InverseDynamics(), dt=2e-3)
port = Udp(device, ("127.0.0.1", int(sys.argv[1])))
loop = Loop(port, controller, joint_map=joint_map, guard=sys.argv[2] == "guard", hold_for=2.0, patience=5.0, ramp=0.1)
loop.run(before_tick=lambda t: print("tick", flush=True))
"""


@pytest.fixture
def robot() -> Iterator[tuple[MotorBoard, int]]:
    """A board behind a socket, and its port; it goes limp where orders stop for 0.2 s."""
    pytest.importorskip("mujoco")
    model = wbc.load("quadruped", base="fixed")
    device, joint_map = go2(model)
    board = board_of(device, model, dt=2e-3, joint_map=joint_map, timeout=0.2, on_timeout="limp")
    with served(board) as port:
        yield board, port


def waited(board: MotorBoard, seconds: float) -> None:
    """Until the board's own time has passed."""
    until = board.plant.t + seconds
    while board.plant.t < until:
        time.sleep(0.01)


@pytest.mark.slow
@pytest.mark.physics
def test_a_killed_script_ends_in_hold(robot: tuple[MotorBoard, int]):
    board, port = robot
    killed_after(200, "-c", SCRIPT, str(port), "guard")
    before, ordered = board.plant.q, board._ordered
    waited(board, 0.6)
    assert board._ordered > ordered + 0.3, "the guard goes on sending"
    assert np.abs(board.plant.q - before).max() < 0.05
    assert board.refused == 0
    deadline = time.monotonic() + 60.0
    while board.plant.t - board._ordered < 0.5 and time.monotonic() < deadline:
        time.sleep(0.05)
    assert board.plant.t - board._ordered >= 0.5, "the guard ends after the time that it was given"


def _may_be_real_time() -> bool:
    """Whether a process may have real-time priority here; containers often refuse."""
    words = [sys.executable, "-c", "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))"]
    return subprocess.run(words, check=False, stderr=subprocess.DEVNULL).returncode == 0


@pytest.mark.slow
def test_a_guard_that_is_stopped_stops_no_loop():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        port = Udp(UnitreeGo2(), server.getsockname())
        guard = Guard(port, silence=0.05, hold_for=1.0)
        if hasattr(os, "SCHED_FIFO") and os.geteuid() == 0 and _may_be_real_time():
            assert os.sched_getscheduler(guard.process.pid) == os.SCHED_FIFO
        os.kill(guard.process.pid, signal.SIGSTOP)
        told = threading.Thread(target=_tell, args=(guard, 2000), daemon=True)
        told.start()
        told.join(20.0)
        waits = told.is_alive()
        guard.dismiss()
        port._socket.close()
    assert not waits and not guard.alive


@pytest.mark.slow
@pytest.mark.physics
def test_a_guard_that_dies_ends_no_run_and_the_next_run_has_another(robot: tuple[MotorBoard, int]):
    board, number = robot
    device, joint_map = go2(board.plant.model)
    stack = wbc.Stack([Posture(board.plant.model.q0, kp=100)])
    controller = wbc.Controller(board.plant.model, stack, level=wbc.InverseDynamics(), dt=2e-3)
    port = Udp(device, ("127.0.0.1", number))
    loop = Loop(port, controller, joint_map=joint_map, patience=5.0)
    whole = loop.run(0.1)

    def kill(t: float) -> None:
        assert loop.guard is not None
        loop.guard.process.kill()
        loop.guard.process.wait()

    without, again = loop.run(0.1, before_tick=kill), loop.run(0.1)
    loop.release()
    port._socket.close()
    assert [run.meta["ended"] for run in (whole, without, again)] == ["complete"] * 3
    assert [run.meta["loop"]["guarded"] for run in (whole, without, again)] == [True, False, True]


def _tell(guard: Guard, times: int) -> None:
    nothing = np.zeros(12)
    for _ in range(times):
        guard.tell(Order(nothing), Reading(q=nothing, dq=nothing, tau=nothing))


@pytest.mark.slow
@pytest.mark.physics
def test_without_a_guard_a_killed_script_lets_the_robot_fall(robot: tuple[MotorBoard, int]):
    board, port = robot
    killed_after(200, "-c", SCRIPT, str(port), "alone")
    before = board.plant.q
    waited(board, 1.0)
    assert np.abs(board.plant.q - before).max() > 0.2
