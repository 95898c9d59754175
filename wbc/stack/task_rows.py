"""Where members write their rows: views into the plan's own memory."""

from __future__ import annotations

from typing import Any

from wbc.errors import UnknownArray
from wbc.types import Mat, Vec


class FilledRows:
    """Arrays of a plan that members fill: ``out.e = …`` writes into the array that the plan gave, as ``out.e[:] = …``.

    Raises:
        ValueError: an assignment that does not have the shape of the array, nor one that numpy repeats to it.
        UnknownArray: an array that these rows do not have, with those that they have.

    Example:
        >>> import numpy as np
        >>> from wbc.stack.task_rows import TaskRows
        >>> memory, out = np.zeros(2), TaskRows()
        >>> out.drift = memory
        >>> out.drift = [1.0, 2.0]
        >>> memory
        array([1., 2.])
    """

    __slots__ = ()

    def __setattr__(self, name: str, value: Any) -> None:
        if hasattr(self, name):
            getattr(self, name)[...] = value
        elif hasattr(type(self), name):
            object.__setattr__(self, name, value)
        else:
            self.__getattr__(name)

    def __getattr__(self, name: str) -> Any:
        """Only called for what is not there, or is not given yet."""
        if hasattr(type(self), name):
            raise AttributeError(name)
        raise UnknownArray(name, (array for array in dir(type(self)) if array[0] != "_"), "out")


class TaskRows(FilledRows):
    """Where a kinematic task, or a contact, writes: views into the plan's own memory, ``dim`` rows.

    e (dim,)          error, target − actual
    J (dim, nv)       Jacobian of the actual value
    drift (dim,)      J̇ v; read at the acceleration level only
    rate_ref (dim,)   velocity of the target, zero unless written
    acc_ref (dim,)    acceleration of the target, zero unless written
    ed (dim,)         rate of the error; left alone it is rate_ref − J v, which the plan computes for all tasks at once

    ``out.e[:] = …`` and ``out.e = …`` both write into the array.
    """

    __slots__ = ("J", "acc_ref", "drift", "e", "ed", "rate_ref")

    e: Vec
    J: Mat
    drift: Vec
    rate_ref: Vec
    acc_ref: Vec
    ed: Vec
