"""A hand that follows streams of poses as teleoperation has them, the bad ones: it neither jumps nor freezes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pinocchio
import pytest

import wbc
from tasks import Follow, Frame, JointAccelerationLimits, JointLimits, Posture
from wbc.types import Mat, Vec

DT, A_MAX = 2e-3, 30.0
#: When a sample comes, when it was taken, and the sample.
Stream = Iterator[tuple[float, float, Any]]


def pose_at(robot: Any, q: Vec) -> Any:
    state = robot.state()
    state.update(0.0, q, np.zeros(robot.nv))
    frame = state.frame("tool")
    return pinocchio.SE3(frame.rotation.copy(), frame.position.copy())


def near(robot: Any, rng: np.random.Generator) -> Any:
    """A pose that can be reached."""
    return pose_at(robot, robot.q0 + rng.uniform(-0.4, 0.4, robot.nv))


def waving(robot: Any, t: float) -> Any:
    return pose_at(robot, robot.q0 + 0.3 * np.sin(np.linspace(0.7, 1.9, robot.nv) * t))


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


def teleoperated(stream: Callable[..., Stream], level: Any, seconds: float) -> tuple[Mat, Vec, Vec]:
    """Commanded velocities, the tool's speed [m/s], and its distance from the newest sample that came [m]."""
    robot = wbc.load("arm")
    follow = Follow(pose_at(robot, robot.q0))
    stack = wbc.Stack(
        [Frame("tool", target=follow), Posture(robot.q0, weight=1e-3)],
        subject_to=[JointLimits(), JointAccelerationLimits(A_MAX)],
    )
    controller = wbc.Controller(robot, stack, level=level, dt=DT)
    samples = list(stream(robot, np.random.default_rng(2), seconds))
    q, v, last = robot.q0, np.zeros(robot.nv), pose_at(robot, robot.q0).translation
    place, asked, found = [], [], []
    for tick in range(int(seconds / DT)):
        while samples and samples[0][0] <= DT * tick:
            _, taken, sample = samples.pop(0)
            late = follow.late
            follow.push(sample, t=taken)
            last = sample.translation if follow.late == late else last
        command = controller.tick(DT * tick, q, v)
        assert command.status.ok, f"tick {tick}: {command.status}, {controller.why}"
        place.append(controller.state.frame("tool").position.copy())
        q, v = command.q, command.v
        asked.append(last)
        found.append(v)
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1) / DT
    return np.array(found), speed, np.linalg.norm(np.subtract(place, asked), axis=1)[1:]


@pytest.mark.parametrize("seconds", [8.0, pytest.param(60.0, marks=pytest.mark.deep)])
@pytest.mark.parametrize(
    ("stream", "level"),
    [
        *((stream, wbc.VelocityLevel()) for stream in (random, jumping, delayed, frozen, out_of_reach)),
        (random, wbc.InverseDynamics()),
        (out_of_reach, wbc.InverseDynamics()),
    ],
)  # fmt: skip
def test_a_hand_follows_a_bad_stream_without_jump_or_freeze(stream: Any, level: Any, seconds: float):
    velocities, speed, distance = teleoperated(stream, level, seconds)
    assert abs(np.diff(velocities, axis=0)).max() <= A_MAX * DT + 1e-6
    stands = (speed < 2e-3) & (distance > 0.02)
    longest = max((len(run) for run in "".join("01"[int(s)] for s in stands).split("0")), default=0)
    assert longest * DT < 0.3
