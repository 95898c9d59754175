"""Draw slips in the sources by machine and look whether the tests notice them.

``python -m tests.mutations --count 200 --seed 1 --jobs 2`` draws slips from the syntax trees of ``SOURCES``, one at a
time in a copy of the project, and runs the tests that call the changed function, the fastest files first. It prints
each slip that no test notices as a diff, and how many were noticed. A slip that only stops a program from ending
counts as noticed. A slip is drawn by a hash of the seed and of its place in its function: changes elsewhere leave the
draw as it is.

Which test calls which function is found by one run of every test file (:mod:`tests.calls`), kept on disk beside
pytest's cache, and run again only for test files that have changed.
"""

from __future__ import annotations

import argparse
import difflib
import os
import resource
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from tests.calls import CACHE, HUNG, OPTIONS, Calls, Chosen, forked, importers, map_of
from tests.slips import Slip, slips

ROOT = Path(__file__).parent.parent
SOURCES = ("wbc/qp", "wbc/stack", "wbc/control", "wbc/methods", "tasks")
KEPT = (
    "wbc",
    "tasks",
    "tests",
    "docs",
    "README.md",
    "SECURITY.md",
    "CHANGELOG.md",
    "Makefile",
    "LICENSE",
    "pyproject.toml",
)
NOTICED, HANGS, CRASHES = "noticed", "noticed (does not end)", "noticed (ends the process)"
SURVIVES, UNREACHED = "NOT NOTICED", "NOT NOTICED (no test calls it)"


def drawn(root: Path, count: int, seed: int, sources: tuple[str, ...] = SOURCES) -> list[Slip]:
    """The ``count`` slips with the smallest hashes of seed and place."""
    files = (file.relative_to(root) for source in sources for file in sorted((root / source).rglob("*.py")))
    every = [slip for file in files for slip in slips(str(file), (root / file).read_text(encoding="utf-8"))]
    return sorted(every, key=lambda slip: slip.rank(seed))[:count]


def copied(root: Path, folder: Path) -> None:
    """Copy the project to ``folder``, with the machine code that a compiler kept and nothing else left behind."""
    for name in KEPT:
        source, target = root / name, folder / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("*.pyc"))
        elif source.exists():
            shutil.copy2(source, target)


def taken_in(root: Path, file: str) -> list[str]:
    """The files of kernels that are compiled with those of ``file`` in them, itself among them."""
    texts = {
        str(path.relative_to(root)): path.read_text(encoding="utf-8")
        for package in ("wbc", "tasks") for path in (root / package).rglob("compiled/*.py")
    }  # fmt: skip
    found, new = set[str](), {file} & set(texts)
    while new:
        found |= new
        new = importers(texts, new) - found
    return sorted(found)


def _kept(folder: Path, files: list[str]) -> list[Path]:
    """The machine code that is kept of these files."""
    found = ((folder / file).parent.glob(f"__pycache__/{Path(file).stem}.*.nb[ic]") for file in files)
    return [path for paths in found for path in paths]


@contextmanager
def _slipped(folder: Path, slip: Slip, files: list[str]) -> Iterator[None]:
    """The slip is in the sources of ``folder``; machine code of ``files`` is that of before afterwards."""
    path = folder / slip.file
    source, times = path.read_bytes(), path.stat()
    with TemporaryDirectory(dir=folder) as aside:
        moved = [(kept, Path(aside) / str(i)) for i, kept in enumerate(_kept(folder, files))]
        for kept, place in moved:
            kept.rename(place)
        try:
            path.write_bytes(slip.applied(source))
            yield
        finally:
            path.write_bytes(source)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
            for made in _kept(folder, files):
                made.unlink()
            for kept, place in moved:
                place.rename(kept)


def _run(folder: str, plan: list[tuple[str, list[str], float]], note: Any, compiled: list[str]) -> None:
    """In a process of its own: run the tests of the plan, file by file, until one fails.

    The files ``compiled`` are compiled first, which the time of no test is for.
    """
    os.chdir(folder)
    sys.path[:0] = [folder]
    sys.dont_write_bytecode = True
    with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        try:
            for file in compiled:
                import_module(file.removesuffix(".py").replace("/", "."))
        except Exception:
            note.send("the compiler")
            return
        for file, tests, seconds in plan:
            used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
            end = int(used + 60.0 + 6.0 * seconds)
            resource.setrlimit(resource.RLIMIT_CPU, (end, resource.getrlimit(resource.RLIMIT_CPU)[1]))
            if pytest.main([*OPTIONS, "-x", "-m", "", file], plugins=[Chosen(tests)]) not in (0, 5):
                note.send(file)
                return
            note.send("")
    note.send(None)


def verdict(folder: Path, slip: Slip, calls: Calls, patience: float) -> str:
    """What became of the slip in the copy ``folder``, which is as before afterwards."""
    plan = list(calls.plan(slip.file, slip.function, patience))
    if not plan:
        return UNREACHED
    compiled = taken_in(folder, slip.file)
    with _slipped(folder, slip, compiled):
        here, there = forked().Pipe(duplex=False)
        child = forked().Process(target=_run, args=(str(folder), plan, there, compiled))
        child.start()
        there.close()
        try:
            while here.poll(HUNG):
                note = here.recv()
                if note != "":
                    return SURVIVES if note is None else f"{NOTICED} by {note}"
            return HANGS
        except EOFError:
            child.join()
            if (child.exitcode or 0) >= 0:
                raise RuntimeError(f"the tests of {slip} could not be run") from None
            return CRASHES if child.exitcode != -signal.SIGXCPU else HANGS
        finally:
            child.kill()
            child.join()


def diff(root: Path, slip: Slip) -> str:
    """The slip as a unified diff."""
    before = (root / slip.file).read_bytes()
    texts = [text.decode().splitlines(keepends=True) for text in (before, slip.applied(before))]
    return "".join(difflib.unified_diff(*texts, slip.file, slip.file, n=2))


def verdicts(root: Path, slips: list[Slip], calls: Calls, *, jobs: int, patience: float) -> Iterator[tuple[Slip, str]]:
    """What became of each slip, as it is known."""
    with TemporaryDirectory() as name, ThreadPoolExecutor(jobs) as pool:
        copies: SimpleQueue[Path] = SimpleQueue()
        for job in range(jobs):
            folder = Path(name) / str(job)
            folder.mkdir()
            copied(root, folder)
            copies.put(folder)

        def judge(slip: Slip) -> str:
            folder = copies.get()
            try:
                return verdict(folder, slip, calls, patience)
            finally:
                copies.put(folder)

        yield from zip(slips, pool.map(judge, slips), strict=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the command; the exit code is 1 where a slip is not noticed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutations", description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--patience", type=float, default=300.0, help="seconds of tests for one slip")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds of a test file when the map is made")
    parser.add_argument("--only", default="", help="only slips in files whose path contains this")
    parser.add_argument("--map", action="store_true", help="only find out which test calls which function")
    asked = parser.parse_args(arguments)
    os.chdir(ROOT)
    calls = map_of(ROOT, ROOT / CACHE, jobs=asked.jobs, limit=asked.limit)
    if asked.map:
        return 0
    slips = [slip for slip in drawn(ROOT, 10**9, asked.seed) if asked.only in slip.file][: asked.count]
    start, noticed = time.monotonic(), 0
    for number, (slip, said) in enumerate(verdicts(ROOT, slips, calls, jobs=asked.jobs, patience=asked.patience), 1):
        noticed += said.startswith(NOTICED)
        print(f"{number:4} {slip}: {said}", flush=True)
        if not said.startswith(NOTICED):
            print(diff(ROOT, slip), flush=True)
    minutes = (time.monotonic() - start) / 60.0
    print(f"noticed {noticed} of {len(slips)} with seed {asked.seed} in {minutes:.0f} minutes")
    return int(noticed < len(slips))


if __name__ == "__main__":
    sys.exit(main())
