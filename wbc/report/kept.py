"""What a scenario shows of its own, in a file beside the record: sections as data, read back to the bit."""

from __future__ import annotations

import base64
import gzip
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wbc.control.packing import packed, packs, unpacked
from wbc.errors import InvalidInput
from wbc.npz import MAX_BYTES, read_json
from wbc.report.document import (
    Address,
    Bar,
    Bound,
    Curve,
    Figure,
    Link,
    Map,
    Marked,
    Plot,
    Section,
    Strip,
    Table,
    Text,
)

SECTIONS_FILE = "sections.json.gz"
KINDS: Mapping[str, Any] = {
    kind.__name__: kind
    for kind in (Address, Bar, Bound, Curve, Figure, Link, Map, Marked, Plot, Section, Strip, Table, Text)
}


def keep_sections(sections: Sequence[Section], folder: Path) -> None:
    """Write ``sections`` into ``folder``; nothing where there are none."""
    if sections:
        text = json.dumps([_plain(section) for section in sections], ensure_ascii=False)
        (folder / SECTIONS_FILE).write_bytes(gzip.compress(text.encode(), mtime=0))


def kept_sections(folder: Path) -> list[Section]:
    """What :func:`keep_sections` wrote there.

    Raises:
        InvalidInput: it is something else.
    """
    path = folder / SECTIONS_FILE
    if not path.is_file():
        return []
    try:
        with gzip.open(path) as file:
            text = file.read(MAX_BYTES)
        found = [_whole(section) for section in read_json(str(path), text)]
    except (OSError, EOFError, zlib.error, TypeError, KeyError, ValueError, AttributeError) as cause:
        raise InvalidInput(f"{path} cannot be read: {cause}") from cause
    if not found or not all(isinstance(one, Section) for one in found):
        raise InvalidInput(f"{path} cannot be read: it holds no sections")
    return found


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {"is": type(value).__name__, **{f.name: _plain(getattr(value, f.name)) for f in fields(value)}}
    if isinstance(value, Bound | Strip):
        return {"is": type(value).__name__, **{key: _plain(one) for key, one in value._asdict().items()}}
    if isinstance(value, bytes):
        return {"is": "bytes", "of": base64.b64encode(value).decode("ascii")}
    if isinstance(value, np.ndarray):
        whole = np.asarray(value, dtype="<f8")
        numbers, times = packed(whole) if packs(whole) else (whole, None)
        content = base64.b64encode(numbers.tobytes()).decode("ascii")
        return {"is": "array", "of": content, "shape": numbers.shape, "times": times}
    if isinstance(value, np.generic):
        return value.item()
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _whole(value: Any) -> Any:
    if isinstance(value, list):
        return [_whole(one) for one in value]
    if not isinstance(value, dict):
        return value
    kind, more = value["is"], {key: one for key, one in value.items() if key != "is"}
    if kind == "bytes":
        return base64.b64decode(more["of"])
    if kind == "array":
        times, content = more["times"], base64.b64decode(more["of"])
        numbers = np.frombuffer(content, "<f8" if times is None else np.uint8).reshape(more["shape"])
        return numbers if times is None else unpacked(numbers, int(times))
    return KINDS[kind](**{key: _whole(one) for key, one in more.items()})
