"""By name: rows, such as joints, that are meant by a name or a pattern, and numbers that are given so."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, UnknownJoint, UnknownName
from wbc.types import Vec


def pattern(what: str, given: Any) -> str:
    """``given``, which is a name or a regular expression.

    Raises:
        InvalidInput: neither.
    """
    given = checks.text(what, given)
    try:
        re.compile(given)
    except (re.error, OverflowError, RecursionError) as cause:
        raise InvalidInput(f"{what} is {checks.shown(given)}: no name, and no regular expression: {cause}") from cause
    return str(given)


def patterns(what: str, given: Any) -> tuple[str, ...]:
    """``given``, which are names or regular expressions: at least one, each once.

    Raises:
        InvalidInput: something else.
    """
    return tuple(pattern(f"{what}[{i}]", one) for i, one in enumerate(checks.names(what, given)))


def meant(what: str, given: str, names: Sequence[str], unknown: type[UnknownName]) -> list[int]:
    """Where in ``names`` the name ``given`` is, or all those that it matches from first letter to last.

    Raises:
        UnknownName: it matches none; with the names that are near.
    """
    names = list(names)
    if given in names:
        return [names.index(given)]
    whole = re.compile(given)
    found = [i for i, name in enumerate(names) if whole.fullmatch(name)]
    if not found:
        raise unknown(given, names, what)
    return found


def all_meant(what: str, given: Sequence[str], joints: Sequence[str]) -> list[int]:
    """Of several names and patterns, each joint once: in the order given, those of a pattern in that of ``joints``.

    Raises:
        UnknownJoint: one of them matches none.
    """
    return list(dict.fromkeys(i for one in given for i in meant(what, one, joints, UnknownJoint)))


@final
class ByName(Mapping[str, float]):
    """Numbers >= 0 by name or pattern; of several that match, the last holds. ``what`` they are is for messages.

    Raises:
        InvalidInput: a key that is no pattern, a value that is no number >= 0.
    """

    __slots__ = ("_given", "_what")

    def __init__(self, what: str, given: Mapping[Any, Any]) -> None:
        self._what = what
        self._given = {
            pattern(f"a key of {what}", key): checks.number(f"{what}[{checks.shown(key)}]", value, low=0.0)
            for key, value in given.items()
        }

    def rows(self, names: Sequence[str], default: float, unknown: type[UnknownName]) -> Vec:
        """A number for each of ``names``, ``default`` where no key matches.

        Raises:
            UnknownName: a key that matches none.
        """
        found = np.full(len(names), default)
        for key, value in self._given.items():
            found[meant(self._what, key, names, unknown)] = value
        return found

    def __getitem__(self, key: str) -> float:
        return self._given[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._given)

    def __len__(self) -> int:
        return len(self._given)

    def __repr__(self) -> str:
        return repr(self._given)
