"""Views of memory that another library owns, and objects that refuse attributes which their class does not declare."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from inspect import get_annotations
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from wbc.errors import UnknownAttribute
from wbc.types import Mat, Vec


@cache
def _attributes(kind: type[Any]) -> frozenset[str]:
    """What objects of a class have."""
    return frozenset(dir(kind)).union(*(get_annotations(base) for base in kind.__mro__))


class Known:
    """What has the attributes that its class declares, and no others."""

    if not TYPE_CHECKING:  # else any attribute could be assigned

        def __setattr__(self, name: str, value: Any) -> None:
            if name[0] != "_" and name not in _attributes(type(self)):
                known = [one for one in _attributes(type(self)) if one[0] != "_"]
                raise UnknownAttribute(name, known, f"a {type(self).__name__} has none")
            object.__setattr__(self, name, value)


class Shared:
    """Memory of an owner, offered to numpy: an array made of it keeps the owner alive, and cannot be written.

    ``layout``: another shape and strides [bytes] than the array's.
    """

    def __init__(self, array: NDArray[np.float64], owner: object, **layout: tuple[int, ...]) -> None:
        interface = dict(array.__array_interface__) | layout
        interface["data"] = (interface["data"][0], True)
        self.__array_interface__ = interface
        self._owner = owner


def view(array: NDArray[np.float64], owner: object, *shape: int) -> NDArray[np.float64]:
    """The same memory, read only. What Pinocchio hands out does not always keep its Data alive, and drops an axis
    of length one; this does not."""
    view = np.asarray(Shared(array, owner))
    return view.reshape(shape) if shape else view


def matrix(call: Callable[[], Any], columns: int) -> Callable[[], Mat]:
    """A Jacobian; for a robot of one joint Pinocchio gives a vector."""
    return call if columns > 1 else lambda: call().reshape(6, 1)


@final
@dataclass(frozen=True, eq=False)
class JointMemory:
    """Where compiled code finds a joint: rotation and position in the world, spatial velocity and acceleration.

    ``placement`` of a frame in the joint: rotation by rows, position. ``columns`` of the Jacobian that move it.
    """

    placement: Vec
    columns: list[int]
    arrays: tuple[Vec, ...]
    owner: object
