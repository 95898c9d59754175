"""Arms drawn at random whose motors can hold them up everywhere, and the motion that their torques give."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio

import wbc
from wbc.models.model import RobotModel
from wbc.types import Vec


def arm(seed: int, folder: Path, *, share: float = 0.7) -> tuple[RobotModel, Vec]:
    """A tree of 1 to 7 joints, and torque limits (nj,) of which holding still takes at most ``share``."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    branching = rng.random() < 0.25
    parts = ['<link name="l0"/>']
    for i in range(1, n + 1):
        parent = int(rng.integers(0, i)) if branching else i - 1
        sliding = rng.random() < 0.12
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.6 else rng.normal(size=3)
        axis = axis / np.linalg.norm(axis)
        place = rng.uniform(-0.4, 0.4, 3) if i > 1 else np.zeros(3)
        low = -rng.uniform(0.2, 2.9) * (0.2 if sliding else 1.0)
        high = rng.uniform(0.2, 2.9) * (0.2 if sliding else 1.0)
        mass, size = 10 ** rng.uniform(-1, 1), rng.uniform(0.03, 0.3, 3)
        xx, yy, zz = mass / 12.0 * (size @ size - size**2)
        com = rng.uniform(-0.25, 0.25, 3)
        kind = "prismatic" if sliding else "revolute"
        parts.append(
            f'<link name="l{i}"><inertial><origin xyz="{_text(com)}"/><mass value="{mass}"/>'
            f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{i}" type="{kind}"><parent link="l{parent}"/><child link="l{i}"/>'
            f'<origin xyz="{_text(place)}"/><axis xyz="{_text(axis)}"/>'
            f'<limit lower="{low}" upper="{high}" velocity="{rng.uniform(0.5, 6.0)}" effort="1000"/></joint>'
        )
    path = folder / f"arm{seed}.urdf"
    path.write_text(f'<robot name="arm{seed}">{"".join(parts)}</robot>')
    robot = wbc.load(str(path))
    return robot, np.maximum(holding_torque(robot, seed) / share, rng.uniform(0.05, 2.0, robot.nj))


def holding_torque(robot: RobotModel, seed: int = 0) -> Vec:
    """What holding still takes of each joint (nj,) at most, in 400 configurations within the limits and 200 corners."""
    rng, data = np.random.default_rng(seed), robot.pinocchio.createData()
    low, high = robot.limits.q_min, robot.limits.q_max
    poses = [*rng.uniform(low, high, (400, robot.nj)), low, high]
    poses += [np.where(rng.random(robot.nj) < 0.5, low, high) for _ in range(200)]
    gravity = [np.abs(pinocchio.computeGeneralizedGravity(robot.pinocchio, data, q)) for q in poses]
    worst: Vec = np.max(gravity, axis=0)
    return worst


def _text(vector: Vec) -> str:
    return " ".join(repr(float(entry)) for entry in vector)


def restless_posture(robot: RobotModel, seed: int, every: float) -> Any:
    """Joint positions as a function of time, far beyond the limits or at them, others every ``every`` seconds."""
    low, high = robot.limits.q_min, robot.limits.q_max
    middle, half = 0.5 * (low + high), 0.5 * (high - low)

    def target(t: float) -> Vec:
        if t == 0.0:
            return middle
        rng = np.random.default_rng((seed, int(t / every)))
        return middle + half * rng.choice([1.0, 3.0]) * rng.uniform(-1.5, 1.5, robot.nj)

    return target


def walk(robot: RobotModel, controller: wbc.Controller, q: Vec, v: Vec, ticks: int) -> Counter[str]:
    """Follow the torques of ``controller`` through rigid-body dynamics and q + v dt + a dt²/2; count ticks by kind.

    "outside" and "too fast" are ticks that end more than 1e-6 beyond a limit on position or velocity; with the status
    and the fallback level behind it they are counted by these too. "worst" is the largest excess of position [nm].
    """
    data, dt, found = robot.pinocchio.createData(), controller.dt, Counter[str]()
    low, high, fast = robot.limits.q_min, robot.limits.q_max, robot.limits.v_max
    for k in range(ticks):
        command = controller.tick(k * dt, q, v)
        a = pinocchio.aba(robot.pinocchio, data, q, v, np.array(command.tau))
        q, v = q + v * dt + 0.5 * a * dt**2, v + a * dt
        kind = f"{command.status.name}/{command.fallback_level}"
        excess = float(np.maximum(low - q, q - high).max())
        found["ticks"] += 1
        found[kind] += 1
        found["worst [nm]"] = max(found["worst [nm]"], round(1e9 * excess))
        if excess > 1e-6:
            found["outside"] += 1
            found[f"outside {kind}"] += 1
        if float((np.abs(v) - fast).max()) > 1e-6:
            found["too fast"] += 1
            found[f"too fast {kind}"] += 1
    return found
