"""Retargeted motions played in physics: torques track the joints, the centre of mass and the feet of the motion.

    python tests/motion/played.py --robots g1 talos --motions walk --seeds 0 1

The robot starts at rest in the first frame and is given torques at 1 kHz by inverse dynamics with the contacts of the
motion. It stands if it has not fallen when the motion ends. How far its centre of mass was off is said beside.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Callable, Iterable
from itertools import product
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

import wbc
from wbc import tasks
from wbc.models.along import placed
from wbc.motion import Retargeted, made
from wbc.motion.made import MOTIONS
from wbc.report.measure import spans
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.simulate import simulate

#: Physics has the whole friction of the feet; the motion was judged with 0.8 of it.
BEFORE = 0.3
"""Seconds at rest in the first frame."""


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
    poses = placed(robot, found.q, {frame: frame for frame in (*frames.values(), chest)})
    com = []
    for q in found.q:
        state.update(0.0, q, rest)
        com.append(state.com.copy())
    goals = [
        tasks.CenterOfMass(target=_points(times, com), kp=100),
        tasks.Orientation(chest, target=_turns(times, poses[chest][1]), kp=100),
        *(tasks.Frame(f, target=_poses(times, *poses[f]), kp=100, weight=10.0) for f in frames.values()),
        tasks.Posture(_points(times, found.q[:, 7:]), kp=100, weight=1e-2),
    ]
    contacts = tasks.feet(robot, kp=0.0, kd=20.0)
    limits = [tasks.TorqueLimits(), tasks.JointVelocityLimits(), tasks.JointPositionLimits()]
    schedule = tasks.ContactSchedule(_timeline(found))
    stack = wbc.Stack(goals, contacts=contacts, subject_to=limits, components=[schedule])
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


def slip(found: Retargeted) -> float:
    """The largest way [m] of a foot from its place while it holds."""
    frames = {part: found.contacts[part].frame for part in ("left_foot", "right_foot")}
    places = {part: at for part, (at, _) in placed(found.robot, found.q, frames).items()}
    held = [places[part][start:stop] for part in frames for start, stop in spans(found.holds[part])]
    return max(float(np.linalg.norm(at - at[0], axis=1).max()) for at in held)


def main() -> None:
    """Motions of our own, before and after repair, and of each robot the sums."""
    said = ArgumentParser()
    said.add_argument("--robots", nargs="+", default=["humanoid", "g1", "talos"])
    said.add_argument("--motions", nargs="+", default=[*MOTIONS])
    said.add_argument("--seeds", nargs="+", type=int, default=[0])
    said.add_argument("--judge-only", action="store_true", help="without physics")
    given = said.parse_args()
    for robot in given.robots:
        sums: dict[str, list[tuple[float, ...]]] = {"before": [], "after": []}
        for name, seed in product(given.motions, given.seeds):
            start = process_time()
            found = wbc.retarget(made(name, seed=seed), wbc.load(robot, base="floating"), repair=True)
            spent = process_time() - start
            runs = {"alone": found} if found.before is None else {"before repair": found.before, "repaired": found}
            for word, one in runs.items():
                far = one.distances()
                off = 1e3 * np.median([np.median(far[p]) for p in ("pelvis", "left_wrist", "right_wrist")])
                stood, seconds, com = Played(False, 0.0, 0.0) if given.judge_only else played(one)
                ended = "not played" if given.judge_only else "stood" if stood else f"fell at {seconds:.2f} s"
                row = len(one.q), round(one.certified * len(one.q)), 1e3 * slip(one), off, stood
                sums["before"] += [row] * (word != "repaired")
                sums["after"] += [row] * (word != "before repair")
                print(
                    f"{robot} {name} {seed} {word}: {100 * one.certified:.1f} % of {len(one.q)} frames certified, "
                    f"{one.added:.2f} s added, {ended}, "
                    f"com off {1e3 * com:.1f} mm, slip {row[2]:.3f} mm, {off:.1f} mm from the person; "
                    f"{', '.join(one.faults()) or 'no fault'}; {spent:.0f} s of processor time",
                    flush=True,
                )
        for word, rows in sums.items():
            frames, certified, slips, off, stood = (np.array(column) for column in zip(*rows, strict=True))
            print(
                f"{robot} {word} repair: {certified.sum()} of {frames.sum()} frames certified "
                f"({100 * certified.sum() / frames.sum():.1f} %), slip up to {slips.max():.3f} mm, "
                f"{np.median(off):.1f} mm from the person (median)"
                + f", {stood.sum()} of {len(rows)} stood"
                * (not given.judge_only),
                flush=True,
            )


if __name__ == "__main__":
    main()
