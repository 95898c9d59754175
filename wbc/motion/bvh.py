"""BVH: the hierarchy of a motion capture file, and where it places every joint.

A reader of our own, because those that are kept on PyPI lack what files need: pybvh 0.9 refuses joints that have places
of their own, as some programs write them for every joint, bvhtools 1.6 ignores them, and upc-pymotion 0.3 takes them
for rotations; bvhio 1.5.4 and bvhtools never return from a file that ends early.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wbc import checks
from wbc.errors import InvalidInput
from wbc.types import Mat, Vec

#: Words with one blank behind each: a joint up to its first child, the end of one, and what follows the joints.
_JOINT = re.compile(
    r"(?:(?P<root>HIERARCHY ROOT)|JOINT|(?P<end>End)) (?P<name>(?:[^ {}]+ ){1,9})\{ "
    r"OFFSET (?P<offset>(?:[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,2})? ){3})"
    r"(?:CHANNELS (?P<count>\d) (?P<channels>(?:[XYZ](?:position|rotation) ){0,6}))?|(?P<shut>\} )"
)
_MOTION = re.compile(r"MOTION Frames: (\d{1,9}) Frame Time: ([^ ]+) ")
_MOST = 1000
#: The axes of files, y up and z ahead, in those of the world: x ahead, z up.
_AXES = Rotation.from_matrix([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


#: What a file says: frames per second, and "positions" {name: (N, 3)}, perhaps "rotations" {name: (N, 3, 3)} and
#: "contacts" {name: (N,)}, by what it calls its parts.
Read = tuple[float, dict[str, dict[str, Vec]]]
#: {joint: (parent, offset, channels)}, parents first; the root's parent is "".
_Joints = dict[str, tuple[str, list[float], list[str]]]


def read_bvh(path: Path) -> Read:
    """Frames per second, and of every joint by name its positions in the unit of the file and its rotations, z up. Ends
    of chains are called after their joint, with " end".

    Raises:
        InvalidInput: no such file, or a place at which it is no BVH file.
    """
    try:
        text = " ".join(path.read_text(encoding="utf-8-sig").split()) + " "
    except (OSError, ValueError) as cause:
        raise InvalidInput(f"{path} cannot be read: {cause}") from None
    joints, at = _hierarchy(path, text)
    motion = _MOTION.match(text, at)
    if motion is None:
        raise _wrong(path, text, at)
    numbers, frames, width = text[motion.end() :].split(), int(motion[1]), sum(len(one[2]) for one in joints.values())
    if len(numbers) != frames * width or not frames:
        raise InvalidInput(f"{path} has {len(numbers)} numbers of motion; {frames} frames of {width} are promised")
    try:
        table = np.array(numbers, dtype=np.float64).reshape(frames, width)
    except ValueError as cause:
        raise InvalidInput(f"{path}: {cause} in the motion") from None
    return 1.0 / checks.typed(f"{path}: Frame Time", motion[2], low=0.0, strict=True), _placed(joints, table)


def _hierarchy(path: Path, text: str) -> tuple[_Joints, int]:
    """The joints, and where the text behind them begins."""
    joints, inside, at = _Joints(), [""], 0
    while len(inside) > 1 or not joints:
        found = _JOINT.match(text, at)
        if found is None or bool(found["root"]) == bool(joints) or len(joints) == _MOST:
            raise _wrong(path, text, at)
        if found["shut"]:
            inside.pop()
        else:
            name = f"{inside[-1]} end" if found["end"] else found["name"].strip()
            channels = (found["channels"] or "").split()
            if len(set(channels)) != int(found["count"] or 0):
                raise _wrong(path, text, at)
            if name in joints:
                raise InvalidInput(f"{path} is no BVH file: two joints have one name, {name!r}")
            joints[name] = inside[-1], [float(x) for x in found["offset"].split()], channels
            inside.append(name)
        at = found.end()
    return joints, at


def _wrong(path: Path, text: str, at: int) -> InvalidInput:
    return InvalidInput(f"{path} is no BVH file at {text[at : at + 60].strip() or 'its end'!r}")


def _placed(joints: _Joints, table: Mat) -> dict[str, dict[str, Vec]]:
    """Joints in the world: p = p_parent + R_parent (offset or the channels' place), R = R_parent R_channels."""
    columns, positions, rotations = iter(table.T), dict[str, Mat](), dict[str, Rotation]()
    for name, (parent, offset, channels) in joints.items():
        place, turned = np.tile(offset, (len(table), 1)), Rotation.identity(len(table))
        for channel, values in zip(channels, columns, strict=False):
            if channel.endswith("position"):
                place[:, "XYZ".index(channel[0])] = values
            else:
                turned = turned * Rotation.from_euler(channel[0], values[:, None], degrees=True)
        start, above = positions.get(parent, 0.0), rotations.get(parent, _AXES)
        positions[name], rotations[name] = start + above.apply(place), above * turned
    return {"positions": positions, "rotations": {name: turned.as_matrix() for name, turned in rotations.items()}}
