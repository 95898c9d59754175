"""The journal of a comparison: what was asked, and every finding as soon as it is there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, final

from wbc.errors import InvalidInput
from wbc.npz import read_json

Key = tuple[str | int | None, ...]


@final
class Journal:
    """Lines of json in a file: the header, then (key, finding). Whoever opens it again finds what is done.

    A line that was being written when the process was killed is cut off.

    Raises:
        InvalidInput: the file is something else.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.header: dict[str, Any] = {}
        self.findings: dict[Key, Any] = {}
        if path.exists():
            self._read()

    @classmethod
    def begin(cls, path: Path, header: dict[str, Any]) -> Journal:
        """A new journal."""
        path.write_text(json.dumps(header) + "\n", encoding="utf-8")
        return cls(path)

    def add(self, key: Key, finding: Any) -> None:
        """Keep a finding, on disk first."""
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps([key, finding]) + "\n")
        self.findings[key] = finding

    def _read(self) -> None:
        whole = self._path.read_bytes()
        complete = whole[: whole.rfind(b"\n") + 1]
        if len(complete) < len(whole):
            with self._path.open("r+b") as file:
                file.truncate(len(complete))
        try:
            first, *lines = complete.decode("utf-8").splitlines()
            self.header = read_json(str(self._path), first)
            for line in lines:
                key, finding = read_json(str(self._path), line)
                self.findings[tuple(key)] = finding
        except (ValueError, TypeError) as cause:
            raise InvalidInput(f"{self._path} is not the journal of a comparison: {cause}") from cause
