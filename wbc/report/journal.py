"""Long work that can be interrupted: the request, and every finding as soon as it is there, in a folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, final

from wbc.errors import InvalidInput
from wbc.files import written
from wbc.npz import read_json
from wbc.report.folder import check_free

Key = int | tuple[str | int | None, ...]


@final
class Journal:
    """Lines of JSON in a file: the header, then findings, each once, by what they have under ``key``.

    Whoever opens it again finds what is done. A line that was being written when the process was killed is cut off.

    Raises:
        InvalidInput: the file is something else.
    """

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._key = path, key
        whole = path.read_bytes()
        complete = whole[: whole.rfind(b"\n") + 1]
        if len(complete) < len(whole):
            with path.open("r+b") as file:
                file.truncate(len(complete))
        try:
            header, *lines = [read_json(str(path), line) for line in complete.decode("utf-8").splitlines()]
            self.findings: dict[Key, dict[str, Any]] = {self._of(line): line for line in lines}
        except (ValueError, KeyError, TypeError) as cause:
            raise InvalidInput(f"{path} is not the journal of a comparison or a sweep: {cause}") from cause
        if not isinstance(header, dict):
            raise InvalidInput(f"{path} is not the journal of a comparison or a sweep: its first line is no header")
        self.header: dict[str, Any] = header

    @classmethod
    def begin(cls, path: Path, key: str, header: dict[str, Any]) -> Journal:
        """A new journal."""
        with written(path) as aside:
            aside.write_text(_line(header), encoding="utf-8")
        return cls(path, key)

    def add(self, finding: dict[str, Any]) -> None:
        """Keep a finding, on disk first. One that is there already is not counted twice."""
        if self._of(finding) in self.findings:
            return
        with self._path.open("a", encoding="utf-8") as file:
            file.write(_line(finding))
        self.findings[self._of(finding)] = finding

    def write(self, path: Path, findings: Sequence[dict[str, Any]]) -> None:
        """The whole file, findings in this order."""
        path.write_text(_line(self.header) + "".join(map(_line, findings)), encoding="utf-8")

    def _of(self, finding: dict[str, Any]) -> Key:
        key = finding[self._key]
        return tuple(key) if isinstance(key, list) else key


def unfinished(out: Path) -> Path:
    """The folder beside ``out`` in which work goes on until all of it is done."""
    return out.with_name(f"{out.name}.unfinished")


def fresh(out: Path, journal: str, what: str, record: str) -> Path:
    """The folder to work in for ``out``, which is not made yet, with no such ``journal`` of ``what`` is done in it.

    ``record`` is the file that ends up in ``out``; see :func:`~wbc.report.folder.replaced`.

    Raises:
        InvalidInput: something else than a report at ``out``, or unfinished work.
    """
    check_free(out, record)
    folder = unfinished(out)
    if (folder / journal).exists():
        raise InvalidInput(f"an unfinished {what} is in {folder}; continue it with --resume, or remove it")
    return folder


def taken_up(out: Path, journal: str, what: str) -> Path:
    """The journal of unfinished work for ``out``.

    Raises:
        InvalidInput: there is none.
    """
    path = unfinished(out) / journal
    if not path.is_file():
        raise InvalidInput(f"there is no unfinished {what} {path.parent}; start one without --resume")
    return path


def _line(value: dict[str, Any]) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False) + "\n"
