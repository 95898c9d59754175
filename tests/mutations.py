"""Mutations: deliberate slips in the sources, each of which must make a test fail.

Lists stand in ``mutations_*.py`` beside the tests: ``MUTATIONS`` of (file, old text, new text, test to run). Sources
are changed in a copy, never in place. Run all with ``python -m tests.mutations``; ``tests/test_mutations.py`` does it
too.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
PATIENCE = 120.0  # seconds
KEPT = ("wbc", "tasks", "tests", "pyproject.toml")


class Mutation(NamedTuple):
    """One slip: in ``file``, ``old`` becomes ``new``; ``test`` must notice."""

    file: str
    old: str
    new: str
    test: str

    def __str__(self) -> str:
        return f"{Path(self.file).stem}: {' '.join(self.old.split())} -> {' '.join(self.new.split())}"


def mutations() -> list[Mutation]:
    """All lists, file by file."""
    files = sorted(path.relative_to(ROOT) for path in (ROOT / "tests").rglob("mutations_*.py"))
    lists = [import_module(".".join(file.with_suffix("").parts)).MUTATIONS for file in files]
    return [Mutation(*entry) for entries in lists for entry in entries]


def copied(folder: Path) -> None:
    """The sources and tests without what they left behind."""
    for name in KEPT:
        source, target = ROOT / name, folder / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, target)


def passes(folder: Path, test: str) -> bool:
    """Whether this test passes on the sources in ``folder``, in a time that has an end.

    Raises:
        RuntimeError: it could not be run at all.
    """
    command = [sys.executable, "-B", "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", test]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return False
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{test} did not run:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.returncode == 0


def survives(folder: Path, mutation: Mutation) -> bool:
    """Whether the test passes although the sources in ``folder`` have the slip; they are as before afterwards.

    Raises:
        LookupError: the old text does not stand there exactly once.
    """
    path = folder / mutation.file
    source = path.read_text(encoding="utf-8")
    if source.count(mutation.old) != 1:
        raise LookupError(f"{mutation.file} has {source.count(mutation.old)} times: {mutation.old}")
    path.write_text(source.replace(mutation.old, mutation.new), encoding="utf-8")
    try:
        return passes(folder, mutation.test)
    finally:
        path.write_text(source, encoding="utf-8")


def main() -> int:
    """Print what became of each slip; the exit code is the number of those that nobody noticed."""
    unnoticed = 0
    with TemporaryDirectory() as name:
        folder = Path(name)
        copied(folder)
        for mutation in mutations():
            alive = survives(folder, mutation)
            unnoticed += alive
            print("NOT NOTICED" if alive else "noticed    ", mutation, flush=True)
    return unnoticed


if __name__ == "__main__":
    sys.exit(main())
