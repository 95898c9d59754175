"""A report on disk: a folder that is there whole, or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from wbc.control.recorder import ARRAYS_FILE
from wbc.errors import InvalidInput
from wbc.files import located, made_folder, refused, written
from wbc.report.document import Report
from wbc.report.html import html
from wbc.report.markdown import markdown, picture_path

HTML, MARKDOWN = "report.html", "report.md"
#: What reports are made of: the record of a run, the data of a comparison, the results of a sweep.
DATA, RESULTS = "data.json", "results.jsonl"
RECORDS = (ARRAYS_FILE, DATA, RESULTS)


def write(report: Report, folder: Path) -> None:
    """Write ``report.html``, ``report.md``, and ``figures/`` into an existing folder, all of them or none.

    Raises:
        InvalidInput: they cannot be written there.
    """
    files = {picture_path(figure): figure.data for figure in report.figures}
    files |= {MARKDOWN: markdown(report).encode(), HTML: html(report).encode()}
    with ExitStack() as all_whole:
        for name, data in files.items():
            made_folder((folder / name).parent)
            with refused(folder / name):
                all_whole.enter_context(written(folder / name)).write_bytes(data)


@contextmanager
def replaced(folder: Path, record: str | None = None) -> Iterator[Path]:
    """A new folder beside ``folder`` to write into; it takes the name when the block ends well, and vanishes if not.

    A report that already stands there is replaced, and so is its record if that is ``record``, one of ``RECORDS``,
    which is to be written. The place is tried at once: enter the block before any long work.

    Raises:
        InvalidInput: something else stands there, or the place cannot be written.
    """
    check_free(folder, record)
    folder = folder.resolve()
    made = [parent for parent in folder.parents if not parent.exists()]
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        pending = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OSError as cause:
        raise InvalidInput(f"{folder} cannot be written: {cause.strerror}") from cause
    try:
        yield pending
        pending.chmod(0o755)  # mkdtemp makes folders that nobody else may read
        if folder.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{folder.name}-old-", dir=folder.parent))
            os.replace(folder, old)
            os.replace(pending, folder)
            shutil.rmtree(old)
        else:
            os.replace(pending, folder)
    finally:
        shutil.rmtree(pending, ignore_errors=True)
        with suppress(OSError):  # not empty: the report stands in it
            for parent in made:
                parent.rmdir()


def check_free(folder: Path, record: str | None = None) -> None:
    """Refuse to write over anything but an empty folder or an older report, which has no other record than ``record``.

    Raises:
        InvalidInput: something else stands there.
    """
    if not located(folder).exists():
        return
    if not folder.is_dir():
        raise InvalidInput(f"{folder} is a file; a report is a folder")
    if any(folder.iterdir()) and not (folder / HTML).is_file():
        raise InvalidInput(f"{folder} holds something else than a report; give an empty or a new folder")
    for name in RECORDS:
        if name != record and (folder / name).exists():
            raise InvalidInput(f"{folder} holds {name}, which would be lost; give an empty or a new folder")
