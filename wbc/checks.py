"""Checks of arguments where they enter: one sentence that names argument, index and value."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from numbers import Integral
from typing import Any, TypeVar

import numpy as np

from wbc.errors import InvalidInput, NotSupported
from wbc.tolerances import MET, SAME
from wbc.types import Mat, Vec

#: No length, angle, gain or weight that means something is larger; sums and squares of smaller ones keep their digits.
LARGEST = 1e15
_T = TypeVar("_T")


def ndim(value: Any) -> int:
    """Dimensions of ``value`` as an array; -1 where it is none."""
    try:
        return int(np.ndim(value))
    except Exception:  # a ragged list, or an object whose conversion raises whatever it likes
        return -1


def floats(value: Any) -> Vec:
    """``value`` as an array of float64, a copy; of real numbers only.

    Raises:
        TypeError: complex numbers, text, times, None or other objects. ValueError, OverflowError: ragged, too large.
    """
    result = np.array(value)
    if result.dtype == object:
        if any(isinstance(one, complex | np.complexfloating | str | bytes | None) for one in result.flat):
            raise TypeError("an entry that is no real number")
    elif result.dtype.kind not in "fiub":
        raise TypeError(f"{result.dtype} is no type of real numbers")
    return result.astype(np.float64, copy=False)


def array(
    name: str,
    value: Any,
    shape: Sequence[int | None],
    *,
    finite: bool = True,
    low: float = -LARGEST,
    error: type[InvalidInput] = InvalidInput,
) -> Vec:
    """A float64 copy of ``value`` with the given shape (``None``: any size).

    Raises:
        InvalidInput: not real numbers, another shape, or (with ``finite``) NaN, inf or a number below ``low``.
    """
    wanted = tuple(shape)
    # A loop converts sound arrays in every period; what follows costs several times as much. NaN fails the comparison.
    is_numbers = type(value) is np.ndarray and value.dtype == np.float64 and value.shape == wanted
    if is_numbers and abs(value).max(initial=0.0) <= LARGEST and (low == -LARGEST or value.min(initial=low) >= low):
        return value.copy()  # type: ignore[no-any-return]
    try:
        result = floats(value)
    except Exception as cause:  # a conversion may raise whatever it likes
        raise error(f"{name} must be an array of numbers, not {shown(value)}") from cause
    if result.ndim != len(wanted) or any(w is not None and w != s for w, s in zip(wanted, result.shape, strict=True)):
        text = "(" + ", ".join("any" if w is None else str(w) for w in wanted) + ("," if len(wanted) == 1 else "") + ")"
        raise error(f"{name} must have shape {text}, not {result.shape}")
    bad = np.isnan(result) if not finite else ~np.isfinite(result)
    if bad.any():
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        index = where[0] if len(where) == 1 else where
        at = f"[{index}]" if where else ""
        raise error(f"{name}{at} is {result[where]}; it must be {'finite' if finite else 'a number'}")
    if finite and error is InvalidInput and result.size and not low <= result.min() <= result.max() <= LARGEST:
        index = tuple(int(i) for i in np.argwhere((result < low) | (result > LARGEST))[0])
        at = f"[{index[0] if len(index) == 1 else index}]" if index else ""
        allowed = f"between {low:g} and {LARGEST:g}" if abs(result[index]) > LARGEST else f">= {low:g}"
        raise error(f"{name}{at} is {result[index]:g}; it must be {allowed}")
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
    if type(value) is float and max(low, -LARGEST) <= value <= min(high, LARGEST) and not (strict and value == low):
        return value
    try:
        if isinstance(value, str | bytes | bytearray):
            raise TypeError("text")
        result = float(value) if isinstance(value, float | int) else float(floats(value)[()])
    except Exception as cause:  # a conversion may raise whatever it likes
        raise error(f"{name} must be a number, not {shown(value)}") from cause
    if not np.isfinite(result):
        raise error(f"{name} is {result}; it must be finite")
    if result < low or result > high or (strict and result <= low) or abs(result) > LARGEST:
        sign = ">" if strict else ">="
        if high == np.inf and abs(result) <= LARGEST:
            allowed = f"{sign} {low:g}"
        else:
            least, most = max(low, -LARGEST), min(high, LARGEST)
            allowed = f"between {least:g} and {most:g}" + f", {low:g} excluded" * strict
        raise error(f"{name} is {result:g}; it must be {allowed}")
    return result


def typed(name: str, text: str, **limits: float) -> float:
    """A number from the text that a user typed, such as an option of a command; ``limits`` as for :func:`number`.

    Raises:
        InvalidInput: not a finite number, or out of range.
    """
    try:
        value: Any = float(text)
    except ValueError:
        value = text
    return number(name, value, **limits)  # type: ignore[arg-type]


def each(name: str, value: Any, size: int, *, finite: bool = True, low: float = -LARGEST) -> Vec:
    """A number for each of ``size`` rows (size,), from one for all or (size,).

    Raises:
        InvalidInput: not real numbers, another size, or (with ``finite``) NaN, inf or a number below ``low``.
    """
    if ndim(value) == 0:
        return np.full(size, array(name, value, (), finite=finite, low=low))
    return array(name, value, (size,), finite=finite, low=low)


def one_or_more(name: str, value: Any, *, finite: bool = True, low: float = -LARGEST) -> Vec:
    """A number () or several (n,), whichever was given.

    Raises:
        InvalidInput: not real numbers, in a list of lists, or (with ``finite``) NaN, inf or a number below ``low``.
    """
    if ndim(value) > 1:
        raise InvalidInput(f"{name} has shape {np.shape(value)}; it must be a number or (n,)")
    return array(name, value, (None,) * ndim(value), finite=finite, low=low)


def text(name: str, value: Any) -> str:
    """``value``, which is text, such as the name of a frame.

    Raises:
        InvalidInput: something else.
    """
    if not isinstance(value, str):
        raise InvalidInput(f"{name} is {shown(value)}; it must be text")
    return value


def instance(name: str, value: Any, kind: type[_T], what: str) -> _T:
    """``value``, which is a ``kind``, ``what`` in words.

    Raises:
        InvalidInput: something else.
    """
    if not isinstance(value, kind):
        raise InvalidInput(f"{name} is {shown(value)}; it must be {what}")
    return value


def function(name: str, value: Any, what: str) -> Any:
    """``value``, which can be called; ``what`` it is in words.

    Raises:
        InvalidInput: something else.
    """
    if not callable(value):
        raise InvalidInput(f"{name} is {shown(value)}; it must be {what}")
    return value


def truth(name: str, value: Any) -> bool:
    """``value`` as True or False.

    Raises:
        InvalidInput: neither; a text or a number is none, whatever Python takes it for.
    """
    if not isinstance(value, bool | np.bool_):
        raise InvalidInput(f"{name} is {shown(value)}; it must be True or False")
    return bool(value)


def seed(name: str, value: Any) -> int:
    """``value`` as what random numbers are drawn from.

    Raises:
        InvalidInput: not a whole number from 0 to 2^63.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 0 <= value <= 2**63:
        raise InvalidInput(f"{name} is {shown(value)}; it must be a whole number from 0 to 2^63")
    return int(value)


def one_of(name: str, value: Any, allowed: Iterable[Any]) -> Any:
    """``value``, which is one of ``allowed``, each a text or a number.

    Raises:
        InvalidInput: something else; the message has what is allowed.
    """
    allowed = list(allowed)
    if not isinstance(value, str | int | np.integer) or value not in allowed:
        listed = " or ".join(map(repr, allowed)) if len(allowed) == 2 else f"one of {', '.join(map(str, allowed))}"
        raise InvalidInput(f"{name} is {shown(value)}; it must be {listed}")
    return value


def items(name: str, value: Any, what: str) -> list[Any]:
    """``value`` as a list, of ``what``; text is no list of letters.

    Raises:
        InvalidInput: it is text, or cannot be gone through.
    """
    try:
        if isinstance(value, str | bytes):
            raise TypeError("text")
        return list(value)
    except Exception as cause:  # going through it may raise whatever it likes
        raise InvalidInput(f"{name} is {shown(value)}; it must be {what}, in a list") from cause


def names(name: str, value: Any, allowed: Sequence[str] = ()) -> tuple[str, ...]:
    """``value`` as a tuple of texts, at least one, each once, and of those ``allowed`` where any are given.

    Raises:
        InvalidInput: something else.
    """
    found = items(name, value, "names")
    for i, one in enumerate(found):
        if allowed and (not isinstance(one, str) or one not in allowed or one in found[:i]):
            raise InvalidInput(f"{name}[{i}] is {shown(one)}; each is one of {', '.join(allowed)}, once")
        text(f"{name}[{i}]", one)
    if len(set(found)) < max(len(found), 1):
        raise InvalidInput(f"{name} is {shown(value)}; it must be names, at least one, each once")
    return tuple(found)


def pairs(name: str, value: Any, what: str) -> list[tuple[Any, Any]]:
    """``value`` as a list of pairs of ``what``.

    Raises:
        InvalidInput: it is no list, or one of its entries is no pair; with its index.
    """
    found = []
    for i, one in enumerate(items(name, value, f"({what})")):
        entry = items(f"{name}[{i}]", one, f"two: {what}")
        if len(entry) != 2:
            raise InvalidInput(f"{name}[{i}] is {shown(one)}; it must be ({what})")
        found.append((entry[0], entry[1]))
    return found


def moments(name: str, value: Any) -> list[tuple[float, Any, Any]]:
    """``value`` as a list of states (t, q, v); what is in them is not looked at.

    Raises:
        InvalidInput: it is no list, it is empty, or one of its entries is not three values; with its index.
    """
    found = items(name, value, "(t, q, v)")
    if not found:
        raise InvalidInput(f"{name} is empty; give at least one (t, q, v)")
    for i, one in enumerate(found):
        if not isinstance(one, tuple | list) or len(one) != 3:
            raise InvalidInput(f"{name}[{i}] is {shown(one)}; it must be (t, q, v)")
    return found


def pair(name: str, value: Any, what: str) -> tuple[Any, Any]:
    """``value`` as two values, ``what`` in words.

    Raises:
        InvalidInput: not two.
    """
    found = items(name, value, f"({what})")
    if len(found) != 2:
        raise InvalidInput(f"{name} is {shown(value)}; it must be ({what})")
    return found[0], found[1]


def shown(value: Any) -> str:
    """``value`` in a message: its representation on one line, shortened, whatever that is."""
    try:
        text = " ".join(repr(value).split())
    except Exception as cause:
        return f"a {type(value).__name__} (its repr raised {type(cause).__name__})"
    return text if len(text) <= 200 else f"{text[:200]}..."


def packages(what: str, *modules: str, extra: str) -> None:
    """Check that ``modules``, which ``what`` needs, are installed, before any long work.

    Raises:
        NotSupported: one is missing; the message says which ``extra`` of this distribution brings it.
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise NotSupported(f"{what} needs {', '.join(missing)}; from a clone of wbc: pip install '.[{extra}]'")


def rotation(name: str, matrix: Mat) -> None:
    """Refuse numbers (3, 3), all finite, that are no rotation.

    Raises:
        InvalidInput: R Rᵀ is not the identity, or the matrix is a mirror image.
    """
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    long = max(abs(a * a + b * b + c * c - 1.0), abs(d * d + e * e + f * f - 1.0), abs(g * g + h * h + i * i - 1.0))
    off = max(long, abs(a * d + b * e + c * f), abs(d * g + e * h + f * i), abs(g * a + h * b + i * c))
    if off > MET:
        raise InvalidInput(f"{name} is not a rotation: R Rᵀ differs from the identity by {off:.2g}; allowed is {MET:g}")
    if a * (e * i - f * h) < b * (d * i - f * g) - c * (d * h - e * g):
        raise InvalidInput(f"{name} is not a rotation: its determinant is -1 (a mirror image)")


def symmetric(name: str, matrix: Mat, *, error: type[InvalidInput] = InvalidInput) -> None:
    """Refuse a matrix (n, n) that is not symmetric but for rounding.

    Raises:
        InvalidInput, or ``error``: naming the two entries that differ most.
    """
    skew = np.abs(matrix - matrix.T)
    if skew.max(initial=0.0) > SAME * np.abs(matrix).max(initial=0.0):
        i, j = np.unravel_index(int(skew.argmax()), skew.shape)
        entries = f"{name}[{i}, {j}] = {matrix[i, j]:g}, {name}[{j}, {i}] = {matrix[j, i]:g}"
        raise error(f"{name} is not symmetric: {entries}")


def rows(name: str, member: object) -> None:
    """Refuse a ``member`` of this name whose rows have no number or no units.

    Raises:
        InvalidInput: ``dim`` is no positive whole number, or ``units`` are neither a text nor one for each row.
    """
    dim, units = getattr(member, "dim", None), getattr(member, "units", None)
    if not isinstance(dim, Integral) or dim < 1:
        raise InvalidInput(
            f"{name}.dim is {shown(dim)}; set it, and units, in __init__: a positive integer, how many rows there are"
        )
    if not isinstance(units, str) and not (isinstance(units, tuple | list) and len(units) == dim):
        raise InvalidInput(f"{name}.units is {units!r}; set it in __init__: a text, or {dim}, one for each row")


def gains(name: str, value: Any, size: int) -> Vec:
    """A number >= 0 for each of ``size`` rows, from one for all or (size,).

    Raises:
        InvalidInput: wrong size, negative or not finite.
    """
    return each(name, value, size, low=0.0)


def limit(name: str, value: Any, size: int) -> Vec:
    """A limit per joint: a positive number or array, ``inf`` where there is none. Never zero, negative or NaN.

    Raises:
        InvalidInput: wrong size, or an entry that is not positive.
    """
    result = each(name, value, size, finite=False)
    if (result <= 0).any():
        i = int(np.argmax(result <= 0))
        raise InvalidInput(f"{name}[{i}] is {result[i]:g}; a limit must be positive (inf: no limit)")
    return result
