"""Paths of files: a path that cannot be looked up or written is a typed error."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from wbc import checks
from wbc.errors import InvalidInput, WbcError

Place = str | os.PathLike[str]


def located(place: Place, error: type[WbcError] = InvalidInput) -> Path:
    """``place`` as a path that the file system can look up, whether or not something stands there.

    Raises:
        error: it is no path, is too long, holds a zero byte, or its links lead in a circle.

    Example:
        >>> from wbc.files import located
        >>> located("robots/arm.urdf").name
        'arm.urdf'
        >>> located("a" * 300)
        Traceback (most recent call last):
        wbc.errors.InvalidInput: 'aaa... is no path here: File name too long
    """
    try:
        path = Path(place)
        path.stat()
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass  # whoever opens it says so
    except (OSError, ValueError, TypeError) as cause:
        reason = cause.strerror if isinstance(cause, OSError) else cause
        raise error(f"{checks.shown(str(place))} is no path here: {reason}") from None
    return path


def slug(text: str) -> str:
    """A text as the name of a file or of a place in a page: small letters and digits, apart by hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


@contextmanager
def written(place: Place) -> Iterator[Path]:
    """A new file beside ``place`` to write, with the same ending; it takes the name when the block ends well, and
    vanishes if not. The place is tried at once: enter the block before any long work.

    Raises:
        InvalidInput: something else than a file stands at ``place``, or nothing can be written there.
    """
    target = located(place)
    if target.exists() and not target.is_file():
        raise InvalidInput(f"{target} cannot be written: it is no file")
    aside = target.parent / f".{uuid4().hex}{target.suffix}"
    with refused(target):
        aside.touch(exist_ok=False)
        aside.unlink()
        try:
            yield aside
            aside.replace(target)
        finally:
            with suppress(OSError):
                aside.unlink(missing_ok=True)


def made_folder(place: Place) -> Path:
    """The folder ``place``, made with those above it where there is none.

    Raises:
        InvalidInput: something else stands there, or it cannot be made.
    """
    folder = located(place)
    if folder.exists() and not folder.is_dir():
        raise InvalidInput(f"{folder} is a file; it must be a folder")
    with refused(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def refused(path: Path) -> Iterator[None]:
    """Around work that writes at ``path`` and does nothing else.

    Raises:
        InvalidInput: the system refused it.
    """
    try:
        yield
    except OSError as cause:
        raise InvalidInput(f"{path} cannot be written: {cause.strerror or cause}") from cause
