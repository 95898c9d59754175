"""Random trees of joints against an independent oracle: ``python -m tests.families.robots --count 1000 --ticks 100``.

Trees of 1 to 60 joints, revolute and prismatic, tiny links among them, at the three levels, with limits on position,
velocity, acceleration and torque at random. Every tick must keep its limits and its certificate; one in ten is judged
by the oracle. ``--first K`` goes on from case K of this seed; what was found so far is printed every minute.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import tasks as T
import wbc
from tests.families.oracle import undamped
from tests.families.progress import Family, Ticks, followed

LEVELS = (wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics())
SOLVERS = ("pdas", "pdas", "daqp", "clarabel", "proxqp")


def tree(rng: np.random.Generator, light: float = 0.1) -> str:
    """A URDF of a random tree, with this share of links of less than a gram."""
    joints = int(rng.integers(1, 61)) if rng.uniform() < 0.3 else int(rng.integers(1, 13))
    links, bars = ['<link name="base"/>'], []
    for i in range(joints):
        mass = 10.0 ** rng.uniform(-6.0, -3.0) if rng.uniform() < light else rng.uniform(0.1, 5.0)
        inertia = mass * rng.uniform(0.01, 0.05)
        x, y, z = rng.uniform(-0.2, 0.2, 3)
        links.append(
            f'<link name="l{i}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{mass}"/><inertia ixx="{inertia}" '
            f'iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        parent = "base" if i == 0 else f"l{i - 1 if rng.uniform() < 0.8 else int(rng.integers(i))}"
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        kind = "prismatic" if rng.uniform() < 0.2 else "revolute"
        a, b, c = rng.uniform(-0.3, 0.3, 3)
        half = rng.uniform(0.3, 2.5)
        bars.append(
            f'<joint name="j{i}" type="{kind}"><parent link="{parent}"/><child link="l{i}"/>'
            f'<origin xyz="{a} {b} {c}" rpy="{a} {b} {c}"/><axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>'
            f'<limit lower="{-half}" upper="{half}" velocity="{rng.uniform(0.5, 5.0)}" '
            f'effort="{10.0 ** rng.uniform(0.0, 2.5)}"/></joint>'
        )
    return '<robot name="tree">' + "".join(links + bars) + "</robot>"


def draw(seed: int, folder: Path, light: float = 0.1) -> tuple[wbc.Controller, np.ndarray, np.ndarray, str]:
    """A controller, where it starts, and what it is."""
    rng = np.random.default_rng(seed)
    path = folder / "tree.urdf"
    path.write_text(tree(rng, light))
    robot: Any = wbc.load(str(path))
    level = LEVELS[rng.integers(3)]
    tip = f"l{robot.nj - 1}"
    weights = 10.0 ** rng.uniform(-3.0, 3.0, 3)
    tasks: list[list[Any]] = [[T.Position(tip, target=rng.normal(size=3), weight=weights[0])]]
    if rng.uniform() < 0.5:
        tasks.append([T.Orientation(tip, target=np.eye(3), weight=weights[1])])
    tasks.append([T.Posture(robot.q0, weight=1e-3 * weights[2])])
    limits: list[Any] = [T.JointVelocityLimits()]
    limits += [T.JointPositionLimits()] if rng.uniform() < 0.7 else []
    limits += [T.JointAccelerationLimits(float(rng.uniform(5.0, 100.0)))] if rng.uniform() < 0.4 else []
    limits += [T.TorqueLimits()] if level.dynamics and rng.uniform() < 0.7 else []
    hierarchy = wbc.Weighted() if rng.uniform() < 0.6 else wbc.Strict()
    index = int(rng.integers(len(SOLVERS)))
    control = wbc.Controller(
        robot, wbc.Stack(tasks, subject_to=limits), level=undamped(level, hierarchy), hierarchy=hierarchy,
        solver=SOLVERS[index], dt=1e-3,
    )  # fmt: skip
    q = np.array(robot.q0)
    return control, q, np.zeros(robot.nv), f"{level.name}, {type(hierarchy).__name__}, {SOLVERS[index]}"


def ticked(case: int, ticks: int) -> Ticks:
    """The controller, each of its commands, and what it is."""
    with tempfile.TemporaryDirectory() as folder:
        yield from followed(*draw(case, Path(folder)), ticks)


FAMILY = Family(ticked, every=10)

if __name__ == "__main__":
    FAMILY.command(__doc__, ticks=100)
