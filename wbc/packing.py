"""Columns of measured numbers on disk, smaller and to the bit: differences of their bits from tick to tick, by bytes.

Doubles of one sign lie in the order of their bits, read as whole numbers; of a smooth motion the k-th difference of
these from tick to tick is small. Its bytes are stored apart from one another, the upper ones being nearly all the same.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInput
from wbc.npz import MAX_BYTES, read_json

#: Differences are taken at most so often; each one adds a bit of the noise that is in the last digits.
MOST = 8
#: So many ticks from the middle say how often it is best.
SAMPLE = 256
#: Shorter columns are stored as they are.
FEW = 64
_ALL_BUT_SIGN = np.int64(0x7FFFFFFFFFFFFFFF)
#: The array of a file that is no column: it says how the columns are stored.
HOW = ".stored"


def packs(values: NDArray[Any]) -> bool:
    """Whether it is a column that :func:`packed` can store."""
    return values.dtype == np.float64 and values.ndim in (1, 2) and len(values) >= FEW and values.size > 0


def packed(values: NDArray[Any]) -> tuple[NDArray[np.uint8], int]:
    """The bytes (8, k, N) of a column (N, k), or (8, N) of one (N,), and how often differences were taken.

    Example:
        >>> import numpy as np
        >>> from wbc.packing import packed, unpacked
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


def stored(columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays to write. The last says in json how each column is one of them: packed, by so many differences; as it
    is (null); or the same as that of another name.

    Raises:
        InvalidInput: a column that is called as this array is.
    """
    if HOW in columns:
        raise InvalidInput(f"no column may be called {HOW!r}: a saved run says there how it is stored")
    arrays, how, known = dict[str, NDArray[Any]](), dict[str, int | str | None](), dict[bytes, str]()
    for name, values in columns.items():
        if not packs(values):
            arrays[name], how[name] = values, None
            continue
        earlier = known.setdefault(values.tobytes() + repr(values.shape).encode(), name)
        if earlier != name:
            how[name] = earlier
        else:
            arrays[name], how[name] = packed(values)
    return {**arrays, HOW: np.array(json.dumps(how))}


def restored(path: Path, arrays: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The columns that :func:`stored` was given; arrays that do not say how they are stored are columns.

    Raises:
        InvalidInput: they are not what :func:`stored` gives; ``path`` is where they were found.
    """
    if HOW not in arrays:
        return arrays
    columns, size = dict[str, NDArray[Any]](), 0
    try:
        for name, said in read_json(f"{path}: {HOW}", str(arrays[HOW])).items():
            if isinstance(said, str):
                columns[name] = columns[said].copy()
            else:
                columns[name] = arrays[name] if said is None else unpacked(arrays[name], int(said))
            size += columns[name].nbytes
            if size > MAX_BYTES:
                raise InvalidInput(f"its columns are larger than {MAX_BYTES >> 30} GiB")
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, InvalidInput) as cause:
        raise InvalidInput(f"{path} cannot be read: {cause}") from cause
    return columns
