"""BVH: the hierarchy of a motion capture file, and where it places every joint.

A reader of our own, because the one that is kept on PyPI (bvhio 1.5.4) never returns from a file that ends early, works
in single precision, and needs one exact version of a compiled package.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInput
from wbc.types import Mat, Vec

#: Joints inside one another, joints in all, and numbers in all, at most.
_DEPTH, _JOINTS, _NUMBERS = 100, 1000, 50_000_000
_CHANNELS = {f"{axis}{kind}": (kind, k) for k, axis in enumerate("XYZ") for kind in ("position", "rotation")}


@final
@dataclass(frozen=True)
class _Joint:
    name: str
    parent: int
    offset: tuple[float, float, float]
    channels: tuple[str, ...]


def read_bvh(path: Path) -> tuple[float, dict[str, Mat], dict[str, Vec]]:
    """Frames per second, and of every joint by name its positions (N, 3) and rotations (N, 3, 3) in the axes and the
    unit of the file. Ends of chains are called after their joint, with " end".

    Raises:
        InvalidInput: no such file, or a place at which it is no BVH file.
    """
    try:
        words = path.read_text(encoding="utf-8", errors="strict").split()
    except (OSError, ValueError) as cause:
        raise InvalidInput(f"{path} cannot be read: {cause}") from None
    reader = _Reader(path, words)
    joints, frames, seconds = reader.header()
    width = sum(len(joint.channels) for joint in joints)
    if frames * width > _NUMBERS or len(reader.left) != frames * width:
        raise InvalidInput(f"{path} has {len(reader.left)} numbers of motion; {frames} frames of {width} are promised")
    try:
        table = np.array(reader.left, dtype=np.float64).reshape(frames, width)
    except ValueError as cause:
        raise InvalidInput(f"{path}: {cause} in the motion") from None
    return 1.0 / seconds, *_placed(joints, table)


@final
class _Reader:
    """Words of a file one after the other."""

    def __init__(self, path: Path, words: list[str]) -> None:
        self._path, self._words, self._at = path, words, 0

    @property
    def left(self) -> list[str]:
        """Words that were not taken."""
        return self._words[self._at :]

    def header(self) -> tuple[list[_Joint], int, float]:
        """The joints, parents first, how many frames there are, and seconds from one to the next."""
        joints: list[_Joint] = []
        self._expect("HIERARCHY")
        self._expect("ROOT")
        self._joint(joints, self._name(), -1, 0)
        self._expect("MOTION")
        self._expect("Frames:")
        frames = self._number()
        self._expect("Frame")
        self._expect("Time:")
        seconds = self._number()
        if not (frames >= 1 and frames == int(frames) and seconds > 0.0):
            raise self._wrong(f"{frames:g} frames of {seconds:g} s")
        if len({joint.name for joint in joints}) < len(joints):
            raise self._wrong("two joints of one name")
        return joints, int(frames), seconds

    def _joint(self, joints: list[_Joint], name: str, parent: int, depth: int) -> None:
        if depth > _DEPTH or len(joints) > _JOINTS:
            raise self._wrong("more joints than a body has")
        self._expect("OFFSET")
        offset = self._number(), self._number(), self._number()
        word, channels = self._word(), list[str]()
        if word == "CHANNELS":
            channels = [self._word() for _ in range(int(self._number()))]
            word = self._word()
        if set(channels) - set(_CHANNELS) or len(set(channels)) < len(channels):
            raise self._wrong(f"channels {' '.join(channels)}")
        own = len(joints)
        joints.append(_Joint(name, parent, offset, tuple(channels)))
        while word != "}":
            if word not in ("JOINT", "End"):
                raise self._wrong(f"{word!r} in joint {name!r}")
            called = self._name()
            self._joint(joints, called if word == "JOINT" else f"{name} end", own, depth + 1)
            word = self._word()

    def _name(self) -> str:
        return " ".join(iter(self._word, "{"))

    def _word(self) -> str:
        if self._at == len(self._words):
            raise self._wrong("its end")
        self._at += 1
        return self._words[self._at - 1]

    def _number(self) -> float:
        word = self._word()
        try:
            value = float(word)
        except ValueError:
            value = np.nan
        if not abs(value) < 1e9:
            raise self._wrong(f"{word!r} in place of a number")
        return value

    def _expect(self, wanted: str) -> None:
        word = self._word()
        if word != wanted:
            raise self._wrong(f"{word!r} in place of {wanted!r}")

    def _wrong(self, what: str) -> InvalidInput:
        return InvalidInput(f"{self._path} is no BVH file: {what[:80]} at word {self._at}")


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
        turns = "".join("XYZ"[axis] for kind, axis in kinds if kind == "rotation")
        if turns:
            angles = values[:, [kind == "rotation" for kind, _ in kinds]]
            own = Rotation.from_euler(turns, angles, degrees=True).as_matrix().reshape(n, 3, 3)
        if joint.parent >= 0:
            above = rotations[joint.parent]
            place, own = positions[joint.parent] + np.einsum("nij,nj->ni", above, place), above @ own
        positions.append(place)
        rotations.append(own)
    names = [joint.name for joint in joints]
    return dict(zip(names, positions, strict=True)), dict(zip(names, rotations, strict=True))
