"""Objects as JSON and back, to the bit: of classes that the reader names, never of one that the file names."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from dataclasses import fields
from math import isfinite
from typing import Any, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.packing import packed, packs, unpacked
from wbc.report.packed import text

_IS = "is"


@final
class Codec:
    """Writes values and objects of these ``kinds``, dataclasses or named tuples, as JSON values, and reads them back.

    An object becomes {"is": class name, field: value, ...}; a list becomes a tuple; arrays are of numbers.

    Example:
        >>> from wbc.report.coded import Codec
        >>> from wbc.sweep import Range
        >>> codec = Codec([Range])
        >>> codec.plain(Range(0.0, 1.0))
        {'is': 'Range', 'low': 0.0, 'high': 1.0, 'whole': False}
        >>> codec.whole(codec.plain((Range(0.0, 1.0), 2)))
        (Range(low=0.0, high=1.0, whole=False), 2)
    """

    def __init__(self, kinds: Iterable[type]) -> None:
        self._kinds: dict[str, Any] = {kind.__name__: kind for kind in kinds}

    def plain(self, value: Any) -> Any:
        """``value`` as JSON values.

        Raises:
            InvalidInput: something that :meth:`whole` could not read back.
        """
        if isinstance(value, np.generic):
            value = value.item()
        if value is None or isinstance(value, bool | int | str) or (isinstance(value, float) and isfinite(value)):
            return value
        if isinstance(value, float):
            return {_IS: "float", "of": str(value)}
        if self._kinds.get(type(value).__name__) is type(value):
            return {_IS: type(value).__name__} | {
                name: self.plain(getattr(value, name)) for name in _names(type(value))
            }
        if isinstance(value, tuple | list):
            return [self.plain(item) for item in value]
        if isinstance(value, Mapping) and _IS not in value and all(isinstance(key, str) for key in value):
            return {key: self.plain(item) for key, item in value.items()}
        if isinstance(value, bytes):
            return {_IS: "bytes", "of": text(np.frombuffer(value, np.uint8))}
        if isinstance(value, np.ndarray) and value.dtype != object:
            exact = np.asarray(value, dtype="<f8")
            numbers, times = packed(exact) if packs(exact) else (exact, None)
            return {_IS: "array", "of": text(numbers), "shape": list(numbers.shape), "times": times}
        raise InvalidInput(f"{value!r} has no form in JSON that can be read back")

    def whole(self, value: Any) -> Any:
        """What :meth:`plain` was given.

        Raises:
            InvalidInput: a kind that is none of the reader's, or fields that it does not have.
        """
        if isinstance(value, list):
            return tuple(self.whole(item) for item in value)
        if not isinstance(value, dict):
            return value
        more = {key: item for key, item in value.items() if key != _IS}
        match value.get(_IS):
            case "float":
                return float(more["of"])
            case "bytes":
                return base64.b64decode(more["of"])
            case "array":
                return _array(base64.b64decode(more["of"]), more["shape"], more["times"])
        more = {key: self.whole(item) for key, item in more.items()}
        if _IS not in value:
            return more
        kind = self._kinds.get(value[_IS]) if isinstance(value[_IS], str) else None
        if kind is None or set(more) != set(_names(kind)):
            raise InvalidInput(f"{value[_IS]!r} with {', '.join(more) or 'nothing'} is nothing that can be read here")
        return kind(**more)


def _names(kind: Any) -> tuple[str, ...]:
    return kind._fields if issubclass(kind, tuple) else tuple(one.name for one in fields(kind))


def _array(content: bytes, shape: Any, times: int | None) -> Any:
    numbers = np.frombuffer(content, "<f8" if times is None else np.uint8).reshape(shape)
    return numbers if times is None else unpacked(numbers, int(times))
