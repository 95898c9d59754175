"""Files of arrays, .npz: written by name, and read wherever they came from: plain arrays, never a pickle."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInput
from wbc.files import Place, located, written

MAX_BYTES = 1 << 30  # of all arrays of a file together
MAX_ARRAYS = 100_000
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def read_npz(path: Place) -> dict[str, NDArray[Any]]:
    """All arrays of a file by name.

    What a header promises is compared with what the file holds before any memory is set aside, and what the file
    says it holds with ``MAX_BYTES``: a small file cannot ask for a large memory. Nothing is written to disk.

    Raises:
        InvalidInput: no such file, not a plain file, not such an archive, too large, objects instead of numbers.
    """
    path = located(path)
    if not path.is_file():
        raise InvalidInput(f"{path} cannot be read: there is no such file" + " (it is no plain file)" * path.exists())
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len(members) > MAX_ARRAYS or sum(member.file_size for member in members) > MAX_BYTES:
                raise InvalidInput(f"{path} holds more than {MAX_ARRAYS} arrays or {MAX_BYTES >> 30} GiB")
            found = {}
            for member in members:
                with archive.open(member) as entry:
                    found[member.filename.removesuffix(".npy")] = _read(path, member, entry)
            return found
    except (OSError, EOFError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error) as cause:
        if isinstance(cause, InvalidInput):
            raise
        raise InvalidInput(f"{path} cannot be read: {cause}") from cause


def write_npz(path: Place, **arrays: Any) -> None:
    """Write arrays by name, compressed; the file is complete before it takes its name.

    Raises:
        InvalidInput: something else than a file stands there, or nothing can be written there.
    """
    with written(path) as aside, aside.open("wb") as file:
        write_arrays(file, arrays)


def write_arrays(file: IO[bytes], arrays: Mapping[str, Any]) -> None:
    """An .npz by hand: np.savez would take arrays called ``file`` or ``allow_pickle`` for its own arguments."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asarray(values), allow_pickle=False)


def read_json(where: str, text: str | bytes) -> Any:
    """What a text in json says.

    Raises:
        InvalidInput: it is not json, or nested too deep.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as cause:
        raise InvalidInput(f"{where} is not json: {cause}") from None


def _read(path: Path, member: zipfile.ZipInfo, entry: IO[bytes]) -> NDArray[Any]:
    name = member.filename
    read_header = _HEADERS.get(np.lib.format.read_magic(entry))
    if read_header is None:
        raise InvalidInput(f"{path} cannot be read: {name} has a version of the format that is not known")
    shape, fortran, dtype = read_header(entry)
    if dtype.hasobject:
        raise InvalidInput(f"{path} cannot be read: {name} holds Python objects; only numbers and text are read")
    count = 1
    for size in shape:
        count *= size
    if any(size < 0 for size in shape) or count * dtype.itemsize != member.file_size - entry.tell():
        raise InvalidInput(
            f"{path} cannot be read: {name} says it is {dtype} of shape {shape}, which is not what the file holds"
        )
    array = np.frombuffer(bytearray(entry.read()), dtype=dtype)
    return array.reshape(shape, order="F" if fortran else "C") if count else np.zeros(shape, dtype)
