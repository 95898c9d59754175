"""What a robot that is turned by hand about its own three axes says of its IMU: quaternion, gyroscope, accelerometer.

Turned by θ about its own axis e, a base goes from R to R exp(θ e). A quaternion that is read as it should be gives
log(Rᵀ R exp(θ e)) = θ e for each of the three; the gyroscope's integral is the same vector; the accelerometer at rest
shows Rᵀ (0, 0, g). Where they do not, the linear map between the two says what is wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio

from wbc.robots.device import Reading, rotation
from wbc.types import Mat, Vec

#: Hands are not exact: what differs by less than this from a map is that map.
_NEAR = 0.35
_G = 9.81
#: Other ways to read four numbers as x y z w.
_READ: tuple[tuple[str, Callable[[Vec], Vec]], ...] = (
    ("the quaternion comes w first, and is read as x y z w", lambda q: q[[1, 2, 3, 0]]),
    ("the quaternion comes as x y z w, and is read as w first", lambda q: q[[3, 0, 1, 2]]),
    ("the quaternion is that from the world to the IMU, the inverse", lambda q: q * [-1.0, -1.0, -1.0, 1.0]),
)  # fmt: skip


def still(readings: Sequence[Reading]) -> str:
    """What is wrong with an IMU that rests, or nothing: lengths tell units."""
    quaternion, force = _mean(readings, "quaternion"), _mean(readings, "acceleration")
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > 0.05:
        return f"the quaternion of the IMU has length {length:.3g}, not 1"
    size = float(np.linalg.norm(force))
    if size < 0.5:
        return f"the accelerometer says {size:.2g} m/s² at rest: gravity is left out, or it is not the accelerometer"
    if not 0.7 * _G < size < 1.4 * _G:
        return f"the accelerometer is in {'g' if 0.7 < size < 1.4 else 'another unit'}: at rest it says {size:.3g} m/s²"
    return ""


def upright(readings: Sequence[Reading]) -> str:
    """What is wrong with an IMU that nobody turns, or nothing: its parts must agree on what is up."""
    agree = _up(_mean(readings, "quaternion"), _mean(readings, "acceleration")) > 1.0 - _NEAR
    return "" if agree else "quaternion and accelerometer disagree on what is up"


def turned(rest: Sequence[Reading], turns: Sequence[Sequence[Reading]]) -> str:
    """What is wrong with an IMU that rested and was turned about x, y and z, or nothing.

    ``turns`` has the readings of each turn, from rest to where it was held.
    """
    quaternion = _mean(rest, "quaternion")
    ends = [_mean(turn[-5:], "quaternion") for turn in turns]
    seen = _turns(quaternion, ends)
    if not _is(seen, np.eye(3)):
        for text, read in _READ:
            if _is(_turns(read(quaternion), [read(end) for end in ends]), np.eye(3)):
                return text
        stands = (seen.T @ _mean(rest, "acceleration"))[2] > -0.7 * _G
        return _mounted("the IMU", seen) + ("" if stands else ", if the robot is upside down; else it is mirrored")
    gyro, vectors = [], _vectors(quaternion, ends)
    for turn, vector in zip(turns, vectors, strict=True):
        times = np.array([reading.time for reading in turn])
        rates = np.array([reading.gyro for reading in turn])
        gyro.append((np.diff(times)[:, None] * rates[1:]).sum(axis=0) / np.linalg.norm(vector))
    rate = np.array(gyro).T
    size = float(np.cbrt(abs(np.linalg.det(rate))))
    if size > 20.0:
        return "the gyroscope is in degrees per second"
    if not _is(rate, np.eye(3)):
        return _mounted("the gyroscope", rate)
    predicted = np.array([rotation(q).T @ [0.0, 0.0, _G] for q in (quaternion, *ends)]).T
    measured = np.array([_mean(rest, "acceleration"), *(_mean(turn[-5:], "acceleration") for turn in turns)]).T
    force = measured @ np.linalg.pinv(predicted)
    return "" if _is(force, np.eye(3)) else _mounted("the accelerometer", force)


def _mounted(what: str, found: Mat) -> str:
    """The signed exchange of axes that is nearest to a map, in words."""
    axes = np.zeros((3, 3))
    for k in range(3):
        row = int(np.abs(found[:, k]).argmax())
        axes[row, k] = np.sign(found[row, k])
    if not _is(found, axes) or abs(np.linalg.det(axes)) < 0.5:
        return f"{what} is turned against the base by an angle that is no right one"
    if np.linalg.det(axes) < 0.0:
        if (axes == -np.eye(3)).all():
            return f"{what} has the opposite sign in all axes"
        flipped = [name for name, sign in zip("xyz", axes.diagonal(), strict=True) if sign < 0.0]
        if len(flipped) == 1:
            return f"{what} is mirrored: its {flipped[0]} has the other sign"
        return f"{what} is mirrored"
    vector = pinocchio.log3(axes)
    degrees = round(float(np.degrees(np.linalg.norm(vector))))
    axis = vector / np.linalg.norm(vector)
    k = int(np.abs(axis).argmax())
    if np.abs(axis[k]) > 0.99:
        return f"{what} is mounted turned by {degrees}° about {'xyz'[k]}"
    return f"{what} is mounted turned: its axes are others of the base"


def _is(found: Mat, wanted: Mat) -> bool:
    return bool(np.abs(found - wanted).max() < _NEAR)


def _vectors(start: Vec, ends: Sequence[Vec]) -> list[Vec]:
    R = rotation(start)
    return [pinocchio.log3(R.T @ rotation(end)) for end in ends]


def _turns(start: Vec, ends: Sequence[Vec]) -> Mat:
    """The axes (3, 3) of the turns, a column each."""
    return np.array([vector / max(float(np.linalg.norm(vector)), 1e-9) for vector in _vectors(start, ends)]).T


def _up(quaternion: Vec, force: Vec) -> float:
    """Cosine between what both say is up."""
    return float(rotation(quaternion)[2] @ force / np.linalg.norm(force))


def _mean(readings: Sequence[Reading], name: str) -> Vec:
    values = np.array([getattr(reading, name) for reading in readings])
    if name == "quaternion":  # q and −q are the same
        values *= np.sign(values @ values[-1])[:, None]
    mean: Vec = values.mean(axis=0)
    return mean
