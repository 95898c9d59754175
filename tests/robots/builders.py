"""Robots, devices and ports that several tests of this folder use."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import wbc
from tests.models.builders import inertial, joint, link, saved
from wbc.robots import JointMap, MotorBoard, UnitreeGo2
from wbc.robots.port import serve

ROOT = Path(__file__).parents[2]
LEGS = {"FR": "front_right", "FL": "front_left", "RR": "rear_right", "RL": "rear_left"}
PARTS = {"hip": "hip_roll", "thigh": "hip_pitch", "calf": "knee"}
#: The motor of each joint of our own quadruped, which stands for a Go2.
GO2_MOTORS = {f"{LEGS[leg]}_{PARTS[part]}": f"{leg}_{part}_joint" for leg in LEGS for part in PARTS}
#: Stiffness [N m/rad] and damping [N m s/rad] that hold our own arm.
GAINS = np.array([200.0, 200, 150, 150, 60, 60, 20]), np.array([10.0, 10, 8, 8, 2, 2, 0.5])


def go2(robot: Any) -> tuple[UnitreeGo2, JointMap]:
    """A Go2 whose motors drive our own quadruped."""
    device = UnitreeGo2()
    return device, device.joint_map(robot, names=GO2_MOTORS)


def board_of(device: Any, robot: Any, *, dt: float = 1e-3, q: Any = None, contacts: Any = (), **settings: Any) -> Any:
    """A motor board in physics, whose motors have rotors: without, light joints chatter in their own damping."""
    from wbc.sim.engine import PhysicsSettings
    from wbc.sim.mujoco_ import MujocoPlant

    plant = MujocoPlant(robot, dt=dt, contacts=contacts, settings=PhysicsSettings(armature=0.01))
    if q is not None:
        plant.reset(q)
    return MotorBoard(device, plant, **settings)


@contextmanager
def served(board: MotorBoard) -> Iterator[int]:
    """The board behind a socket, in real time or slower; the number of its port."""
    stop = threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        thread = threading.Thread(target=serve, args=(board, server, stop.is_set), daemon=True)
        thread.start()
        yield server.getsockname()[1]
        stop.set()
        thread.join(10.0)


def killed_after(ticks: int, *words: str) -> None:
    """Start Python with these words; kill it (SIGKILL) when it has said so many lines, one for each tick."""
    command = [sys.executable, "-W", "ignore", *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, cwd=ROOT, text=True) as script:
        assert script.stdout is not None
        for _ in range(ticks):
            if not script.stdout.readline():
                raise RuntimeError("the script ended by itself")
        script.send_signal(signal.SIGKILL)


class Spoiled:
    """A port whose states are changed on their way, by ``spoil`` of all that came, the last one last."""

    shared = False

    def __init__(self, board: MotorBoard, spoil: Callable[[list[Any]], Any]) -> None:
        self.board, self.device, self.spoil = board, board.device, spoil
        self.clock, self.sleep = board.clock, board.sleep
        self.came: list[Any] = []
        self.sent: list[Any] = []

    def receive(self) -> Any:
        frame = self.board.receive()
        if frame is None:
            return None
        self.came.append(frame)
        return self.spoil(self.came)

    def send(self, frame: Any) -> None:
        self.sent.append(frame)
        self.board.send(frame)


def sliding(folder: Path, reach: float = 2.0) -> Any:
    """An arm whose gripper slides by ``reach`` [m]."""
    names = ("base", "lift", "elbow", "gripper")
    links = [link("l0"), *(link(f"l{k + 1}", inertial()) for k in range(len(names)))]
    joints = []
    for name, ends in zip(names, pairwise(f"l{k}" for k in range(len(names) + 1)), strict=True):
        kind, most = ("prismatic", 0.5 * reach) if name == "gripper" else ("revolute", 1.0)
        limit = f'<limit lower="{-most}" upper="{most}" effort="9" velocity="1"/>'
        joints.append(joint(name, *ends, kind, limit, axis="1 0 0"))
    return wbc.load(saved(folder, *links, *joints, name="own"), base="fixed")
