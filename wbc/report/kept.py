"""What a scenario shows of its own, in a file beside the record: sections as data, read back to the bit."""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Sequence
from pathlib import Path

from wbc.errors import InvalidInput
from wbc.npz import MAX_BYTES, read_json
from wbc.report.coded import Codec
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
CODEC = Codec((Address, Bar, Bound, Curve, Figure, Link, Map, Marked, Plot, Section, Strip, Table, Text))


def keep_sections(sections: Sequence[Section], folder: Path) -> None:
    """Write ``sections`` into ``folder``; nothing where there are none."""
    if sections:
        text = json.dumps(CODEC.plain(sections), ensure_ascii=False, allow_nan=False)
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
        found = list(CODEC.whole(read_json(str(path), text)))
    except (OSError, EOFError, zlib.error, TypeError, KeyError, ValueError, AttributeError) as cause:
        raise InvalidInput(f"{path} cannot be read: {cause}") from cause
    if not found or not all(isinstance(one, Section) for one in found):
        raise InvalidInput(f"{path} cannot be read: it holds no sections")
    return found
