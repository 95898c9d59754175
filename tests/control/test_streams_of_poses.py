"""A hand that follows streams of poses as teleoperation has them, the bad ones: it neither jumps nor freezes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pinocchio
import pytest

import tasks as T
import wbc
from wbc.errors import ModelError
from wbc.models.catalogue import example_robots
from wbc.types import Mat, Vec

DT, A_MAX, J_MAX = 2e-3, 30.0, 3000.0
#: Whose hand follows, and the joints that carry it.
HANDS = {"arm": ("tool", ""), "panda": ("panda_hand", "panda_joint"), "humanoid": ("left_hand", "left_")}
#: When a sample comes, when it was taken, and the sample.
Stream = Iterator[tuple[float, float, Any]]


def pose_at(robot: Any, q: Vec) -> Any:
    state = robot.state()
    state.update(0.0, q, np.zeros(robot.nv))
    frame = state.frame(HANDS[robot.name][0])
    return pinocchio.SE3(frame.rotation.copy(), frame.position.copy())


def moved(robot: Any, by: Vec) -> Any:
    """Where the hand is when the joints that carry it, no legs, are moved from the reference."""
    q, first = robot.q0.copy(), robot.nq - robot.nj
    for i, name in enumerate(robot.joint_names):
        carries = name.startswith(HANDS[robot.name][1]) and not any(leg in name for leg in ("hip", "knee", "ankle"))
        q[first + i] += by[i] if carries else 0.0
    q[first:] = np.clip(q[first:], robot.limits.q_min, robot.limits.q_max)
    return pose_at(robot, q)


def near(robot: Any, rng: np.random.Generator) -> Any:
    """A pose that can be reached."""
    return moved(robot, rng.uniform(-0.4, 0.4, robot.nj))


def waving(robot: Any, t: float) -> Any:
    return moved(robot, 0.3 * np.sin(np.linspace(0.7, 1.9, robot.nj) * t))


def random(robot: Any, rng: np.random.Generator, seconds: float) -> Stream:
    for t in np.cumsum(rng.exponential(0.05, int(20 * seconds))):
        yield t, t, near(robot, rng)


def jumping(robot: Any, rng: np.random.Generator, seconds: float) -> Stream:
    for t in np.arange(0.0, seconds, 1.5):
        yield t, t, near(robot, rng)


def delayed(robot: Any, rng: np.random.Generator, seconds: float) -> Stream:
    """30 Hz and 3 mm of noise; one in five is lost, and a second of all; the others are 80 ms late on average."""
    found = []
    for t in np.arange(0.0, seconds, 1 / 30):
        pose = waving(robot, t)
        pose.translation = pose.translation + 3e-3 * rng.normal(size=3)
        found.append((t + rng.exponential(0.08), t, pose))
    kept = [one for one in found if rng.uniform() > 0.2 and not 4.0 < one[0] % 20.0 < 5.0]
    yield from sorted(kept, key=lambda one: one[0])


def frozen(robot: Any, rng: np.random.Generator, seconds: float) -> Stream:
    yield from ((t, t, waving(robot, t)) for t in np.arange(0.0, seconds, 1 / 60) if t % 8.0 < 5.0)


def out_of_reach(robot: Any, rng: np.random.Generator, seconds: float) -> Stream:
    start = pose_at(robot, robot.q0)
    for t in np.arange(0.0, seconds, 1 / 60):
        away = np.array([1.5 * np.sin(0.7 * t) ** 3, 1.5 * np.sin(0.5 * t) ** 3, 0.8 * np.sin(0.3 * t)])
        yield t, t, pinocchio.SE3(start.rotation, start.translation + away)


class Seen(NamedTuple):
    """Of each tick: commanded velocity, what the reference said, speed of the hand, distance of the newest sample."""

    velocities: Mat
    rates: Mat
    seconds: Mat
    speed: Vec
    distance: Vec


def teleoperated(stream: Callable[..., Stream], level: Any, seconds: float, name: str = "arm") -> Seen:
    robot = wbc.load(name)
    frame, second = HANDS[name][0], level.order == 2
    follow = T.Follow(pose_at(robot, robot.q0))
    settings = {"kp": 100.0} if second else {}
    tasks: list[Any] = [T.Frame(frame, target=follow, **settings), T.Posture(robot.q0, weight=1e-3)]
    limits: list[Any] = [T.JointLimits(), T.JointAccelerationLimits(A_MAX)]
    limits += [T.TorqueLimits(), T.JointJerkLimits(J_MAX)] if second else []
    if robot.nb:
        # It has to stand while its hand is drawn away: balance counts for more, and the trunk, else legs stretch.
        tasks.append(T.CenterOfMass(target=robot.state().com, kp=100.0, weight=20.0))
        tasks.append(T.Frame("torso", target=robot.state().frame("torso").placement, kp=100.0, weight=20.0))
    stack = wbc.Stack(tasks, subject_to=limits, contacts=T.feet(robot) if robot.nb else [])
    controller = wbc.Controller(robot, stack, level=level, dt=DT)
    samples = list(stream(robot, np.random.default_rng(2), seconds))
    q, v, last = robot.q0, np.zeros(robot.nv), pose_at(robot, robot.q0).translation
    place, asked, found, told = [], [], [], []
    for tick in range(int(seconds / DT)):
        while samples and samples[0][0] <= DT * tick:
            _, taken, sample = samples.pop(0)
            late = follow.late
            follow.push(sample, t=taken)
            last = sample.translation if follow.late == late else last
        command = controller.tick(DT * tick, q, v)
        assert command.status.ok and command.fallback_level == "solved", (
            f"tick {tick}: {command.status}, {controller.why}"
        )
        place.append(controller.state.frame(frame).position.copy())
        told.append(follow(DT * tick)[1:])  # a second read of one time gives what the controller was given
        q, v = command.q, command.v
        asked.append(last)
        found.append(v[robot.nb :])
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1) / DT
    distance = np.linalg.norm(np.subtract(place, asked), axis=1)[1:]
    rates, accelerations = (np.array(one) for one in zip(*told, strict=True))
    return Seen(np.array(found), rates, accelerations, speed, distance)


def longest_freeze(seen: Seen) -> float:
    """For how long the hand stood although its sample was 2 cm away [s]."""
    stands = (seen.speed < 2e-3) & (seen.distance > 0.02)
    return DT * max((len(run) for run in "".join("01"[int(s)] for s in stands).split("0")), default=0)


STREAMS = (random, jumping, delayed, frozen, out_of_reach)
#: Stream, level and robot: those of every run of the tests, and those that take long.
SHORT = [
    *((stream, wbc.VelocityLevel(), "arm") for stream in STREAMS),
    *((stream, wbc.InverseDynamics(), "arm") for stream in (random, out_of_reach)),
    (jumping, wbc.InverseDynamics(), "humanoid"),
]  # fmt: skip
LONG = [*SHORT[:5], *((stream, wbc.InverseDynamics(), name) for name in ("panda", "humanoid") for stream in STREAMS)]


@pytest.mark.parametrize(
    ("stream", "level", "name", "seconds"),
    [*((*case, 8.0) for case in SHORT), *(pytest.param(*case, 60.0, marks=pytest.mark.deep) for case in LONG)],
)
def test_a_hand_follows_a_bad_stream_without_jump_or_freeze(stream: Any, level: Any, name: str, seconds: float) -> None:
    if name == "panda":
        try:
            example_robots()
        except ModelError as missing:
            pytest.skip(str(missing))
    seen = teleoperated(stream, level, seconds, name)
    one = 1.0 + 1e-9
    for axes, velocity, acceleration, jerk in ((slice(3), 0.5, 5.0, 100.0), (slice(3, 6), 1.5, 15.0, 300.0)):
        assert abs(seen.rates[:, axes]).max() <= velocity * one
        assert abs(seen.seconds[:, axes]).max() <= acceleration * one
        assert abs(np.diff(seen.seconds[:, axes], axis=0)).max() <= jerk * DT * one
    steps = np.diff(seen.velocities, axis=0)
    assert abs(steps).max() <= A_MAX * DT + 1e-6
    if level.order == 2 and stream is not out_of_reach:  # there joints come to their limits, which stand above jerk
        assert abs(np.diff(steps, axis=0)).max() <= J_MAX * DT**2 + 1e-6
    assert longest_freeze(seen) < 0.3
