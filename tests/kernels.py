"""Run the tests of the numerical core as other processors would: `make kernels`, or `python -m tests.kernels`.

OpenBLAS has its own products for each family of processors, and numba compiles for the one it finds. Both differ in the
last bits. Each family of OpenBLAS that this processor can run has a run, except the one that it picks by itself, which
`make test` runs. The last run is under the oldest of these families, with numba aimed at any x86-64 processor, as on a
processor that has no more; its kernels raise where an index is beyond an array, since raw addresses have no bounds. It
tries all folders below; the others try those of the solvers and methods. Arguments are passed on to pytest: `-n 2
--dist loadfile` runs two processes at a time.

The exit status is 1 if a run fails, and 0 else.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parent.parent
NUMERICS = ("tests/methods", "tests/qp")
FOLDERS = (
    *NUMERICS,
    "tests/families",
    "tests/stack",
    "tests/control",
    "tests/models/test_near_pairs.py",
    "tests/models/test_features.py",
)

#: Families of OpenBLAS and what /proc/cpuinfo lists for a processor that can run them.
FLAGS: Mapping[str, frozenset[str]] = {
    "Prescott": frozenset({"pni"}),
    "Haswell": frozenset({"avx2", "fma"}),
    "SkylakeX": frozenset({"avx2", "fma", "avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"}),
}
#: Families that run the code of another one of the table.
SAME: Mapping[str, str] = {
    "Zen": "Haswell", "Katmai": "Prescott", "Core2": "Prescott", "Cooperlake": "SkylakeX", "Sapphirerapids": "SkylakeX",
}  # fmt: skip
#: numba for any x86-64 processor: no name and no features beyond those that all have; and with bounds of arrays.
GENERIC: Mapping[str, str] = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "NUMBA_BOUNDSCHECK": "1"}

ASK = "import numpy, scipy.linalg, threadpoolctl as t; print(*{i.get('architecture') for i in t.threadpool_info()})"


def runnable(flags: Iterable[str]) -> list[str]:
    """Families that a processor with these flags can run."""
    known = set(flags)
    return [name for name, needed in FLAGS.items() if needed <= known]


def flags() -> list[str]:
    """The flags of this processor, none where it is not x86-64 or Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    return next((line.split(":", 1)[1].split() for line in lines if line.startswith("flags")), [])


def picked(environment: Mapping[str, str] | None = None) -> set[str]:
    """Families that numpy and scipy run under these variables, by the names of the table where they are in it."""
    answer = subprocess.run(
        [sys.executable, "-c", ASK],
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        check=True,
    )
    return {SAME.get(name, name) for name in answer.stdout.split()}


@dataclass(frozen=True)
class Run:
    """One run of folders: its name, the environment variables that make it, and the folders."""

    name: str
    environment: Mapping[str, str] = field(default_factory=dict)
    folders: tuple[str, ...] = NUMERICS


def runs(can: Iterable[str], native: set[str]) -> list[Run]:
    """What is left to run where `make test` has run ``native``."""
    others = [Run(f"OpenBLAS {name}", {"OPENBLAS_CORETYPE": name}) for name in can if native != {name}]
    oldest, rest = (others[0], others[1:]) if others else (Run("OpenBLAS as it is"), [])
    last = Run(f"{oldest.name}, numba for any processor, bounds of arrays", {**oldest.environment, **GENERIC}, FOLDERS)
    return [*rest, last]


def passed(run: Run, options: Sequence[str]) -> bool:
    """Whether the tests pass under these options of pytest; prints what it says when it is done."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, **run.environment}
        if "NUMBA_CPU_NAME" in run.environment:
            environment["NUMBA_CACHE_DIR"] = cache  # kept machine code is for the processor found
            subprocess.run([sys.executable, "-m", "wbc.compile_all"], cwd=ROOT, env=environment, check=True)
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options, *run.folders],
            cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
    verdict = "passed" if done.returncode == 0 else "FAILED"
    print(f"=== {run.name}: {verdict} after {time.monotonic() - began:.0f} s\n{done.stdout}", flush=True)
    return done.returncode == 0


def main(options: Sequence[str] = ()) -> int:
    """Every run, under these options of pytest; the status of the command."""
    native, can = picked(), runnable(flags())
    print(
        f"{platform.processor() or platform.machine()}: OpenBLAS picks {', '.join(sorted(native)) or 'nothing known'};"
    )
    print(f"it can run {', '.join(can) or 'no other'}; folders: {', '.join(FOLDERS)}", flush=True)
    todo = runs(can, native)
    for run in todo:
        name = run.environment.get("OPENBLAS_CORETYPE")
        if name is not None and picked(run.environment) != {name}:
            print(f"OPENBLAS_CORETYPE={name} has no effect on this OpenBLAS")
            return 1
    verdicts = [passed(run, options) for run in todo]
    for run, verdict in zip(todo, verdicts, strict=True):
        print(f"{run.name}: {'passed' if verdict else 'FAILED'}")
    return 0 if all(verdicts) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
