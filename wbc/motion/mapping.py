"""Mapping: which frame of a robot follows which part of a body, and how much that counts."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Self

from wbc import checks
from wbc.errors import InvalidInput, UnknownFrame, UnknownMapping, UnknownName
from wbc.files import Place, located
from wbc.models.pinocchio_ import PinocchioModel

#: Weights of position [1/m²] and orientation [1/rad²] of a part where the mapping says none.
_WEIGHTS = {"pelvis": (1.0, 1.0), "chest": (0.0, 1.0), "head": (0.0, 0.1)}
_SIDED = {
    "hip": (0.0, 0.0), "knee": (0.05, 0.0), "foot": (100.0, 20.0), "shoulder": (0.0, 0.0), "elbow": (0.3, 0.0),
    "wrist": (1.0, 0.0),
}  # fmt: skip
#: Parts that a mapping names, with these weights; "head" may be left out.
PARTS = _WEIGHTS | {f"{side}_{part}": _SIDED[part] for side in ("left", "right") for part in _SIDED}


class Follower(NamedTuple):
    """A frame, its weights on position [1/m²] and orientation [1/rad²], and an ``offset`` (3,) [m] of what it follows,
    in axes ahead, left and up of the part of the body."""

    frame: str
    position: float
    orientation: float
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)


class Table(NamedTuple):
    """``followers`` {part: Follower} and the ``scale`` of the world: a metre of the person is so many of the robot.

    ``scale`` None: found by the lengths of the legs, so that the robot may stretch them as far as the person.

    Example:
        >>> import wbc
        >>> from wbc.motion.mapping import Table
        >>> Table.of(wbc.load("humanoid", base="floating")).followers["left_foot"].frame
        'left_sole'
    """

    followers: Mapping[str, Follower]
    scale: float | None = None
    name: str = "mapping"

    @classmethod
    def of(cls, robot: PinocchioModel, given: Place | Table | None = None) -> Table:
        """The mapping for a robot: one that was made, that of a TOML file, or the one that comes with the library.

        Raises:
            InvalidInput: no such file, or one that says what makes no sense. UnknownFrame: a frame the robot lacks.
            UnknownMapping: nothing was given, and none comes with the library for this robot.
        """
        if given is None:
            known = {path.stem: path for path in Path(__file__).with_name("mappings").glob("*.toml")}
            given = next((path for name, path in known.items() if robot.name.lower().startswith(name)), None)
            if given is None:
                raise UnknownMapping(robot.name, known, "give the path of one of your own")
        made = cls._checked(given.name, *given) if isinstance(given, Table) else cls.read(given)
        for part, follower in made.followers.items():
            if follower.frame not in robot.frame_names:
                hint = f"the mapping {made.name} says that it follows {part}"
                raise UnknownFrame(follower.frame, robot.frame_names, hint)
        return made

    @classmethod
    def read(cls, path: Place) -> Self:
        """From a TOML file with a table ``[frames]``: a part = "frame", or {frame, position, orientation, offset}.

        Raises:
            InvalidInput: no such file, no TOML, a part that is unknown or missing, a weight that is negative.
        """
        place = located(path)
        if not place.exists():
            raise InvalidInput(f"{place} cannot be read: there is no such file")
        try:
            said = tomllib.loads(place.read_text(encoding="utf-8-sig"))
        except (OSError, ValueError, RecursionError) as cause:
            raise InvalidInput(f"{place} cannot be read: {cause}") from None
        frames, scale = said.pop("frames", None), said.pop("scale", None)
        if not isinstance(frames, dict) or said:
            raise InvalidInput(f"{place} needs a table [frames], perhaps a number 'scale', and nothing else")
        return cls._checked(str(place), frames, scale, place.stem)

    @classmethod
    def _checked(cls, where: str, followers: Any, scale: Any, name: str) -> Self:
        frames = checks.instance(f"{where}: followers", followers, Mapping, "frames by the parts of a body")
        if unknown := [part for part in frames if part not in PARTS]:
            raise InvalidInput(f"{where}: {UnknownName(unknown[0], PARTS)}")
        found = {part: _follower(f"{where}: {part}", *PARTS[part], value) for part, value in frames.items()}
        if lacking := [part for part in PARTS if part not in frames and part != "head"]:
            raise InvalidInput(f"{where} names no frame for {', '.join(lacking)}")
        scale = None if scale is None else checks.number(f"{where}: scale", scale, low=0.0, strict=True)
        return cls(found, scale, name)


def _follower(name: str, position: float, orientation: float, value: Any) -> Follower:
    said = {"frame": value} if isinstance(value, str) else value._asdict() if isinstance(value, Follower) else value
    if not isinstance(said, dict) or "frame" not in said or set(said) - set(Follower._fields):
        raise InvalidInput(f"{name} is {checks.shown(value)}; it must be a frame or {{{', '.join(Follower._fields)}}}")
    asked = checks.number(f"{name}.orientation", said.get("orientation", orientation), low=0.0)
    if asked > 0.0 and not orientation > 0.0:
        raise InvalidInput(f"{name}.orientation is {asked:g}; only pelvis, chest, head and feet have an orientation")
    return Follower(
        checks.text(f"{name}.frame", said["frame"]),
        checks.number(f"{name}.position", said.get("position", position), low=0.0),
        asked,
        tuple(checks.array(f"{name}.offset", said.get("offset", (0.0, 0.0, 0.0)), (3,)).tolist()),
    )
