"""Robots with two arms drawn at random, that carry boxes, rods and stones turned anyhow, and are sent to one point."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio

import wbc
from tasks import CollisionAvoidance, JointLimits, Position, Posture
from wbc.models.collision import Distances
from wbc.models.model import RobotModel
from wbc.stack.formulation import Formulation
from wbc.types import Vec

MARGIN, DT = 0.03, 2e-3
VELOCITIES = wbc.VelocityLevel()
_AXES = (1, 2, 0, 1, 0, 1, 2)


class Meeting(NamedTuple):
    """What came of it."""

    nearest: float  #: the smallest distance [m]
    fastest: float  #: the fastest joint of the last half second [rad/s]
    shaking: float  #: what a joint's velocity changes in a tick and takes back within 20 ms, in that time [rad/s]
    ok: bool  #: whether every tick was answered


def pair_of_arms(seed: int, folder: Path) -> RobotModel:
    """Two mirrored arms of six or seven joints, with a shape each instead of a hand and one instead of a forearm."""
    rng = np.random.default_rng(seed)
    n, upper, lower = int(rng.integers(6, 8)), *rng.uniform(0.2, 0.35, 2)
    inertia = (
        '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    parts = [f'<link name="trunk">{inertia}</link>']
    for side, sign in (("left", 1.0), ("right", -1.0)):
        parent = "trunk"
        for i, axis in enumerate(_AXES[:n]):
            along = {0: np.array([0.0, sign * 0.25, 0.0]), 3: np.array([upper, 0.0, 0.0])}.get(i, np.zeros(3))
            along = np.array([lower, 0.0, 0.0]) if i == 4 else along
            name = f"{side}_{'hand' if i == n - 1 else i}"
            shape = _hand(rng, folder / f"{seed}_{side}.stl") if i == n - 1 else ""
            if i == 3:
                shape = _collision(
                    f'<cylinder radius="0.04" length="{0.6 * lower}"/>', [0.45 * lower, 0, 0], [0, 1.57, 0]
                )
            parts.append(
                f'<link name="{name}">{inertia}{shape}</link><joint name="{side}_joint_{i}" type="revolute">'
                f'<parent link="{parent}"/><child link="{name}"/><origin xyz="{_text(along)}"/>'
                f'<axis xyz="{_text(np.eye(3)[axis])}"/>'
                f'<limit lower="-2.8" upper="2.8" velocity="{rng.uniform(1.5, 6.0)}" effort="100"/></joint>'
            )
            parent = name
    path = folder / f"arms{seed}.urdf"
    path.write_text(f'<robot name="arms{seed}">{"".join(parts)}</robot>')
    return wbc.load(str(path))


def _hand(rng: np.random.Generator, mesh: Path) -> str:
    """A box, a rod or a stone with flat faces, somewhere about the last joint, turned anyhow."""
    kind, size = rng.choice(["box", "box", "rod", "stone"]), rng.uniform(0.02, 0.16, 3)
    if kind == "box":
        shape = f'<box size="{_text(size)}"/>'
    elif kind == "rod":
        shape = f'<cylinder radius="{0.4 * size[0]}" length="{size[1]}"/>'
    else:
        _write_stone(rng, 0.5 * size, mesh)
        shape = f'<mesh filename="{mesh}"/>'
    turn = pinocchio.rpy.matrixToRpy(pinocchio.exp3(rng.normal(size=3) * rng.choice([0.0, 1.0])))
    return _collision(shape, [0.06, 0.0, 0.0] + 0.03 * rng.normal(size=3), turn)


def _write_stone(rng: np.random.Generator, half: Vec, mesh: Path) -> None:
    """A box with its corners cut, and points on a ball of which flat ends are cut, as STL."""
    from scipy.spatial import ConvexHull

    points = rng.normal(size=(60, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    points = np.vstack([np.clip(1.2 * points, -0.9, 0.9), 0.8 * np.array(list(product((-1.0, 1.0), repeat=3)))]) * half
    faces = [
        "facet normal 0 0 1\nouter loop\n"
        + "".join("vertex {:f} {:f} {:f}\n".format(*p) for p in points[face])
        + "endloop\nendfacet\n"
        for face in ConvexHull(points).simplices
    ]
    mesh.write_text(f"solid s\n{''.join(faces)}endsolid s\n")


def _collision(shape: str, xyz: Any, rpy: Any) -> str:
    return f'<collision><origin xyz="{_text(xyz)}" rpy="{_text(rpy)}"/><geometry>{shape}</geometry></collision>'


def _text(vector: Any) -> str:
    return " ".join(repr(float(entry)) for entry in vector)


def meet(
    robot: RobotModel, seed: int, seconds: float, *, level: Formulation = VELOCITIES, **settings: Any
) -> Meeting:  # fmt: skip
    """Send both hands to one point, or each to where the other would be."""
    rng = np.random.default_rng(seed)
    bent = {name: s for side in ("left", "right") for name, s in ((f"{side}_joint_1", 0.3), (f"{side}_joint_3", 1.0))}
    q, v, state = robot.configuration(bent), np.zeros(robot.nv), robot.state(drifts=False)
    state.update(0.0, q, v)
    hands = [state.frame(f"{side}_hand").position.copy() for side in ("left", "right")]
    middle = 0.5 * (hands[0] + hands[1]) + 0.05 * rng.normal(size=3)
    across = np.array([0.0, rng.choice([0.0, 0.02, 0.1]), 0.0])
    targets = middle - across, middle + across
    tasks = [*(Position(f"{s}_hand", target=x) for s, x in zip(("left", "right"), targets, strict=True))]
    constraint = CollisionAvoidance(margin=MARGIN, **settings)
    stack = wbc.Stack([*tasks, Posture(q, weight=1e-3)], subject_to=[JointLimits(), constraint])
    controller = wbc.Controller(robot, stack, level=level, dt=DT)
    everything = Distances(robot, margin=MARGIN, reach=0.2, count=10_000)
    nearest, seen, ok = np.inf, [v], True
    for k in range(round(seconds / DT)):
        command = controller.tick(k * DT, q, v)
        ok &= command.status.ok
        q, v = command.q, command.v
        seen.append(v)
        state.update(k * DT, q, v)
        everything.read(state)
        nearest = min(nearest, float(everything.distance.min()))
    last = np.array(seen[-round(0.5 / DT) :])
    ticks = round(0.02 / DT)
    parts = last[: len(last) - (len(last) - 1) % ticks]
    ways = np.abs(np.diff(parts, axis=0)).reshape(-1, ticks, robot.nv).sum(axis=1)
    shaking = float((ways - np.abs(np.diff(parts[::ticks], axis=0))).max(axis=1).mean()) / ticks
    return Meeting(nearest, float(np.abs(last).max()), shaking, ok)
