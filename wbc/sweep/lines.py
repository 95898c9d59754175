"""Results on disk: a header and one line of json for each run, written as soon as it is there."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any, final

from wbc.errors import InvalidInput
from wbc.npz import read_json

RESULTS = "results.jsonl"
_HEADER = {"scenario", "sweep", "runs", "seed", "date", "machine", "versions", "plan"}


@final
class Lines:
    """The file of a sweep that is under way. Each run stands in it once, in the order in which they came.

    Raises:
        InvalidInput: the file is something else.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        whole = path.read_bytes()
        complete = whole[: whole.rfind(b"\n") + 1]  # a line that was being written when the process was killed
        if len(complete) < len(whole):
            with path.open("r+b") as file:
                file.truncate(len(complete))
        try:
            first, *lines = complete.decode("utf-8").splitlines()
            self.header: dict[str, Any] = read_json(str(path), first)
            self.results: dict[int, dict[str, Any]] = {
                line["run"]: line for line in map(partial(read_json, str(path)), lines)
            }
        except (ValueError, KeyError, TypeError) as cause:
            raise InvalidInput(f"{path} does not hold the results of a sweep: {cause}") from cause
        if not isinstance(self.header, dict) or not _HEADER <= set(self.header):
            raise InvalidInput(f"{path} does not hold the results of a sweep: its first line is not their header")

    @classmethod
    def begin(cls, path: Path, header: dict[str, Any]) -> Lines:
        """A new file."""
        path.write_text(_line(header), encoding="utf-8")
        return cls(path)

    def add(self, result: dict[str, Any]) -> None:
        """Keep a result, on disk first. A run that is there already is not counted twice."""
        if result["run"] in self.results:
            return
        with self._path.open("a", encoding="utf-8") as file:
            file.write(_line(result))
        self.results[result["run"]] = result

    def in_order(self) -> list[dict[str, Any]]:
        """All results by number of the run."""
        return [self.results[run] for run in sorted(self.results)]


def write(path: Path, header: dict[str, Any], results: list[dict[str, Any]]) -> None:
    """The whole file, runs in order."""
    path.write_text(_line(header) + "".join(map(_line, results)), encoding="utf-8")


def _line(value: dict[str, Any]) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False) + "\n"
