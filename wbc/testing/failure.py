"""CheckFailed, the error of all checks, and the sentences that it says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from wbc.errors import InvalidInput, WbcError

T = TypeVar("T")

#: Differences of numbers near 1, along steps of 1e-5, are off by less.
_TOLERANCE = 1e-5


class CheckFailed(WbcError, AssertionError):
    """A member breaks a rule; the message says which, where, and the two numbers that differ."""


def require(condition: Any, sentence: str) -> None:
    """Raise ``sentence`` unless ``condition``."""
    if not condition:
        raise CheckFailed(sentence)


def accepted(call: Callable[..., T], *arguments: Any) -> T:
    """What ``call(*arguments)`` gives, as where a stack is compiled.

    Raises:
        CheckFailed: it refuses a member, and says why.
    """
    try:
        return call(*arguments)
    except InvalidInput as refused:
        raise CheckFailed(str(refused)) from refused


def differs(where: str, *, what: str, wrote: float, by: str, found: float, hint: str = "") -> CheckFailed:
    """The failure of a number that is not what another way to it gives."""
    return CheckFailed(f"{where}: {what} is {wrote:.6g}, {by} is {found:.6g}{hint}")


def worst(found: Any, expected: Any, sizes: Any = 1.0) -> tuple[int, ...] | None:
    """Index of the largest difference beyond 1e-5 · (1 + max |expected|), all in the ``sizes`` of the rows, or None."""
    found, expected = ((np.asarray(values).T / sizes).T for values in (found, expected))
    if found.size == 0:
        return None
    off = np.abs(found - expected)
    at = np.unravel_index(int(np.argmax(off)), off.shape)
    allowed = _TOLERANCE * (1.0 + float(np.abs(expected).max()))
    return None if off[at] <= allowed else tuple(int(i) for i in at)
