"""BVH: the hierarchy of a motion capture file, and where it places every joint.

A reader of our own, because those that are kept on PyPI lack what files need: pybvh 0.9 refuses joints that have places
of their own, as some programs write them for every joint; bvhio 1.5.4 never returns from a file that ends early, and
works in single precision.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInput
from wbc.types import Mat, Vec

#: Words with one blank behind each: a joint up to its first child or its end, and what follows the joints.
_JOINT = re.compile(
    r"(?:ROOT|JOINT|(End)) ((?:[^ {}]+ ){1,9})\{ OFFSET ((?:[^ {}]+ ){3})"
    r"(?:CHANNELS (\d{1,3}) ((?:[^ {}]+ ){0,6}?))?(?=JOINT |End |\} )"
)
_MOTION = re.compile(r"MOTION Frames: (\d{1,9}) Frame Time: ([^ ]+) ")
_CHANNELS = {f"{axis}{kind}": (kind, k) for k, axis in enumerate("XYZ") for kind in ("position", "rotation")}
_JOINTS = 1000


class _Joint(NamedTuple):
    name: str
    parent: int
    offset: list[float]
    channels: list[str]


def read_bvh(path: Path) -> tuple[float, dict[str, Mat], dict[str, Vec]]:
    """Frames per second, and of every joint by name its positions (N, 3) and rotations (N, 3, 3) in the axes and the
    unit of the file. Ends of chains are called after their joint, with " end".

    Raises:
        InvalidInput: no such file, or a place at which it is no BVH file.
    """
    try:
        text = " ".join(path.read_text(encoding="utf-8").split()) + " "
    except (OSError, ValueError) as cause:
        raise InvalidInput(f"{path} cannot be read: {cause}") from None
    joints, at = _hierarchy(path, text)
    motion = _MOTION.match(text, at)
    if motion is None:
        raise _wrong(path, text, at)
    numbers, frames, width = text[motion.end() :].split(), int(motion[1]), sum(len(one.channels) for one in joints)
    if len(numbers) != frames * width or not frames:
        raise InvalidInput(f"{path} has {len(numbers)} numbers of motion; {frames} frames of {width} are promised")
    try:
        seconds, table = float(motion[2]), np.array(numbers, dtype=np.float64).reshape(frames, width)
    except ValueError as cause:
        raise InvalidInput(f"{path}: {cause} in the motion") from None
    if not 0.0 < seconds < np.inf:
        raise InvalidInput(f"{path}: frames of {seconds:g} s")
    return 1.0 / seconds, *_placed(joints, table)


def _hierarchy(path: Path, text: str) -> tuple[list[_Joint], int]:
    """The joints, parents first, and where the text behind them begins."""
    at, joints, inside = len("HIERARCHY "), list[_Joint](), list[int]()
    while inside or not joints:
        found = _JOINT.match(text, at)
        if text.startswith("} ", at) and inside:
            at += len("} ")
            inside.pop()
        elif found is None or not text.startswith("HIERARCHY ROOT ") or len(joints) == _JOINTS:
            raise _wrong(path, text, at if joints else 0)
        else:
            end, name, offset, count, channels = found.groups(default="0")
            parent, kinds = inside[-1] if inside else -1, channels.split() if int(count) else []
            called = f"{joints[parent].name} end" if end == "End" else name.strip()
            try:
                joints.append(_Joint(called, parent, [float(x) for x in offset.split()], kinds))
            except ValueError:
                raise _wrong(path, text, at) from None
            if set(kinds) - set(_CHANNELS) or len(set(kinds)) != int(count) or not np.isfinite(joints[-1].offset).all():
                raise _wrong(path, text, at)
            inside.append(len(joints) - 1)
            at = found.end()
    if len({joint.name for joint in joints}) < len(joints):
        raise InvalidInput(f"{path} is no BVH file: two joints have one name")
    return joints, at


def _wrong(path: Path, text: str, at: int) -> InvalidInput:
    return InvalidInput(f"{path} is no BVH file at {text[at : at + 60].strip() or 'its end'!r}")


def _placed(joints: list[_Joint], table: Mat) -> tuple[dict[str, Mat], dict[str, Vec]]:
    """Joints in the world: p = p_parent + R_parent (offset or the channels' place), R = R_parent R_channels."""
    n, at = len(table), 0
    positions: list[Mat] = []
    rotations: list[Vec] = []
    for joint in joints:
        kinds = [_CHANNELS[channel] for channel in joint.channels]
        values, at = table[:, at : at + len(kinds)], at + len(kinds)
        place, own = np.tile(joint.offset, (n, 1)), np.tile(np.eye(3), (n, 1, 1))
        for (kind, axis), value in zip(kinds, values.T, strict=True):
            if kind == "position":
                place[:, axis] = value
        if turns := "".join("XYZ"[axis] for kind, axis in kinds if kind == "rotation"):
            angles = values[:, [kind == "rotation" for kind, _ in kinds]]
            own = Rotation.from_euler(turns, angles, degrees=True).as_matrix().reshape(n, 3, 3)
        if joint.parent >= 0:
            above = rotations[joint.parent]
            place, own = positions[joint.parent] + np.einsum("nij,nj->ni", above, place), above @ own
        positions.append(place)
        rotations.append(own)
    names = [joint.name for joint in joints]
    return dict(zip(names, positions, strict=True)), dict(zip(names, rotations, strict=True))
