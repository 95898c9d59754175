"""Robots that stand through their own bytes: frames at 500 Hz, orders 2 ms late, sensors with noise, an estimated base.

    python3 -m tests.robots.stands go2 10

lets the robot stand in MuJoCo and pushes it twice, once for each seed, and prints how it went. What plays the robot is
a motor board; what ends a run is a hold by motors alone.

    python3 -m tests.robots.stands go2 10 kill

has the controller in another process, behind UDP, and kills it (SIGKILL) at a moment that the seed draws, pushes or
not.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import wbc
from tests.robots.builders import killed_after, served
from wbc.robots import SENSORS, BaseEstimator, Loop, MotorBoard, Udp, UnitreeG1, UnitreeGo2
from wbc.sim.disturbance import Push
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant
from wbc.tasks import CenterOfMass, JointPositionLimits, Orientation, Posture, TorqueLimits, feet

#: The device of each robot, and the link that is kept upright and pushed.
ROBOTS: Mapping[str, tuple[Any, str]] = {"go2": (UnitreeGo2, "base"), "g1": (UnitreeG1, "torso_link")}
SENSOR_SET, RATE, DELAY, FORCE = "mti-300", 500.0, 2e-3, 30.0
#: Pushed sideways and forward at these times [s] for so long [s]; the run ends, and the robot is held for so long [s].
PUSHES, LASTS, ENDS, HELD = ((1.5, (0.0, FORCE, 0.0)), (3.0, (FORCE, 0.0, 0.0))), 0.2, 4.5, 2.0


@dataclass
class Stood:
    """How a robot stood: how the run ended, whether it fell, the largest and the last error of its centre of mass [m],
    by how much its base went on while it was held [m], orders that it refused, share of certified ticks."""

    ended: str
    fallen: bool
    largest: float
    last: float
    held: float
    refused: int
    certified: float

    @property
    def ok(self) -> bool:
        """Whether it stood, came back to within 10 mm, and was held."""
        return self.ended == "complete" and not self.fallen and max(self.last, self.held) < 0.01 and not self.refused


def board_of(name: str, seed: int, **settings: Any) -> MotorBoard:
    """The robot, on its feet, at rest."""
    make, pushed = ROBOTS[name]
    device, robot = make(), wbc.load(name)
    plant = MujocoPlant(robot, contacts=feet(robot), settings=PhysicsSettings(armature=0.01))
    plant.reset(plant.settled(robot.q0))
    pushes = [Push(pushed, force, start, LASTS) for start, force in PUSHES]
    settings |= {"delay": DELAY, "sensors": SENSORS[SENSOR_SET], "disturbances": pushes, "seed": seed}
    return MotorBoard(device, plant, mode_machine=5, **settings)


def loop_of(name: str, port: Any, **settings: Any) -> Loop:
    """A controller that lets the robot stand, and the estimate of its base, behind any port."""
    robot, sensors = wbc.load(name), SENSORS[SENSOR_SET]
    upright = ROBOTS[name][1]
    state = robot.state()
    tasks = [
        CenterOfMass(target=state.com.copy(), kp=100),
        Orientation(upright, target=np.array(state.frame(upright).rotation), kp=100),
        Posture(robot.q0, kp=100, weight=1e-3),
    ]
    contacts = feet(robot, friction_share=0.8, kp=0.0, kd=20.0)
    limits = [TorqueLimits(), JointPositionLimits(braking=40.0)]
    stack = wbc.Stack(tasks, contacts=contacts, subject_to=limits)
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=1.0 / RATE)
    base = BaseEstimator(
        robot, noise=sensors.imu, joint=sensors.joint_position, joint_rate=sensors.joint_velocity, tilt=sensors.tilt
    )
    return Loop(port, controller, base=base, ramp=0.5, **settings)


def stood(name: str, seed: int) -> Stood:
    """One run: it stands, is pushed twice, and is held when the run ends."""
    board = board_of(name, seed, timeout=10.0, on_timeout="hold")
    run = loop_of(name, board).run(ENDS)
    before = board.plant.q[:3].copy()
    board.sleep(HELD)
    error = np.linalg.norm(run["error.CenterOfMass"], axis=1)
    return Stood(
        str(run.meta["ended"]), board.plant.fallen, float(error.max()), float(error[-1]),
        float(np.linalg.norm(board.plant.q[:3] - before)), board.refused, float((run["status"] == 0).mean()),
    )  # fmt: skip


@dataclass
class Killed:
    """How a robot went on whose script was killed at ``t`` [s]: whether it fell, how far its base went [m], how long
    its motors were without orders at most [s]."""

    t: float
    fallen: bool
    moved: float
    silent: float

    @property
    def ok(self) -> bool:
        """Whether the guard holds it."""
        return not self.fallen and self.moved < 0.05 and self.silent < TIMEOUT


#: Motors without orders for so long go limp [s]; a killed script is looked after for so long [s].
TIMEOUT, AFTER = 0.2, 1.5


def killed(name: str, seed: int) -> Killed:
    """Start the script, kill it, and see what its guard does; the robot runs in real time, or slower."""
    board = board_of(name, seed, timeout=TIMEOUT, on_timeout="limp")
    ticks = int(np.random.default_rng(seed).integers(300, 2000))
    with served(board) as port:
        killed_after(ticks, "-m", "tests.robots.stands", name, "drive", str(port))
        t, before, silent = board.plant.t, board.plant.q[:3].copy(), 0.0
        while board.plant.t < t + AFTER:
            time.sleep(2e-3)
            silent = max(silent, board.plant.t - board._ordered)
    return Killed(t, board.plant.fallen, float(np.linalg.norm(board.plant.q[:3] - before)), silent)


def drive(name: str, port: str) -> None:
    """The script that is killed; its guard holds a little longer than anybody looks."""
    address = ("127.0.0.1", int(port))
    loop = loop_of(name, Udp(ROBOTS[name][0](), address), patience=5.0, hold_for=AFTER + 3.0)
    loop.run(before_tick=lambda t: print(t, flush=True))


def main(name: str, what: str, more: str = "") -> None:
    """Print a table."""
    if what == "drive":
        drive(name, more)
        return
    print(f"{name}: {RATE:g} Hz, orders {1e3 * DELAY:g} ms late, {SENSOR_SET}, two pushes of {FORCE:g} N")
    for seed in range(int(what)):
        if more == "kill":
            end = killed(name, seed)
            said = (
                f"killed at {end.t:.2f} s, base went {1e3 * end.moved:.1f} mm, {1e3 * end.silent:.0f} ms without orders"
            )
            print(f"  seed {seed}: {'held' if end.ok else 'FAILED'}; {said}", flush=True)
            continue
        one = stood(name, seed)
        said = f"centre of mass at most {1e3 * one.largest:.1f} mm off, {1e3 * one.last:.1f} at the end"
        said += f"; {1e3 * one.held:.1f} mm while held; {one.certified:.4f} certified"
        print(f"  seed {seed}: {'stood' if one.ok else 'FAILED'}; {one.ended}; {said}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
