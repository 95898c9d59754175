"""Plugins: what commands find by name, registered by packages in one entry-point group, ``wbc.scenarios``."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import TypeVar

from wbc.errors import warn

GROUP = "wbc.scenarios"
T = TypeVar("T")


class BrokenPlugin(UserWarning):
    """An entry point that cannot be loaded; everything else works without it."""


def registered(kind: type[T]) -> dict[str, T]:
    """All registered members that are of ``kind``, by name.

    Each entry point is a mapping, or an iterable of named objects. One that raises, or calls
    ``sys.exit``, loses only its own members, with a :class:`BrokenPlugin` warning that names it.

    Example:
        >>> from wbc.plugins import registered
        >>> registered(str)
        {}
    """
    found: dict[str, T] = {}
    for point in entry_points(group=GROUP):
        try:
            loaded = point.load()
            members = dict(loaded) if isinstance(loaded, Mapping) else {member.name: member for member in loaded}
        except (Exception, SystemExit) as cause:
            warn(f"{GROUP} of {point.value} cannot be loaded and is left out: {one_line(cause)}", BrokenPlugin)
            continue
        found |= {str(name): member for name, member in members.items() if isinstance(member, kind)}
    return found


def one_line(error: BaseException) -> str:
    """Type and first line of an error that somebody else's code raised."""
    return f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else 'no message'}"
