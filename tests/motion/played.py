"""Retargeted motions played in physics: torques track the joints, the centre of mass and the feet of the motion.

    python tests/motion/played.py humanoid g1 talos

The robot starts at rest in the first frame and is given torques at 1 kHz by inverse dynamics with the contacts of the
motion. It stands if it has not fallen when the motion ends. How far its centre of mass was off is said beside.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

import wbc
from wbc.motion import Retargeted, made
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.simulate import simulate
from wbc.tasks import (
    CenterOfMass,
    ContactSchedule,
    Frame,
    JointPositionLimits,
    JointVelocityLimits,
    Orientation,
    Posture,
    TorqueLimits,
    feet,
)

#: Physics has the whole friction of the feet; the motion was judged with 0.8 of it.
BEFORE, SEEDS = 0.3, (0,)
"""Seconds at rest in the first frame, and the seeds of the motions."""


class Played(NamedTuple):
    """Whether the robot stood to the end, for how long it did [s], and the rms error of its centre of mass [m]."""

    stood: bool
    seconds: float
    com: float


def played(found: Retargeted) -> Played:
    """A motion in MuJoCo."""
    robot, times = found.robot, found.times + BEFORE
    state, rest = robot.state(), np.zeros(robot.nv)
    frames = {part: found.contacts[part].frame for part in ("left_foot", "right_foot")}
    chest = found.table.followers["chest"].frame
    com, places, turned = [], {f: [] for f in frames.values()}, {f: [] for f in (*frames.values(), chest)}
    for q in found.q:
        state.update(0.0, q, rest)
        com.append(state.com.copy())
        for frame, rows in places.items():
            rows.append(state.frame(frame).position.copy())
        for frame, rows in turned.items():
            rows.append(state.frame(frame).rotation.copy())
    tasks = [
        CenterOfMass(target=_points(times, com), kp=100),
        Orientation(chest, target=_turns(times, turned[chest]), kp=100),
        *(Frame(f, target=_poses(times, places[f], turned[f]), kp=100, weight=10.0) for f in frames.values()),
        Posture(_points(times, found.q[:, 7:]), kp=100, weight=1e-2),
    ]
    contacts = feet(robot, kp=0.0, kd=20.0)
    stack = wbc.Stack(
        tasks, contacts=contacts, subject_to=[TorqueLimits(), JointVelocityLimits(), JointPositionLimits()],
        components=[ContactSchedule(_timeline(found))],
    )  # fmt: skip
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=1e-3)
    plant = MujocoPlant(robot, contacts=contacts, friction=max(foot.friction for foot in robot.feet.values()))
    plant.reset(plant.settled(plant.on_floor(found.q[0])))
    duration = float(times[-1])
    run = simulate(controller, plant, duration=duration)
    error = np.asarray(run["error.CenterOfMass"])
    return Played(run.meta["ended"] == "complete", float(run["t"][-1]), float(np.sqrt(np.square(error).sum(1).mean())))


def _timeline(found: Retargeted) -> list[tuple[float, Iterable[str]]]:
    sets = [
        tuple(found.contacts[part].frame for part in ("left_foot", "right_foot") if found.holds[part][k])
        for k in range(len(found.q))
    ]
    starts = [0, *(k for k in range(1, len(sets)) if sets[k] != sets[k - 1])]
    return [(k / found.rate + BEFORE * (k > 0), sets[k]) for k in starts]


def _points(times: np.ndarray, values: Any) -> Callable[[float], Any]:
    spline = CubicSpline(times, np.array(values), bc_type="clamped")

    def at(t: float) -> Any:
        if not times[0] < t < times[-1]:
            return spline(np.clip(t, times[0], times[-1])), np.zeros(spline.c.shape[2]), np.zeros(spline.c.shape[2])
        return spline(t), spline(t, 1), spline(t, 2)

    return at


def _turns(times: np.ndarray, values: Any) -> Callable[[float], Any]:
    spline = RotationSpline(times, Rotation.from_matrix(np.array(values)))

    def at(t: float) -> Any:
        inside = times[0] < t < times[-1]
        s = np.clip(t, times[0], times[-1])
        return spline(s).as_matrix(), inside * spline(s, 1), inside * spline(s, 2)

    return at


def _poses(times: np.ndarray, places: Any, turned: Any) -> Callable[[float], Any]:
    place, turn = _points(times, places), _turns(times, turned)

    def at(t: float) -> Any:
        (p, v, a), (R, w, dw) = place(t), turn(t)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R, p
        return pose, np.concatenate([v, w]), np.concatenate([a, dw])

    return at


def main(robots: list[str]) -> None:
    """Every motion of our own, before and after repair."""
    for robot in robots:
        model = wbc.load(robot, base="floating")
        for name in ("squat", "reach", "dance", "turn", "walk"):
            for seed in SEEDS:
                found = wbc.retarget(made(name, seed=seed), model, repair=True)
                for word, one in (("before", found.before), ("after", found)):
                    if one is not None:
                        far = one.distances()
                        off = 1e3 * np.median([np.median(far[p]) for p in ("pelvis", "left_wrist", "right_wrist")])
                        print(
                            robot, name, seed, word, f"certified {one.certified:.4f}", played(one), f"off {off:.1f} mm",
                            sorted(one.faults()), flush=True,
                        )  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1:])
