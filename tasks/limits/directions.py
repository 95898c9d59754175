"""Directions as users give them."""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.types import Vec


def unit(what: str, value: Any) -> Vec:
    """``value`` (3,) made one long.

    Raises:
        InvalidInput: another shape, not finite, zero.
    """
    vector = checks.array(what, value, (3,))
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise InvalidInput(f"{what} is a vector of length {length:g}; it must point somewhere")
    return vector / length
