"""How many calls of numpy, BLAS, LAPACK and DAQP a tick makes: from Python each costs more than what it computes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any, final

import daqp
import numpy as np

from wbc.types import Vec


@final
class _Counting:
    """A module whose functions count when they are called."""

    def __init__(self, module: ModuleType, count: Callable[[], None]) -> None:
        self._module, self._count = module, count

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._module, name)
        return _counted(value, self._count) if callable(value) and not isinstance(value, type) else value


def _counted(function: Any, count: Callable[[], None]) -> Any:
    def counting(*arguments: Any, **named: Any) -> Any:
        count()
        return function(*arguments, **named)

    return counting


@contextmanager
def counted_calls() -> Iterator[list[int]]:
    """Count in the first entry of a list: functions of numpy, scipy and DAQP by name, and methods of arrays.

    Operators (``a += b``) and slices are not seen.
    """
    calls, replaced = [0], []

    def count() -> None:
        calls[0] += 1

    def profile(_frame: Any, event: str, argument: Any) -> None:
        if event == "c_call" and isinstance(getattr(argument, "__self__", None), np.ndarray):
            calls[0] += 1

    for name, module in list(sys.modules.items()):
        if module is None or name == __name__ or not name.startswith("wbc."):
            continue
        for key, value in list(vars(module).items()):
            compiled = type(value).__name__ == "fortran"
            if value is np or value is daqp:
                replaced.append((module, key, value))
                setattr(module, key, _Counting(value, count))
            elif compiled:
                replaced.append((module, key, value))
                setattr(module, key, _counted(value, count))
    before = sys.getprofile()
    sys.setprofile(profile)
    try:
        yield calls
    finally:
        sys.setprofile(before)
        for module, key, value in replaced:
            setattr(module, key, value)


def calls_of(tick: Callable[[int], object], ticks: int) -> Vec:
    """Calls of each of so many ticks (ticks,)."""
    found = np.zeros(ticks)
    for k in range(ticks):
        with counted_calls() as calls:
            tick(k)
        found[k] = calls[0]
    return found
