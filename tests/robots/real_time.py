"""How even a torque loop at 1 kHz is: a Franka's frames, a controller, and a motor board that keeps up with the clock.

    python3 -m tests.robots.real_time 600

runs for ten minutes in one process and prints the periods between ticks, and the time that a tick takes.
"""

from __future__ import annotations

import sys
import time
from typing import Any, final

import numpy as np

import wbc
from wbc.control.recorder import Run
from wbc.robots import Franka, Loop, MotorBoard
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant
from wbc.tasks import JointLimits, Position, Posture
from wbc.types import Vec


@final
class RealTime:
    """A port to a board whose time follows that of the machine; physics is done before the wait, not after it."""

    shared = False

    def __init__(self, board: MotorBoard) -> None:
        self.device, self.board = board.device, board
        self.receive, self.send = board.receive, board.send
        self._start = time.monotonic() - board.clock()

    clock = staticmethod(time.monotonic)

    def sleep(self, seconds: float) -> None:
        """Let the board move up to the end of the wait, and wait."""
        end = time.monotonic() + seconds
        self.board.sleep(max(0.0, end - self._start - self.board.clock()))
        time.sleep(max(0.0, end - time.monotonic()))


def ran(seconds: float) -> tuple[Run, Vec]:
    """The run, and the periods [s] between its ticks."""
    robot, device = wbc.load("arm"), Franka()
    joint_map = device.joint_map(robot, names=dict(zip(robot.joint_names, device.motors, strict=True)))
    middle = np.array([0.45, 0.0, 0.45])
    tool = Position("tool", target=middle, kp=100.0)
    stack = wbc.Stack([tool, Posture(robot.q0, kp=50.0, weight=1e-2)], subject_to=[JointLimits()])
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=1e-3)
    plant = MujocoPlant(robot, settings=PhysicsSettings(armature=0.01))
    port: Any = RealTime(MotorBoard(device, plant, joint_map=joint_map, timeout=1.0))
    began: list[float] = []

    def before_tick(t: float) -> None:
        began.append(time.perf_counter())
        tool.target = middle + np.array([0.0, 0.1 * np.sin(t), 0.0])

    run = Loop(port, controller, rate=1000, joint_map=joint_map).run(seconds, before_tick=before_tick)
    return run, np.diff(began)


def main(seconds: str) -> None:
    """Print the figures."""
    run, periods = ran(float(seconds))
    milliseconds, counts = 1e3 * periods, run.meta["loop"]
    p = {share: np.percentile(milliseconds, share) for share in (50, 99, 99.9)}
    print(f"{run.rows} ticks, {run.meta['ended']}; {float((run['status'] == 0).mean()):.6f} solved")
    print(f"period: median {p[50]:.3f} ms, p99 {p[99]:.3f}, p99.9 {p[99.9]:.3f}, worst {milliseconds.max():.3f}")
    print(f"late {counts['late']}, missed {counts['missed']}, states lost {counts['lost']}, bad {counts['bad']}")
    tick = run["tick_us"]
    print(f"tick: median {np.median(tick):.0f} µs, p99 {np.percentile(tick, 99):.0f}, worst {tick.max():.0f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
