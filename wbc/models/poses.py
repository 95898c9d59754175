"""Named configurations: group states of an SRDF, positions by joint, and which of several a robot stands in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, ModelError
from wbc.models.safe_xml import read_xml
from wbc.types import Vec

#: Positions by joint; one number, two (cosine and sine) of a joint without end, seven of a base that floats.
NamedPose = Mapping[str, Sequence[float]]
#: What a floating base is called among the joints: x y z, quaternion x y z w.
BASE = "root_joint"
#: How configurations in which robots stand are called, or begin to be called; the first that there is.
_STANDING = ("half_sitting", "standing", "stand", "home", "homing", "default")


def root_joint(joints: Iterable[str]) -> str:
    """What the joint of a floating base is called: as none of ``joints``, as Pinocchio takes joints of one name for
    one."""
    name, taken = BASE, set(joints)
    while name in taken:
        name += "_"
    return name


class Sized(Protocol):
    """A robot of ``nq`` numbers, of which a floating base (``nb`` 6) has the first seven."""

    nq: int
    nb: int


def configuration(model: Sized, name: str, q: Any) -> Vec:
    """The configuration (nq,) that is given as an argument of that name.

    Raises:
        InvalidInput: wrong shape, not finite, or a quaternion that is not of length 1 within 1e-6.
    """
    found: Vec = checks.array(name, q, (model.nq,))
    length = float(np.linalg.norm(found[3:7]))
    if model.nb and abs(length - 1.0) > 1e-6:
        raise InvalidInput(f"{name}[3:7] is a quaternion of length {length:g}; it must be 1")
    return found


def read_poses(path: Path) -> dict[str, dict[str, list[float]]]:
    """The group states of an SRDF by name; a base that floats is called "root_joint".

    Raises:
        ModelError: not an SRDF, or something that is not a finite number.
    """
    found = {}
    try:
        for state in read_xml(path, "robot").iter("group_state"):
            joints = [(joint.get("name", ""), joint.get("value", "")) for joint in state.iter("joint")]
            found[state.get("name", "")] = {name: list(map(_number, text.split())) for name, text in joints}
    except (ModelError, ValueError) as cause:
        raise ModelError(f"{checks.shown(str(path))}: {cause}") from None
    return found


def _number(text: str) -> float:
    if not isfinite(value := float(text)):
        raise ValueError(f"{text!r} is not a finite number")
    return value


def srdf_beside(path: Path) -> Path | None:
    """The SRDF in the folder of a robot's file, or in a folder ``srdf`` in or beside it, whose name is the file's or
    what the file's begins with."""
    folders = (path.parent, path.parent / "srdf", path.parent.parent / "srdf")
    files = [file for folder in folders for file in sorted(folder.glob("*.srdf")) if path.stem.startswith(file.stem)]
    return max(files, key=lambda file: len(file.stem), default=None)


def standing(names: Iterable[str]) -> str | None:
    """The one of several configurations that a robot most likely stands in, by its name."""
    shortest = sorted(names, key=len)
    return next((name for word in _STANDING for name in shortest if name.startswith(word)), None)
