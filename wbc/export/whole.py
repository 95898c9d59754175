"""A file that is written whole, or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from wbc.errors import InvalidInput


@contextmanager
def whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside ``path``, with the same ending, to write to; it takes the name when the block ends well.

    Raises:
        InvalidInput: the file cannot be written there.
    """
    target = Path(path)
    aside = target.with_name(f".{target.stem}-{uuid4().hex}{target.suffix}")
    try:
        aside.touch(exist_ok=False)  # tried at once, before any long work
        yield aside
        aside.replace(target)
    except OSError as cause:
        raise InvalidInput(f"{target} cannot be written: {cause.strerror or cause}") from cause
    finally:
        aside.unlink(missing_ok=True)
