"""Target: a reference that a task follows, and how what a user gives becomes what a task reads."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import partial
from numbers import Real
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, MemberFailed
from wbc.types import Vec

#: ``convert(name, value, strict)``: strict when assigned, shapes only in a tick; see :class:`Target`.
Convert = Callable[[str, Any, bool], Any]


@final
class Target:
    """A reference: a value, or a function of time giving a value or (value, rate, acceleration).

    ``convert(name, value, strict)`` turns what a user gives into what a task reads. It is strict (shape, finite)
    when a target is assigned; in a tick only types and shapes are looked at, because a robot needs a command: a
    NaN that comes later is caught by the certificate. Rates and accelerations are (dim,), or what ``convert_rate``
    makes so.
    """

    __slots__ = (
        "_convert", "_convert_rate", "_name", "_shape", "_still", "first", "function", "rate", "second", "value",
    )  # fmt: skip

    def __init__(self, name: str, value: Any, dim: int, convert: Convert, convert_rate: Convert | None = None) -> None:
        self._convert_rate = convert_rate
        self._name, self._shape, self._convert = name, (dim,), convert
        #: The function of time that it is; None for a value.
        self.function: Callable[[float], Any] | None = None
        #: What the function gave for t = 0.
        self.first: Any = None
        self.value: Any = None
        self._still = np.zeros(dim)
        self.rate = self.second = self._still
        if callable(value):
            self.function = value
            try:
                self.first = value(0.0)
            except Exception as cause:
                raise MemberFailed(name, cause) from cause
            self.value = convert(name, self._without_rates(self.first, strict=True), True)
        else:
            self.value = convert(name, value, True)

    def at(self, t: float) -> Target:
        """Evaluate at time t [s]; then read ``value``, ``rate``, ``second``."""
        if self.function is not None:
            value = self._without_rates(self.function(t), strict=False)
            self.value = self._convert(self._name, value, False)
        return self

    def still(self) -> Target:
        """The same with the value of now, whatever the time: no function is called."""
        same = copy(self)
        same.function = None
        return same

    @property
    def is_finite(self) -> bool:
        """Whether the value, its rate and its acceleration are, as they were evaluated last."""
        value = self.value if isinstance(self.value, tuple) else (self.value,)
        return all(np.isfinite(part).all() for part in (*value, self.rate, self.second))

    def _without_rates(self, result: Any, strict: bool) -> Any:
        """The value of what a function gave, whose rate and acceleration are read where there are some."""
        if not isinstance(result, tuple):
            self.rate = self.second = self._still
            return result
        if len(result) != 3 or (isinstance(result[0], Real) and self._shape != (1,)):
            raise InvalidInput(
                f"{self._name}(t) must give a value or (value, rate, acceleration); give a value of several numbers "
                "as a list or an array, not as a tuple"
            )
        value, rate, second = result
        if strict:  # of three that are wrong in the same way the value is named
            self._convert(self._name, value, True)
        if strict or not type(rate) is type(second) is np.ndarray or not rate.shape == second.shape == self._shape:
            rate = self._vector("rate", rate, strict)
            second = self._vector("acceleration", second, strict)
        self.rate, self.second = rate, second
        return value

    def _vector(self, what: str, value: Any, strict: bool) -> Vec:
        if self._convert_rate is not None:
            converted: Vec = self._convert_rate(f"{self._name} {what}", value, strict)
            return converted
        return shaped(self._shape, f"{self._name} {what}", value, strict)


def vector_target(dim: int) -> Callable[[str, Any, bool], Vec]:
    """The converter of a :class:`Target` whose values are vectors (dim,)."""
    return partial(shaped, (dim,))


def floats(name: str, value: Any) -> Vec:
    """``value`` as an array of floats, the same object where it is one.

    Raises:
        InvalidInput: what it holds is not real numbers.
    """
    if type(value) is np.ndarray and value.dtype == np.float64:
        return value
    try:
        return checks.floats(value)
    except Exception as cause:  # a conversion may raise whatever it likes
        raise InvalidInput(f"{name} must be an array of numbers, not {checks.shown(value)}") from cause


def shaped(shape: tuple[int, ...], name: str, value: Any, strict: bool) -> Vec:
    """``value`` as an array of this shape; finite, if strict.

    Raises:
        InvalidInput: another shape, no real numbers; strict: not finite.
    """
    if strict:
        return checks.array(name, value, shape)
    array = floats(name, value)
    if array.shape != shape:
        raise InvalidInput(f"{name} must have shape {shape}, not {array.shape}")
    return array
