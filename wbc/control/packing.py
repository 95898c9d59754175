"""Columns of measured numbers on disk, smaller and to the bit: differences of their bits from tick to tick, by bytes.

Doubles of one sign lie in the order of their bits, read as whole numbers; of a smooth motion the k-th difference of
these from tick to tick is small. Its bytes are stored apart from one another, the upper ones being nearly all the same.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInput

#: Differences are taken at most so often; each one adds a bit of the noise that is in the last digits.
MOST = 8
#: So many ticks from the middle say how often it is best.
SAMPLE = 256
#: Shorter columns are stored as they are.
FEW = 64
_ALL_BUT_SIGN = np.int64(0x7FFFFFFFFFFFFFFF)


def packs(values: NDArray[Any]) -> bool:
    """Whether it is a column that :func:`packed` can store."""
    return values.dtype == np.float64 and values.ndim in (1, 2) and len(values) >= FEW and values.size > 0


def packed(values: NDArray[Any]) -> tuple[NDArray[np.uint8], int]:
    """The bytes (8, k, N) of a column (N, k), or (8, N) of one (N,), and how often differences were taken.

    Example:
        >>> import numpy as np
        >>> from wbc.control.packing import packed, unpacked
        >>> column = np.sin(1e-3 * np.arange(1000.0))
        >>> stored, times = packed(column)
        >>> stored.shape, bool(np.all(unpacked(stored, times) == column))
        ((8, 1000), True)
    """
    bits = np.ascontiguousarray(values.T).view(np.int64)
    bits = bits ^ ((bits >> 63) & _ALL_BUT_SIGN)  # in the order of the numbers, negative ones too
    return differenced(bits, most=MOST, sample=SAMPLE)


def differenced(whole: NDArray[Any], *, most: int, sample: int) -> tuple[NDArray[np.uint8], int]:
    """The bytes (b, ..., N) of signed whole numbers (..., N) of b bytes, the last byte first, and how often differences
    were taken along N: at most ``most`` times, as ``sample`` numbers from the middle pack best. Numbers may wrap."""
    start = max(0, (whole.shape[-1] - sample) // 2)
    some, sizes = whole[..., start : start + sample], []
    for _ in range(most + 1):
        sizes.append(len(zlib.compress(_bytes(some).tobytes(), 1)))
        some = np.diff(some, axis=-1, prepend=some[..., :1])
    times = int(np.argmin(sizes))
    for _ in range(times):
        whole = np.diff(whole, axis=-1, prepend=np.zeros_like(whole[..., :1]))
    return _bytes(whole), times


def unpacked(stored: NDArray[Any], times: int) -> NDArray[np.float64]:
    """The column that :func:`packed` was given, to the bit.

    Raises:
        InvalidInput: it is not what :func:`packed` gives.
    """
    if stored.dtype != np.uint8 or stored.ndim not in (2, 3) or stored.shape[0] != 8 or not 0 <= times <= MOST:
        raise InvalidInput(f"a packed column is bytes of shape (8, k, N) and at most {MOST} differences")
    bits = np.ascontiguousarray(np.moveaxis(stored, 0, -1)).view("<i8")[..., 0].astype(np.int64)
    bits = (bits >> 1 & _ALL_BUT_SIGN) ^ -(bits & 1)
    for _ in range(times):
        bits = np.cumsum(bits, axis=-1)
    bits = bits ^ ((bits >> 63) & _ALL_BUT_SIGN)
    return np.ascontiguousarray(bits.view(np.float64).T)


def _bytes(whole: NDArray[Any]) -> NDArray[np.uint8]:
    """The bytes of whole numbers, small ones of either sign with zeros in the upper bytes, the last byte first."""
    size = whole.dtype.itemsize
    folded = np.ascontiguousarray((whole << 1) ^ (whole >> (8 * size - 1))).astype(f"<i{size}")
    return np.ascontiguousarray(np.moveaxis(folded[..., None].view(np.uint8), -1, 0))
