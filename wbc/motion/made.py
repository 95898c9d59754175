"""Motions of our own: a skeleton of a person that squats, reaches, turns, dances and walks, made by a program.

>>> from wbc.motion import made
>>> made("walk", seed=3).name
'walk 3'
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.linalg import solve_banded
from scipy.spatial.transform import Rotation

from wbc import checks
from wbc.errors import UnknownName
from wbc.motion.clip import Motion
from wbc.types import Mat, Vec

RATE = 60.0
#: Lengths of the person [m]: thigh, shin, ankle over the floor, ankle to toes ahead and toes over the floor, half the
#: width of hips and shoulders, hips to spine, hips to shoulders, shoulders to head, upper arm, forearm.
_THIGH = _SHIN = 0.42
_ANKLE, _TOE, _TOE_HEIGHT = 0.08, 0.13, 0.02
_HIP, _SHOULDER, _SPINE, _TRUNK, _NECK, _UPPER, _FORE = 0.09, 0.19, 0.12, 0.48, 0.25, 0.29, 0.26
_WIDTH = 0.1  # between the middle and either ankle
_STANDING = _ANKLE + 0.97 * (_THIGH + _SHIN)
_GRAVITY = 9.81

#: Parts of a body and their places (N, 3).
_Parts = dict[str, Mat]


class UnknownMotion(UnknownName):
    """No motion of this name is made by a program."""

    kind = "motion"


def made(name: str, *, seed: int = 0) -> Motion:
    """A motion by its name: "squat", "reach", "turn", "dance" or "walk"; another seed, another size and pace.

    Raises:
        UnknownMotion: no such motion.
    """
    if not isinstance(name, str) or name not in MOTIONS:
        raise UnknownMotion(name, MOTIONS, "or give a .bvh, .npz or .csv file to Motion.read or wbc retarget")
    seed = checks.seed("seed", seed)
    rng = np.random.default_rng(seed)
    tall, pace = rng.uniform(0.9, 1.1), rng.uniform(0.85, 1.1)
    body = MOTIONS[name](rng, pace)
    return Motion(RATE, {part: tall * p for part, p in body.items()}, name=f"{name} {seed}" if seed else name)


def _person(
    hips: Mat, turned: Rotation, trunk: Rotation, arms: Mapping[str, Mapping[str, Vec | float]],
    feet: Mapping[str, tuple[Mat, Vec]] | None = None,
) -> _Parts:  # fmt: skip
    """Joints of a person with the middle of the hips at ``hips`` (N, 3), the pelvis ``turned``, the ``trunk`` turned
    from there, ``arms`` {side: {"ahead", "out", "bent"} (N,) [rad]}, which else hang down, and ``feet`` {side: (ankle
    (N, 3), heading (N,) [rad])}, which else stand."""
    chest, n = turned * trunk, len(hips)
    found = {"pelvis": hips, "spine": hips + turned.apply([0.0, 0.0, _SPINE])}
    neck = hips + chest.apply([0.0, 0.0, _TRUNK])
    found["head"] = neck + chest.apply([0.0, 0.0, _NECK])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        hip = hips + turned.apply([0.0, sign * _HIP, 0.0])
        ankle, heading = feet[side] if feet else (np.tile([0.0, sign * _WIDTH, _ANKLE], (n, 1)), np.zeros(n))
        ahead = np.column_stack([np.cos(heading), np.sin(heading), np.zeros(n)])
        line = ankle - hip
        far = np.linalg.norm(line, axis=1, keepdims=True)
        unit = line / far
        out = ahead - np.sum(ahead * unit, axis=1, keepdims=True) * unit  # the knee bends to where the toes point
        bend = np.sqrt(np.maximum(_THIGH**2 - 0.25 * far**2, 1e-6)) * out / np.linalg.norm(out, axis=1, keepdims=True)
        toe = ankle + _TOE * ahead - [0.0, 0.0, _ANKLE - _TOE_HEIGHT]
        shoulder = neck + chest.apply([0.0, sign * _SHOULDER, 0.0])
        angles = {"ahead": 0.0, "out": 0.15, "bent": 0.3} | {**arms.get(side, {})}
        upper = chest * _turned("YX", -angles["ahead"], sign * angles["out"])
        elbow = shoulder + upper.apply([0.0, 0.0, -_UPPER])
        wrist = elbow + (upper * _turned("Y", -angles["bent"])).apply([0.0, 0.0, -_FORE])
        parts = hip, hip + 0.5 * line + bend, ankle, toe, shoulder, elbow, wrist
        names = "hip", "knee", "ankle", "toe", "shoulder", "elbow", "wrist"
        found |= {f"{side}_{name}": part for name, part in zip(names, parts, strict=True)}
    return found


def _blend(s: Vec) -> Vec:
    """From 0 to 1 while s goes from 0 to 1, with no speed and no acceleration at either end."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def _turned(axes: str, *angles: Vec | float) -> Rotation:
    return Rotation.from_euler(axes, np.column_stack(np.broadcast_arrays(*angles)))


def _squat(rng: np.random.Generator, pace: float) -> _Parts:
    t = np.arange(240) / RATE
    depth = rng.uniform(0.12, 0.24) * 0.5 * (1.0 - np.cos(2.0 * np.pi * 0.5 * pace * t)) * _blend(t)
    lean = 1.6 * depth
    hips = np.column_stack([-0.35 * depth, 0.0 * t, _STANDING - depth])
    ahead = {"ahead": 5.0 * depth + lean}
    return _person(hips, Rotation.identity(len(t)), _turned("Y", lean), {"left": ahead, "right": ahead})


def _reach(rng: np.random.Generator, pace: float) -> _Parts:
    t = np.arange(240) / RATE
    there = _blend((t - 0.4) * pace) - _blend((t - 2.4) * pace)
    side, high = rng.uniform(-0.5, 0.5), rng.uniform(0.6, 1.7)
    hips = np.column_stack([0.0 * t, 0.02 * side * there, _STANDING - 0.04 * there])
    trunk = _turned("ZY", side * there, 0.12 * there)
    left = {"ahead": high * there, "bent": 0.3 * (1.0 - there) + 0.1}
    return _person(hips, Rotation.identity(len(t)), trunk, {"left": left})


def _dance(rng: np.random.Generator, pace: float) -> _Parts:
    t = np.arange(360) / RATE
    start = _blend(t) * _blend(t[-1] - t)
    waves = [start * np.sin(2.0 * np.pi * rng.uniform(0.3, 0.7) * pace * t + rng.uniform(0.0, 6.0)) for _ in range(8)]
    hips = np.column_stack([0.01 * waves[0], 0.035 * waves[1], _STANDING - 0.04 * start * (1.0 + waves[2] / 2)])
    turned = _turned("ZYX", 0.15 * waves[3], 0.04 * waves[4], 0.04 * waves[5])
    trunk = _turned("ZY", 0.3 * waves[6], 0.05 * waves[7])
    arms = {
        side: {"ahead": 0.5 * (start + waves[k]), "out": 0.35 + 0.2 * waves[k + 2], "bent": 0.7 + 0.4 * waves[k + 4]}
        for k, side in enumerate(("left", "right"))
    }
    return _person(hips, turned, trunk, arms)


def _turn(rng: np.random.Generator, pace: float) -> _Parts:
    return _steps(0.0, rng.choice([-1.0, 1.0]) * rng.uniform(0.25, 0.4), 6, pace * 0.8)


def _walk(rng: np.random.Generator, pace: float) -> _Parts:
    return _steps(rng.uniform(0.15, 0.3), 0.0, 6, pace)


def _steps(length: float, turning: float, count: int, pace: float) -> _Parts:
    """Steps ahead or on the spot, the body where a linear inverted pendulum has to be over feet that press in turn."""
    swing, both, before = 0.55 / pace, 0.25 / pace, 1.0
    n = int((2.0 * before + count * (swing + both)) * RATE)
    t = np.arange(n) / RATE
    ankles = {side: np.tile([0.0, sign * _WIDTH, _ANKLE], (n, 1)) for side, sign in (("left", 1.0), ("right", -1.0))}
    headings = {side: np.zeros(n) for side in ankles}
    press = np.zeros((n, 2))
    for k in range(count):
        side, sign = ("left", 1.0) if k % 2 == 0 else ("right", -1.0)
        other = "right" if side == "left" else "left"
        lift = before + k * (swing + both) + both
        step = _blend((t - lift) / swing)
        to, distance = min(k + 1, count - 1) * turning, min(k + 1, count - 1) * length
        place = np.array([distance, 0.0]) + _WIDTH * sign * np.array([-np.sin(to), np.cos(to)])
        ankles[side][:, :2] += step[:, None] * (place - ankles[side][-1, :2])
        ankles[side][:, 2] += 0.06 * (4.0 * step * (1.0 - step)) ** 1.5
        headings[side] += step * (to - headings[side][-1])
        lean = _blend((t - lift + both) / both) * (1.0 - _blend((t - lift - swing) / both))
        middle = 0.5 * (ankles["left"] + ankles["right"])[:, :2]
        press += lean[:, None] * (ankles[other][:, :2] - middle)
    press += 0.5 * (ankles["left"] + ankles["right"])[:, :2]
    hips = np.column_stack([_pendulum(press, _STANDING), np.full(n, _STANDING - 0.03)])
    heading = 0.5 * (headings["left"] + headings["right"])
    way = 0.25 * np.sin(np.pi * np.clip((t - before) / (swing + both), 0.0, count)) * (length > 0.0)
    arms, feet = {"left": {"ahead": -way}, "right": {"ahead": way}}, {s: (ankles[s], headings[s]) for s in ankles}
    return _person(hips, _turned("Z", heading), Rotation.identity(n), arms, feet)


def _pendulum(press: Mat, height: float) -> Mat:
    """Where the centre of mass is over a centre of pressure (N, 2): c − (h/g) c̈ = p, at rest at both ends."""
    n, k = len(press), height / _GRAVITY * RATE**2
    bands = np.zeros((3, n))
    bands[0, 1:], bands[1], bands[2, :-1] = -k, 1.0 + 2.0 * k, -k
    bands[1, [0, -1]] = 1.0 + k
    return np.asarray(solve_banded((1, 1), bands, press))


MOTIONS: Mapping[str, Callable[[np.random.Generator, float], _Parts]] = {
    "squat": _squat, "reach": _reach, "turn": _turn, "dance": _dance, "walk": _walk,
}  # fmt: skip
