"""What users' code may hand over: values that are no answer to anything, and functions that misbehave."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np


class Hostile:
    """Refuses to be converted, compared or printed."""

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("hostile")

    __array__ = __float__ = __len__ = __iter__ = __eq__ = __bool__ = __repr__ = __str__ = _refuse
    __hash__ = object.__hash__


def values() -> list[Any]:
    """Nonsense of every type."""
    return [
        None, np.nan, np.inf, -np.inf, 1e300, -1e300, 5e-324, 10**400, -3, 3, True, 1j, "x", "3.0", b"x", "", [], (),
        {}, [[1], [2, 3]], [None], [1j], ["1", "2"], object(), Hostile(), np.zeros((2, 2, 2)), np.zeros(0),
        np.full(7, np.nan), np.full(7, 1e308), np.zeros(7, complex), np.zeros(100_000), np.datetime64("2026-01-01"),
        np.timedelta64(1, "s"), np.full(7, np.datetime64("2026-01-01")), np.array(["1"] * 7), float, len,
    ]  # fmt: skip


class Broke(Exception):
    """What users' code raises; its own text cannot be had."""

    def __str__(self) -> str:
        raise RuntimeError("no text")


EXCEPTIONS: tuple[type[Exception], ...] = (
    ValueError, IndexError, KeyError, ZeroDivisionError, TypeError, AttributeError, RuntimeError, StopIteration,
    RecursionError, MemoryError, OSError, AssertionError, UnicodeError, FloatingPointError, Broke,
)  # fmt: skip


def functions() -> Iterator[Callable[..., Any]]:
    """Functions that raise or give nonsense."""
    for kind in EXCEPTIONS:
        yield _raising(kind)
    for value in values():
        yield _giving(value)
        yield _giving((value, value, value))
    for size in (0, 1, 2, 4):
        yield _giving(np.zeros(size))
        yield _giving((np.zeros(3), np.zeros(size), np.zeros(3)))


def _raising(kind: type[Exception]) -> Callable[..., Any]:
    def function(*_: Any, **__: Any) -> Any:
        raise kind("users' code")

    return function


def _giving(value: Any) -> Callable[..., Any]:
    return lambda *_, **__: value
