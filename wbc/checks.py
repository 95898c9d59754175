"""Checks of arguments where they enter: one sentence that names argument, index and value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wbc.errors import InvalidInput
from wbc.types import Vec

#: No length, angle, gain or weight that means something is larger; sums and squares of smaller ones keep their digits.
LARGEST = 1e15


def array(
    name: str,
    value: Any,
    shape: Sequence[int | None],
    *,
    finite: bool = True,
    error: type[InvalidInput] = InvalidInput,
) -> Vec:
    """A float64 copy of ``value`` with the given shape (``None``: any size).

    Raises:
        InvalidInput: not numbers, another shape, or (with ``finite``) NaN or inf.
    """
    try:
        if np.iscomplexobj(value):
            raise TypeError("complex numbers")
        result = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as cause:
        raise error(f"{name} must be an array of numbers, not {value!r}") from cause
    wanted = tuple(shape)
    if result.ndim != len(wanted) or any(w is not None and w != s for w, s in zip(wanted, result.shape, strict=True)):
        text = "(" + ", ".join("any" if w is None else str(w) for w in wanted) + ("," if len(wanted) == 1 else "") + ")"
        raise error(f"{name} must have shape {text}, not {result.shape}")
    bad = np.isnan(result) if not finite else ~np.isfinite(result)
    if bad.any():
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        index = where[0] if len(where) == 1 else where
        at = f"[{index}]" if where else ""
        raise error(f"{name}{at} is {result[where]}; it must be {'finite' if finite else 'a number'}")
    if finite and error is InvalidInput and result.size and not -LARGEST <= result.min() <= result.max() <= LARGEST:
        index = tuple(int(i) for i in np.argwhere(np.abs(result) > LARGEST)[0])
        at = f"[{index[0] if len(index) == 1 else index}]" if index else ""
        raise error(f"{name}{at} is {result[index]:g}; it must be between -{LARGEST:g} and {LARGEST:g}")
    return result


def number(
    name: str,
    value: Any,
    *,
    low: float = -np.inf,
    high: float = np.inf,
    strict: bool = False,
    error: type[InvalidInput] = InvalidInput,
) -> float:
    """A finite float in [low, high] (``strict``: greater than ``low``).

    Raises:
        InvalidInput: not a finite number, or out of range.
    """
    try:
        result = float(value)
    except (TypeError, ValueError) as cause:
        raise error(f"{name} must be a number, not {value!r}") from cause
    if not np.isfinite(result):
        raise error(f"{name} is {result}; it must be finite")
    if abs(result) > LARGEST:
        raise error(f"{name} is {result:g}; it must be between -{LARGEST:g} and {LARGEST:g}")
    if result < low or result > high or (strict and result <= low):
        sign = ">" if strict else ">="
        allowed = f"{sign} {low:g}" if high == np.inf else f"between {low:g} and {high:g}"
        raise error(f"{name} is {result:g}; it must be {allowed}")
    return result


def gains(name: str, value: Any, size: int) -> Vec:
    """A number >= 0 for each of ``size`` rows, from one for all or (size,).

    Raises:
        InvalidInput: wrong size, negative or not finite.
    """
    result = array(name, np.full(size, value) if np.ndim(value) == 0 else value, (size,))
    if (result < 0).any():
        i = int(np.argmax(result < 0))
        raise InvalidInput(f"{name}[{i}] is {result[i]:g}; it must be >= 0")
    return result


def limit(name: str, value: Any, size: int) -> Vec:
    """A limit per joint: a positive number or array, ``inf`` where there is none. Never zero, negative or NaN.

    Raises:
        InvalidInput: wrong size, or an entry that is not positive.
    """
    result = np.array(value, dtype=np.float64)
    if result.ndim == 0:
        result = np.full(size, float(result))
    result = array(name, result, (size,), finite=False)
    if (result <= 0).any():
        i = int(np.argmax(result <= 0))
        raise InvalidInput(f"{name}[{i}] is {result[i]:g}; a limit must be positive (inf: no limit)")
    return result
