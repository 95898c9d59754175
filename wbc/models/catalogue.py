"""The robots that ``load`` knows by name: three of our own, and those of the package example-robot-data."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, final

from wbc.errors import ModelError
from wbc.models.feet import Foot

OWN_ROBOTS = Path(__file__).parent / "robots"


@final
@dataclass(frozen=True)
class Entry:
    """Where a robot's files are, how it stands, and what it stands on.

    The stance is given by joint name, or by ``pose``, a group state of the SRDF beside the file (with a floating base:
    the one in which it stands); joints that are not named rest.
    """

    urdf: str
    base: Literal["fixed", "floating", "planar"] = "fixed"
    stance: Mapping[str, float] = field(default_factory=dict)
    pose: str | None = None
    rigid: Sequence[str] = ()
    feet: tuple[Foot, ...] | None = None


def example_robots() -> Path:
    """The folder of the package example-robot-data, found without importing it.

    Raises:
        ModelError: it is not installed.
    """
    import pinocchio

    prefixes = [*Path(pinocchio.__file__).parents, *(Path(entry) / "cmeel.prefix" for entry in sys.path)]
    for prefix in prefixes:
        folder = prefix / "share" / "example-robot-data"
        if (folder / "robots").is_dir():
            return folder
    raise ModelError("the package example-robot-data is not installed; pip install example-robot-data")


def _entry(said: dict[str, Any]) -> Entry:
    """One table of the file."""
    each, foot = said.pop("each", ()), said.pop("foot", None)

    def spread(name: str) -> list[str]:
        return [name.replace("*", one) for one in each] if "*" in name else [name]

    stance = {joint: q for name, q in said.pop("stance", {}).items() for joint in spread(name)}
    if foot is None:
        return Entry(**said, stance=stance)
    foot = {key: tuple(value) if isinstance(value, list) else value for key, value in foot.items()}
    return Entry(**said, stance=stance, feet=tuple(Foot(**foot | {"frame": one}) for one in spread(foot["frame"])))


_READ = tomllib.loads((OWN_ROBOTS / "catalogue.toml").read_text(encoding="utf-8"))
OWN: Mapping[str, Entry] = {name: _entry(said) for name, said in _READ["own"].items()}
EXAMPLES: Mapping[str, Entry] = {name: _entry(said) for name, said in _READ["examples"].items()}
