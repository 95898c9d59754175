"""Motions of a quadruped on its feet, with the samples that perfect sensors give of them.

Nothing here is the estimator's: rotations are scipy's, the sums Γ come from a matrix exponential, and joints from
Newton's method on the positions of the feet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import wbc
from tests.seeds import generator
from wbc.models import RobotModel
from wbc.models.feet import Foot
from wbc.robots import BaseEstimator, ImuNoise
from wbc.types import Mat, Vec

GRAVITY = np.array([0.0, 0.0, -9.81])
ROBOT = wbc.load("quadruped")
NAMES = tuple(ROBOT.feet)
#: Feet that touch in one point, which does not roll.
POINTS = [Foot(name, "point", 0.6) for name in NAMES]
WEIGHT = 9.81 * ROBOT.mass
QUIET = ImuNoise(1e-5, 1e-5, 0.0, 0.0, 0.0, 0.0)


def estimator(robot: RobotModel = ROBOT, feet: Sequence[Foot] = POINTS, **settings: Any) -> BaseEstimator:
    """One that trusts the sensors, from the first sample on."""
    return BaseEstimator(robot, feet, **{"noise": QUIET, "settle": 0.0, **settings})


def sums(phi: Vec) -> tuple[Mat, Mat, Mat]:
    """Exp(φ), Γ₁(φ), Γ₂(φ) as blocks of one matrix exponential."""
    A = np.zeros((9, 9))
    A[:3, :3] = np.cross(np.eye(3), phi)
    A[:3, 3:6] = A[3:6, 6:] = np.eye(3)
    E = expm(A)
    return E[:3, :3], E[:3, 3:6], E[:3, 6:]


@dataclass(frozen=True)
class Motion:
    """``q`` (N, nq), ``v`` (N, nv) at times ``t`` (N,) [s]; ``gyro`` and ``force`` (N, 3), means over the step before;
    ``normal`` (N, 4) [N] of the feet."""

    t: Vec
    q: Mat
    v: Mat
    gyro: Mat
    force: Mat
    normal: Mat

    def sample(self, k: int) -> dict[str, Any]:
        """What :meth:`BaseEstimator.update` takes."""
        return {
            "t": float(self.t[k]),
            "joint_q": self.q[k, 7:],
            "joint_v": self.v[k, 6:],
            "gyro_in_imu": self.gyro[k],
            "acceleration_in_imu": self.force[k],
            "forces": dict(zip(NAMES, self.normal[k].tolist(), strict=True)),
        }

    def with_noise(self, rng: np.random.Generator, gyro: float, force: float, joint: float, bias: Vec) -> Motion:
        """As sensors with white noise of these densities [rad/s/√Hz, m/s²/√Hz] and size [rad], and biases (6,), say."""
        per_sample = np.sqrt(np.diff(self.t).mean())
        q = self.q.copy()
        q[:, 7:] += joint * rng.standard_normal((len(q), 12))
        return replace(
            self, q=q,
            gyro=self.gyro + bias[:3] + gyro / per_sample * rng.standard_normal(self.gyro.shape),
            force=self.force + bias[3:] + force / per_sample * rng.standard_normal(self.force.shape),
        )  # fmt: skip


def inverse(base: Mat, p: Vec, targets: Mat, q: Vec) -> Vec:
    """Joints (12,) that put the feet at ``targets`` (4, 3), from those in ``q``."""
    state = ROBOT.state()
    full = np.concatenate([p, Rotation.from_matrix(base).as_quat(), q])
    for _ in range(20):
        state.update(0.0, full, np.zeros(18))
        error = np.concatenate([targets[i] - state.frame(name).position for i, name in enumerate(NAMES)])
        if np.abs(error).max() < 1e-13:
            break
        J = np.vstack([state.frame(name).jacobian()[:3, 6:] for name in NAMES])
        full[7:] += np.linalg.solve(J, error)
    return full[7:]


def stands(t: float) -> tuple[Mat, list[bool]]:
    """No foot moves."""
    return np.zeros((4, 3)), [True] * 4


def steps(t: float) -> tuple[Mat, list[bool]]:
    """Pairs across from one another go up and 2 cm ahead in turn, 0.2 s each, all stand for 0.1 s between."""
    moved, on = np.zeros((4, 3)), [True] * 4
    for k in range(round(t / 0.3) + 1):
        share = float(np.clip((t - 0.1 - 0.3 * k) / 0.2, 0.0, 1.0))
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        for foot in ((0, 3), (1, 2))[k % 2]:
            moved[foot] += smooth * np.array([0.02, 0.0, 0.0]) + 16.0 * 0.03 * (share * (1 - share)) ** 2 * np.eye(3)[2]
            on[foot] = on[foot] and not 0.0 < share < 1.0
    return moved, on


def moved_by(
    feet: Callable[[float], tuple[Mat, Sequence[bool]]], duration: float, dt: float, *, turns: float = 1.0
) -> Motion:
    """The trunk sways and turns on feet that move as a function of time says; ``turns`` scales its rotation."""
    n = round(duration / dt) + 1
    rng = generator("motion of the base")
    phase, rate = rng.uniform(0.0, 2.0 * np.pi, 6), rng.uniform(3.0, 7.0, 6)
    size = np.array([0.015, 0.015, 0.01, 0.06 * turns, 0.06 * turns, 0.08 * turns])

    def way(t: float, derivative: int) -> Vec:
        start = 1.0 - np.exp(-((t / 0.3) ** 2)) if derivative < 0 else 1.0
        return start * size * rate ** max(derivative, 0) * np.sin(rate * t + phase + derivative * np.pi / 2)

    state = ROBOT.state()
    R, p = np.eye(3), np.array(ROBOT.q0[:3])
    velocity = way(0.0, 1)[:3]
    ground = np.array([np.array(state.frame(name).position) for name in NAMES])
    joints = inverse(R, p, ground + feet(0.0)[0], np.array(ROBOT.q0[7:]))
    rows: list[tuple[Any, ...]] = []
    rate_now = np.zeros(3)
    for k in range(n):
        t = k * dt
        gyro, force = np.zeros(3), np.array([0.0, 0.0, 9.81])
        if k:
            gyro = way(t - 0.5 * dt, 1)[3:]
            turn, first, second = sums(dt * gyro)
            force = R.T @ (way(t - 0.5 * dt, 2)[:3] - GRAVITY)
            p = p + dt * velocity + dt**2 * (R @ second @ force + 0.5 * GRAVITY)
            velocity = velocity + dt * (R @ first @ force + GRAVITY)
            R, rate_now = R @ turn, gyro
        offsets, on = feet(t)
        before, joints = joints, inverse(R, p, ground + offsets, joints)
        q = np.concatenate([p, Rotation.from_matrix(R).as_quat(), joints])
        v = np.concatenate([R.T @ velocity, rate_now, (joints - before) / dt])
        rows.append((t, q, v, gyro, force, np.where(on, WEIGHT / max(sum(on), 1), 0.0)))
    return Motion(*(np.array(column) for column in zip(*rows, strict=True)))


@cache
def standing(dt: float = 2e-3, duration: float = 2.0) -> Motion:
    """The trunk moves, the feet stand."""
    return moved_by(stands, duration, dt)


@cache
def stepping(dt: float = 2e-3, duration: float = 2.0) -> Motion:
    """The trunk moves, the feet step."""
    return moved_by(steps, duration, dt)


def turned(motion: Motion, heading: float, shift: Vec) -> Motion:
    """The same motion in a world that is turned about the vertical [rad] and then shifted (3,) [m]."""
    turn, q = Rotation.from_rotvec([0.0, 0.0, heading]), motion.q.copy()
    q[:, :3] = turn.apply(q[:, :3]) + shift
    q[:, 3:7] = (turn * Rotation.from_quat(q[:, 3:7])).as_quat()
    return replace(motion, q=q)


def errors(q: Vec, v: Vec, true_q: Vec, true_v: Vec) -> Vec:
    """Position [m], orientation [rad] and velocity [m/s] of the base, estimated less true (9,), world axes."""
    R, S = Rotation.from_quat(q[3:7]), Rotation.from_quat(true_q[3:7])
    velocity = R.apply(v[:3]) - S.apply(true_v[:3])
    return np.concatenate([q[:3] - true_q[:3], (R * S.inv()).as_rotvec(), velocity])


def estimates(one: BaseEstimator, motion: Motion, start: Motion | None = None) -> Iterator[tuple[int, Vec, Vec]]:
    """Number, q and v of every sample, as they are estimated; it begins where ``start`` does."""
    begin = motion if start is None else start
    one.reset(begin.q[0], begin.v[0])
    for k in range(len(motion.t)):
        yield k, *one.update(**motion.sample(k))


def missed(one: BaseEstimator, motion: Motion, truth: Motion | None = None) -> Mat:
    """Errors (N, 9) of the base; it begins in the truth."""
    true = motion if truth is None else truth
    return np.array([errors(q, v, true.q[k], true.v[k]) for k, q, v in estimates(one, motion, true)])
