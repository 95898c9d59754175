"""Plugins: members that other packages register in an entry-point group, by name."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any


class BrokenPlugin(UserWarning):
    """An entry point that cannot be loaded; everything else works without it."""


def registered(group: str) -> dict[str, Any]:
    """All members of the entry-point group ``group``: each entry point is a mapping, or an iterable of named objects.

    An entry point that raises, or calls ``sys.exit``, loses only its own members, with a :class:`BrokenPlugin` warning
    that names it.

    Example:
        >>> from wbc.plugins import registered
        >>> registered("no.such.group")
        {}
    """
    found: dict[str, Any] = {}
    for point in entry_points(group=group):
        try:
            loaded = point.load()
            members = dict(loaded) if isinstance(loaded, Mapping) else {member.name: member for member in loaded}
        except (Exception, SystemExit) as cause:
            warnings.warn(
                f"{group} of {point.value} cannot be loaded and is left out: {one_line(cause)}", BrokenPlugin, 2
            )
            continue
        found |= {str(name): member for name, member in members.items()}
    return found


def one_line(error: BaseException) -> str:
    """Type and first line of an error that somebody else's code raised."""
    return f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else 'no message'}"
