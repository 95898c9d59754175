"""Other libraries on the same workloads, in the same sitting: their scripts stand outside this package.

A folder of peers has ``bench_NAME.py WORKLOAD --repeat N --pause SECONDS`` for each library, printing rows like ours as
lines of json, and ``results.json``, rows measured before, without a pause. Libraries that cannot be imported together
have an environment each: ``vNAME`` beside ``v`` for the others.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from wbc.errors import InvalidInput

_PATIENCE = 900.0  # seconds
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# Libraries that have no inverse dynamics, or no inverse kinematics.
_ONLY = {"pink": ("W1", "W2"), "mink": ("W1", "W2"), "tsid": ("W3", "W4", "W5")}


@final
@dataclass(frozen=True)
class Peers:
    """The scripts of a folder, and the environments that run them.

    Raises:
        InvalidInput: a folder without scripts.
    """

    folder: Path
    environments: Path | None = None

    def __post_init__(self) -> None:
        if not list(self.folder.glob("bench_*.py")):
            raise InvalidInput(f"{self.folder} holds no bench_*.py; --peers takes a folder of benchmark scripts")

    def names(self, workload: str) -> Iterator[str]:
        """Libraries that have this workload."""
        for peer in ("placo", "tsid", "pink", "mink"):
            if (self.folder / f"bench_{peer}.py").is_file() and workload in _ONLY.get(peer, (workload,)):
                yield peer

    def row(self, peer: str, workload: str, repeats: int, pause: float = 0.0) -> dict[str, Any]:
        """Measured now; where its environment does not run, the row measured before, marked ``stored``."""
        python = self._python(peer)
        if python is not None:
            command = [str(python), f"bench_{peer}.py", workload, "--repeat", str(repeats)]
            command += ["--pause", str(pause)] if pause else []
            environment = os.environ | dict.fromkeys(_THREADS, "1")
            try:
                done = subprocess.run(
                    command, cwd=self.folder, env=environment, capture_output=True, text=True, check=False,
                    timeout=_PATIENCE,
                )  # fmt: skip
            except (OSError, subprocess.TimeoutExpired):
                return self._stored(peer, workload, pause)
            for line in done.stdout.splitlines():
                if line.startswith("{"):
                    row: dict[str, Any] = json.loads(line)
                    if "total_us" in row:
                        return row
        return self._stored(peer, workload, pause)

    def _python(self, peer: str) -> Path | None:
        for name in (f"v{peer}", "v"):
            if self.environments is not None:
                python = self.environments / name / "bin" / "python"
                if python.is_file():
                    return python
        return None

    def _stored(self, peer: str, workload: str, pause: float) -> dict[str, Any]:
        file = self.folder / "results.json"
        rows = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
        found = [r for r in rows if r.get("peer") == peer and r.get("workload") == workload and "total_us" in r]
        if not found or pause:
            return {"peer": peer, "workload": workload, "failed": True}
        best: dict[str, Any] = min(found, key=lambda row: float(row["total_us"]["median"]))
        return best | {"stored": True}
